"""Starts and stops: spread, kept from crown and saddle, parted among stations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plates import sheared_groove
from ringed_grooves import corners_along_arc, edges_of

from tjscan.planning.plan import WeldPlan, plan_weld
from tjscan.planning.stops import (
    UNREACHED_STATION,
    StationStretch,
    StopPlacement,
    crowns_and_saddles,
)
from tjscan.planning.wps import read_wps

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "wps.toml"
WPS = read_wps(EXAMPLE).model_copy(update={"start_stop": None})
DOWN = np.array((0.0, 0.0, -1.0))
SECTION = sheared_groove(root=6e-3, depth=22e-3, opening=0.95, slope=0.1, tilt=0.1)
EDGES = edges_of(corners_along_arc(SECTION, growth=0.2))
LENGTH = EDGES.length
MARKS = crowns_and_saddles(EDGES, np.eye(4))
SPREAD = WPS.sequence.start_spread
LEFT = StationStretch("left", -0.15 * LENGTH, 0.65 * LENGTH)
RIGHT = StationStretch("right", 0.35 * LENGTH, 1.15 * LENGTH)


@pytest.fixture(scope="module")
def parted() -> WeldPlan:
    return plan_weld(EDGES, WPS, DOWN, MARKS, (LEFT, RIGHT))


def stops(plan: WeldPlan, station: str) -> np.ndarray:
    """First and last s of the station's beads of each layer, shape (layers, 2)."""
    beads = [b for b in plan.beads if b.station == station and b.place == 1]
    return np.array([(b.s.min(), b.s.max()) for b in beads])


def test_a_ring_has_four_crowns_and_saddles_a_quarter_turn_apart() -> None:
    np.testing.assert_allclose(MARKS, 0.25 * LENGTH * np.arange(4), atol=2e-3)
    half = edges_of(corners_along_arc(SECTION, turn=0.6 * np.pi))
    np.testing.assert_allclose(
        crowns_and_saddles(half, np.eye(4)), [0, half.length / 1.2], atol=1e-3
    )


def test_starts_of_a_ring_are_spread_and_keep_from_crown_and_saddle() -> None:
    plan = plan_weld(EDGES, WPS, DOWN, MARKS)
    starts = stops(plan, UNREACHED_STATION)[:, 0]
    assert np.diff(starts).min() >= SPREAD - 1e-9
    away = np.abs(starts[:, None] - np.append(MARKS, LENGTH))
    assert away.min() >= WPS.sequence.stop_distance - 1e-9
    assert not [f for f in plan.findings if f.key.startswith("sequence.st")]


def test_beads_are_the_same_whether_stations_share_them_or_not(parted: WeldPlan) -> None:
    whole = plan_weld(EDGES, WPS, DOWN, MARKS)
    assert {b.number for b in parted.beads} == {b.number for b in whole.beads}
    for part in parted.beads:
        bead = whole.beads[part.number - 1]
        assert (part.layer, part.place, part.kind) == (bead.layer, bead.place, bead.kind)
        s = bead.s[0] + np.mod(part.s - bead.s[0], LENGTH)
        for name in ("speed", "feed", "area", "heat", "width"):
            there = np.interp(s, bead.s, getattr(bead, name))
            np.testing.assert_allclose(getattr(part, name), there, rtol=2e-3)
        tips = [np.interp(s, bead.s, bead.points[:, i]) for i in range(3)]
        np.testing.assert_allclose(part.points, np.transpose(tips), atol=2e-4)
    overlap = WPS.sequence.overlap * sum(b.area.mean() for b in whole.beads)
    assert parted.volume == pytest.approx(whole.volume + overlap, rel=2e-3)


