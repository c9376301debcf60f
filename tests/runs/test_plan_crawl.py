"""Passes for a crawler, planned from what its laser saw of a butt joint."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crawls import SHORT
from hull_views import DEFAULT, FILLED_15_MM, see

from tjscan.core.config import validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.job.crawl.job import CrawlJob
from tjscan.joint.hull import HullJoint, HullTack
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import SectionLaserModel
from tjscan.planning.crawl_passes import crawl_passes_of_plan
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.path import cut_groove_stations, map_template_onto
from tjscan.planning.plan import WeldPlan, plan_weld
from tjscan.planning.wps import WeldingProcedure, read_wps
from tjscan.runs.plan.run import butt_joint_edges, passes_to_toml

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "wps.toml"
LENGTH = 0.2
INTO_HULL = np.array((0.0, 0.0, 1.0))
JOINT = HullJoint(high_low=1e-3)
SHARP = replace(DEFAULT, noise=0.02e-3)
"""A laser whose profiles are never the same to the last bit."""


def wps(**tables: dict[str, object]) -> WeldingProcedure:
    found = read_wps(EXAMPLE).model_copy(update={"start_stop": None})
    return found.model_copy(
        update={name: replace(getattr(found, name), **keys) for name, keys in tables.items()}
    )


def seen(joint: HullJoint, model: SectionLaserModel = SHARP) -> list[tuple[float, Profile]]:
    rng = np.random.default_rng(1)
    return [(at, see(joint, rng, model, along=at)) for at in np.arange(0.002, LENGTH, 0.005)]


def edges(joint: HullJoint, model: SectionLaserModel = SHARP) -> GrooveEdges:
    return butt_joint_edges(seen(joint, model), LENGTH, 0.1)


def plan(joint: HullJoint = JOINT, after_pass: int = 0) -> WeldPlan:
    return plan_weld(edges(joint), wps(), INTO_HULL, after_pass=after_pass)


def test_the_edges_are_those_of_the_joint() -> None:
    found = edges(JOINT).corners(np.array([0.5 * LENGTH]))[0, :, 1:] * (1, -1)
    half, gap = 0.5 * JOINT.width, 0.5 * JOINT.root_opening
    drawn = [(-gap, -20e-3), (gap, -20e-3), (half, 0.5e-3), (-half, -0.5e-3)]
    np.testing.assert_allclose(found, drawn, atol=0.15e-3)


def test_passes_lay_down_what_the_joint_holds() -> None:
    found = plan()
    passes = crawl_passes_of_plan(found)
    length = found.edges.length
    s = np.linspace(0, length, 2001)
    rows = [one.table.at(s) for one in passes]
    laid = sum(np.trapezoid(found.wps.deposition_rate(row.feed) / row.speed, s) for row in rows)
    cap = 2 / 3 * found.wps.bead.cap_height * JOINT.width
    assert laid == pytest.approx((JOINT.groove_area + cap) * length, rel=0.01)
    for one, row in zip(passes, rows, strict=True):
        low, high = found.wps.arc.travel_speed
        assert low <= row.speed.min() <= row.speed.max() <= high
        assert one.misfills < 1e-3
        assert one.strays < 0.05e-3
        assert np.abs(row.offset).max() < 0.5 * JOINT.width
        assert -JOINT.depth - 0.2e-3 <= row.height.min() <= row.height.max() < 0


def test_passes_of_a_symmetric_joint_are_symmetric() -> None:
    passes = crawl_passes_of_plan(plan(HullJoint()))
    for layer in {one.bead.layer for one in passes}:
        offsets = sorted(one.table.offset.mean() for one in passes if one.bead.layer == layer)
        np.testing.assert_allclose(offsets, [-x for x in offsets[::-1]], atol=0.1e-3)


def test_a_crawl_job_takes_the_passes() -> None:
    found = plan()
    passes = crawl_passes_of_plan(found)
    named = found.wps.model_copy(update={"name": 'a "WPS"'})
    text = passes_to_toml(passes, named)
    job = tomllib.loads(SHORT.split("[[pass]]")[0] + "[simulation]\n") | tomllib.loads(text)
    read = validate_table(CrawlJob, job).passes
    for one, taken in zip(passes, read, strict=True):
        assert taken.procedure == 'a "WPS"'
        assert (taken.weave_period, taken.dwell) == (1.0, 0.2)
        for name in ("speed", "offset", "height", "weave", "feed"):
            values = getattr(taken.table, name), getattr(one.table, name)
            np.testing.assert_allclose(*values, atol=1e-6)
        np.testing.assert_allclose(taken.table.s, one.table.s, atol=1e-6)


def test_after_passes_the_rest_is_planned() -> None:
    found = plan(FILLED_15_MM, after_pass=3)
    assert found.beads[0].number == 4
    assert {bead.kind for bead in found.beads} <= {"fill", "cap"}
    # A triangle's worth above the last beads; their crowns stand in it.
    assert found.volume < 0.6 * plan(HullJoint()).volume
    assert all((one.table.height > -7e-3).all() for one in crawl_passes_of_plan(found))


def test_a_tack_weld_is_bridged_and_says_where_it_is() -> None:
    tack = HullTack(at=0.1, length=0.03, height=4e-3)
    bare, tacked = edges(JOINT), edges(replace(JOINT, tacks=(tack,)))
    s = np.array([0.09])
    np.testing.assert_allclose(tacked.corners(s), bare.corners(s), atol=0.2e-3)
    ((begin, end),) = tacked.root.tack_spans(tack.length)
    assert begin < 0.1 < end


def test_the_stated_standard_deviation_grows_with_the_laser_s_noise() -> None:
    s = np.array([0.5 * LENGTH])
    quiet, loud = (
        edges(JOINT, replace(DEFAULT, noise=noise)).relative_area_sigma(s)[0]
        for noise in (0.02e-3, 0.2e-3)
    )
    assert 3 * quiet < loud < 0.02


def test_the_plan_covers_the_joint_asked_for_and_is_less_sure_where_it_was_not_seen() -> None:
    part = [(at, profile) for at, profile in seen(JOINT) if 0.07 < at < 0.18]
    found = butt_joint_edges(part, LENGTH, 0.1)
    assert found.length == pytest.approx(LENGTH, abs=1e-4)
    sigma = found.relative_area_sigma(np.array([0.0, 0.04, 0.12]))
    assert sigma[0] > sigma[1] > sigma[2]
    assert sigma[0] > 1.2 * sigma[2]
    bead = plan_weld(found, wps(), INTO_HULL).beads[0]
    assert bead.begin == pytest.approx(0.0, abs=1e-6)
    assert bead.end == pytest.approx(LENGTH, abs=1e-4)
    with pytest.raises(ConfigurationError, match="mm apart") as error:
        butt_joint_edges(part, LENGTH, 0.06)
    assert error.value.key == "sequence.longest_step_mm"


def test_errors_of_the_area_are_not_larger_than_stated() -> None:
    s = np.linspace(0.02, 0.18, 9)
    rng, ratios = np.random.default_rng(7), []
    for _ in range(4):
        views = [(at, see(JOINT, rng, DEFAULT, along=at)) for at in np.arange(2e-3, LENGTH, 5e-3)]
        found = butt_joint_edges(views, LENGTH, 0.1)
        area = map_template_onto(cut_groove_stations(found, s), 0.0).area
        ratios.append((area / JOINT.groove_area - 1) / found.relative_area_sigma(s))
    assert np.mean(np.square(ratios)) < 1.5


def test_what_a_pass_can_t_do_is_refused() -> None:
    tack = HullTack(at=0.1, length=0.04, height=4e-3)
    found = edges(replace(JOINT, tacks=(tack,)))
    assert found.root.tacked.any()
    skipping = plan_weld(found, wps(root={"tacks": "skip"}), INTO_HULL)
    with pytest.raises(ConfigurationError, match="does not stop at tack") as error:
        crawl_passes_of_plan(skipping)
    assert error.value.key == "root.tacks"
    with pytest.raises(ConfigurationError, match="from the start") as error:
        crawl_passes_of_plan(plan_weld(edges(JOINT), wps(sequence={"reverse": True}), INTO_HULL))
    assert error.value.key == "sequence.reverse"


def test_a_joint_that_was_hardly_seen_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="stations of 20 mm"):
        butt_joint_edges(seen(JOINT)[:8], LENGTH, 0.1)
