"""Closed forms of the paper's sizing."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from tjscan.core.config import validate_table
from tjscan.core.frames import Array
from tjscan.crawler.sizing import (
    SizeSettings,
    broken_rules,
    peel_of_top_pad,
    size_crawler,
    tightest_turn,
    torque_of_turn,
)
from tjscan.job.crawl.job import CrawlJob, CrawlSimulationSettings, read_crawl_job
from tjscan.vehicle.pad_plant import PadPlant, PadSettings
from tjscan.vehicle.tracks import TrackGeometry

EXAMPLES = Path(__file__).parents[2] / "examples"
PAPER = SizeSettings(gear=195.0, torque=42.0, top_speed=0.1)
FIGURES = {one.name: one.value for one in size_crawler(PAPER, TrackGeometry(), 8.0)}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("the same with one track broken", 6.0),
        ("grip of both tracks over the weight", 12.0),
        ("least pads of a track for that", 20.0),
        ("friction needed on one track", 1 / 6),
        ("friction needed on both tracks", 1 / 12),
        ("pull of a track", 840.0),
        ("pull of both tracks over the weight", 1.7125),
        ("speed of a motor at top speed", 3724.2),
        ("power of a track at full pull", 84.0),
        ("power to climb at top speed", 98.1),
    ],
)
def test_figures_are_those_of_the_closed_forms(name: str, value: float) -> None:
    assert FIGURES[name] == pytest.approx(value, rel=1e-3)


def test_peel_is_that_of_pads_spread_evenly() -> None:
    # Many pads: sum of x² is n L² / 12, and the top one sits at L / 2.
    size = SizeSettings().pads
    limit = size.mass * 9.81 * size.mass_height * 6 / (size.pads * size.contact_length)
    assert peel_of_top_pad(size) == pytest.approx(limit, rel=0.06)


@pytest.mark.parametrize("radius", [5.0, 20.0])
@pytest.mark.parametrize("friction", [0.3, 0.5])
def test_torque_of_a_turn_is_that_of_rigid_pads_that_all_slide(
    radius: float, friction: float
) -> None:
    """Truth of another make: Coulomb friction without any shear, forces balanced by SciPy."""
    pads = replace(SizeSettings().pads, friction=friction, shear=0.1e-3)
    tracks, weight = TrackGeometry(), 100 * 9.81
    x = np.tile((np.arange(400) + 0.5) / 400 - 0.5, 2) * pads.contact_length
    y = np.repeat((-0.5, 0.5), 400) * tracks.gauge
    run = 1 - y / radius
    peel = weight * pads.mass_height * x / (x @ x)
    grip = friction * (pads.pads * pads.grip * 9.81 / 400 - peel)

    def friction_forces(motion: Array) -> tuple[Array, Array]:
        along, across, turn = motion
        slide = np.array((along - turn * y - run, across + turn * x))
        return tuple(-grip * slide / np.hypot(*slide))

    def unbalanced(motion: Array) -> list[float]:
        fx, fy = friction_forces(motion)
        return [float(fx.sum()) - weight, float(fy.sum()), float(x @ fy - y @ fx)]

    found = least_squares(unbalanced, (0.99, 1e-3, 0.5 / radius), x_scale=(1e-3, 1e-3, 1e-2))
    assert np.abs(found.fun).max() < 1e-3
    left = friction_forces(found.x)[0][:400].sum() * tracks.sprocket_radius
    assert torque_of_turn(pads, tracks, radius) == pytest.approx(left, rel=0.02)


def test_tightest_turn_is_the_one_that_takes_all_the_torque() -> None:
    assert tightest_turn((2, 10, 50), (60.0, 50.0, 30.0), 40.0) == pytest.approx(1 / 0.06)
    assert tightest_turn((2, 10), (30.0, 20.0), 40.0) == 2
    assert tightest_turn((2, 10), (60.0, 50.0), 40.0) == np.inf


def test_example_keeps_its_own_rules() -> None:
    job = read_crawl_job(EXAMPLES / "crawl.toml")
    figures = size_crawler(job.size, job.vehicle.tracks, job.steering.least_radius)
    assert [one.name for one in figures if not one.holds] == []
    assert job.guards.torque == job.size.torque


def test_a_job_that_says_nothing_keeps_every_rule() -> None:
    job = CrawlJob(simulation=CrawlSimulationSettings())
    assert broken_rules(job.size, job.vehicle.tracks, job.steering.least_radius) == ()
    assert job.guards.torque == job.size.torque


def test_the_rules_that_are_broken_are_those_of_the_whole_sizing() -> None:
    for size in (PAPER, SizeSettings(), replace(PAPER, pads=replace(PAPER.pads, pads=12))):
        whole = [one for one in size_crawler(size, TrackGeometry(), 8.0) if not one.holds]
        assert list(broken_rules(size, TrackGeometry(), 8.0)) == whole


def test_a_broken_rule_says_what_to_do() -> None:
    broken = broken_rules(PAPER, TrackGeometry(), 8.0)
    assert [one.name for one in broken] == ["torque of a turn of 8 m"]
    assert "least_radius_mm" in broken[0].advice


def test_a_tighter_turn_takes_more_torque() -> None:
    torques = [torque_of_turn(SizeSettings().pads, TrackGeometry(), r) for r in (200, 50, 10)]
    assert torques == sorted(torques)
    # Straight up, each track carries half of the weight.
    straight = torque_of_turn(SizeSettings().pads, TrackGeometry(), 1e6)
    assert straight == pytest.approx(100 * 9.81 / 2 * 0.05, rel=0.02)


@pytest.mark.parametrize(
    ("key", "value", "field"),
    [("mass_kg", 80.0, "mass"), ("pads", 30, "pads"), ("inclination_deg", 180.0, "inclination")],
)
def test_a_key_of_the_pads_changes_that_key_alone(key: str, value: float, field: str) -> None:
    job = validate_table(CrawlJob, {"size": {"pads": {key: value}}, "simulation": {}})
    whole = SizeSettings().pads
    stated: dict[str, Any] = {field: np.radians(value) if key.endswith("_deg") else value}
    assert job.size.pads == replace(whole, **stated)


@pytest.mark.parametrize("friction", [0.5, 0.3])
def test_torques_of_pads_stated_in_part_are_those_of_the_whole(friction: float) -> None:
    """A vehicle was taken for one that runs level, which its motors turn more easily."""
    asked = {"size": {"pads": {"friction": friction}}, "simulation": {}}
    pads = validate_table(CrawlJob, asked).size.pads
    climbing = PadSettings(friction=friction, down=np.pi)
    torques = [torque_of_turn(pads, TrackGeometry(), 8.0) for pads in (pads, climbing)]
    assert torques[0] == torques[1]


@pytest.mark.parametrize("inclination", [45.0, 90.0, 110.0, 150.0])
@pytest.mark.parametrize("friction", [0.04, 0.08, 0.12, 0.16, 0.2, 0.3])
@pytest.mark.parametrize("grip", [10.0, 25.0])
def test_a_vehicle_that_slides_down_breaks_a_rule(
    inclination: float, friction: float, grip: float
) -> None:
    """Truth: the body of the simulation, on a straight way and in the tightest turn."""
    size = SizeSettings(safety=1.0, torque=1e4)  # neither magnets nor motors object
    changed: dict[str, Any] = {
        "inclination": np.radians(inclination),
        "friction": friction,
        "grip": grip,
    }
    size = replace(size, pads=replace(size.pads, **changed))
    for turn in (np.inf, 8.0):
        plant = PadPlant(size.pads, TrackGeometry(), np.zeros(3))
        for _ in range(60):
            plant.advance(0.005 * (1 + 0.2 / turn), 0.005 * (1 - 0.2 / turn), 1.0)
        if plant.pose_w[0] < 0.15:  # of the 0.3 m that its tracks ran
            assert broken_rules(size, TrackGeometry(), 8.0)


@pytest.mark.parametrize("inclination", [120.0, 180.0])
def test_an_overhead_hull_takes_friction_and_grip_for_what_hangs_on_the_magnets(
    inclination: float,
) -> None:
    size = SizeSettings()
    size = replace(size, pads=replace(size.pads, inclination=np.radians(inclination)))
    figures = {one.name: one for one in size_crawler(size, TrackGeometry(), 8.0)}
    across, along = np.cos(np.radians(inclination)), np.sin(np.radians(inclination))
    needed = figures["friction needed on one track"]
    assert needed.value == pytest.approx(along / (6 + across), abs=1e-12)
    # One track alone: its 24 pads share what pulls off, and the top one bears the lever too.
    pads = size.pads
    lever = 981.0 * along * pads.mass_height * 6 / (24 * pads.contact_length)
    assert figures["peel of the top pad"].value == pytest.approx(
        lever - 981.0 * across / 24, rel=0.05
    )
    assert broken_rules(size, TrackGeometry(), 8.0) == ()