def test_every_layer_is_laid_all_round_by_stations_within_their_reach(parted: WeldPlan) -> None:
    spans = {one.station: one for one in (LEFT, RIGHT)}
    left, right = stops(parted, "left"), stops(parted, "right")
    overlap = WPS.sequence.overlap
    np.testing.assert_allclose(left[:, 1] - overlap, right[:, 0])
    np.testing.assert_allclose(right[:, 1] - overlap, left[:, 0] + LENGTH)
    for name, ends in (("left", left), ("right", right)):
        turn = LENGTH * np.round(
            (ends.mean() - 0.5 * (spans[name].begin + spans[name].end)) / LENGTH
        )
        assert ends[:, 0].min() - turn >= spans[name].begin - 1e-9
        assert ends[:, 1].max() - turn <= spans[name].end + 1e-9


def test_the_station_that_welds_first_steps_back_from_layer_to_layer(parted: WeldPlan) -> None:
    """Else it would lay a bead where the other one has not laid the layer below."""
    left = stops(parted, "left")
    assert np.diff(left[:, 0]).min() >= SPREAD - 1e-9
    assert np.diff(left[:, 1]).max() <= -SPREAD + 1e-9
    assert not [f for f in parted.findings if f.key == "sequence.start_spread_mm"]


def test_a_window_without_room_for_the_spread_is_used_up_and_named() -> None:
    narrow = replace(RIGHT, begin=LEFT.end - 0.08, end=LENGTH + LEFT.begin + 0.08)
    plan = plan_weld(EDGES, WPS, DOWN, MARKS, (LEFT, narrow))
    named = {f.key for f in plan.findings}
    assert "sequence.start_spread_mm" in named
    assert stops(plan, "left")[:, 1].max() <= LEFT.end + 1e-9


def test_what_no_station_reaches_is_nobody_s_and_still_planned() -> None:
    short = replace(RIGHT, end=LENGTH + LEFT.begin - 0.1)
    plan = plan_weld(EDGES, WPS, DOWN, MARKS, (LEFT, short))
    nobody = stops(plan, UNREACHED_STATION)
    lengths = nobody[:, 1] - nobody[:, 0] - WPS.sequence.overlap
    np.testing.assert_allclose(lengths, 0.1 + WPS.sequence.overlap)


@pytest.mark.parametrize("reverse", [False, True])
def test_an_open_groove_is_parted_among_stations_too(reverse: bool) -> None:
    edges = edges_of(corners_along_arc(SECTION, turn=np.pi))
    half = edges.length
    wps = WPS.model_copy(update={"sequence": replace(WPS.sequence, reverse=reverse)})
    reach = (StationStretch("a", 0.0, 0.7 * half), StationStretch("b", 0.3 * half, half))
    plan = plan_weld(edges, wps, DOWN, (), reach)
    a, b = stops(plan, "a"), stops(plan, "b")
    np.testing.assert_allclose(a[:, 0], 0)
    np.testing.assert_allclose(b[:, 1], half)
    np.testing.assert_allclose(a[:, 1] - b[:, 0], WPS.sequence.overlap)
    assert all((bead.s[0] > bead.s[-1]) == reverse for bead in plan.beads)


def test_a_bead_that_is_too_short_or_too_wide_is_named() -> None:
    tight = WPS.model_copy(
        update={
            "bead": replace(WPS.bead, weave_limit=4e-3),
            "sequence": replace(WPS.sequence, shortest_bead=1.0),
        }
    )
    edges = edges_of(corners_along_arc(SECTION, turn=np.pi))
    keys = {f.key for f in plan_weld(edges, tight, DOWN).findings}
    assert {"bead.weave_limit_mm", "sequence.shortest_bead_mm"} <= keys


def test_zones_part_the_spans_of_stations() -> None:
    stops = StopPlacement(LENGTH, True, WPS.sequence, MARKS, (LEFT, RIGHT))
    zones = [(0.0, 0.4 * LENGTH), (0.4 * LENGTH, LENGTH)]
    laid = [stops.spans(zones, zone, 4) for zone in range(2)]
    for layer in range(4):
        spans = [span for zone in laid for span in zone[layer]]
        total = sum(span.end - span.begin - WPS.sequence.overlap for span in spans)
        assert total == pytest.approx(LENGTH)
