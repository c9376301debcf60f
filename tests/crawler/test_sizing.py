"""Closed forms of the paper's sizing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

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
