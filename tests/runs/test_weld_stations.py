"""A weld from several stations: who lays what, and that nothing is left out where they meet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from weld_grooves import v_groove, v_groove_planner

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.edges import GrooveEdges, fit_edges_to_corners
from tjscan.planning.stops import StationStretch
from tjscan.planning.wps import read_wps
from tjscan.runs.weld.beads import (
    STRETCH_MARGIN,
    WeldPass,
    area_that_closing_leaves,
    passes_of_weld,
    plan_pass,
)
from tjscan.runs.weld.stations import _part_of_groove, _stretch_of_sections
from tjscan.welding.bead import BeadModel
from tjscan.welding.replan import BeadOrder, GroovePart, WeldPlanner
from tjscan.welding.state import WeldState

WPS: Final = read_wps(Path(__file__).parents[2] / "examples" / "wps.toml")
COUNTS: Final = (1, 2, 3, 4)
ORDER: Final = BeadOrder(counts=COUNTS, feeds=(0.15,) * 10, weaves=(0.0,) * 10, cap_height=2e-3)


def ring() -> GrooveEdges:
    """A closed groove of about 1.26 m."""
    angle = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
    radius = 0.2 + np.array((0.0, 6e-3, 25e-3, -20e-3))
    x, y = radius * np.cos(angle)[:, None], radius * np.sin(angle)[:, None]
    z = np.broadcast_to((0.0, 0.0, 20e-3, 22e-3), x.shape)
    corners = np.stack((x, y, z), axis=2)
    return fit_edges_to_corners(corners, np.full((48, 4), 1e-4), np.full(48, 1e-2), 0.1)


def spans_round(passes: list[WeldPass], length: float) -> Array:
    """How often each millimetre of the groove is welded by passes."""
    times = np.zeros(round(1e3 * length), dtype=int)
    for one in passes:
        at = np.arange(np.ceil(1e3 * one.begin), np.floor(1e3 * one.end)).astype(int)
        np.add.at(times, at % len(times), 1)
    return times


def two_stretches(edges: GrooveEdges, overlap: float) -> tuple[StationStretch, StationStretch]:
    half, by = 0.5 * edges.length, 0.5 * overlap
    return (
        StationStretch("left", edges.length - by, edges.length + half + by),
        StationStretch("right", half - by, edges.length + by),
    )


def test_two_stations_weld_every_bead_once_round_and_a_layer_in_turns() -> None:
    edges = ring()
    passes = passes_of_weld(ORDER, edges, WPS, two_stretches(edges, 0.25))
    borders = []
    for bead in range(10):
        parts = [one for one in passes if one.bead == bead]
        assert [one.station for one in parts] != []
        assert {one.station for one in parts} == {"left", "right"}
        length = sum(one.end - one.begin for one in parts)
        assert length == pytest.approx(edges.length, abs=1e-9)  # no metal twice
        times = spans_round(parts, edges.length)
        assert np.count_nonzero(times == 0) <= 4  # of a millimetre, at the ends
        assert np.count_nonzero(times > 1) <= 4
        borders.append(parts[0].begin % edges.length)
    layers = np.repeat(range(4), COUNTS)
    assert np.diff(borders)[np.diff(layers) == 0] == pytest.approx(0.0, abs=1e-9)
    ends = BeadModel().start_length + BeadModel().crater_length
    assert np.abs(np.diff(borders))[np.diff(layers) > 0].min() > ends
    stations = [[one.station for one in passes if layers[one.bead] == k] for k in range(4)]
    assert stations[1] == ["right", "right", "left", "left"]  # who has laid a layer begins the next
    assert stations[2] == ["left"] * 3 + ["right"] * 3
    for at in np.arange(0.0005, edges.length, 0.001):  # what is missing is shared by those to come
        over = [one.bead for one in passes if (at - one.begin) % edges.length < one.end - one.begin]
        assert over == list(range(10))


def test_a_pass_is_planned_as_if_the_groove_ended_where_it_does() -> None:
    state, own = v_groove(), slice(21)
    there, end = GroovePart.all_of(state.s), float(state.s[20])
    whole, alone = v_groove_planner(state), v_groove_planner(state.part(own))
    first = whole.next_bead()
    whole.after_bead(first, first.area)
    alone.after_bead(first.part(own), first.area[own])
    for bead in (1, 2):  # beyond its end there is none of this layer
        one = WeldPass(bead, "", 0.0, end)
        planned, expected = plan_pass(whole, one, there), alone.next_bead()
        np.testing.assert_allclose(planned.area, expected.area, rtol=1e-2)
        np.testing.assert_allclose(planned.tip, expected.tip, atol=0.05e-3)
        whole.after_bead(planned, planned.area, part=one.part_of(there, 1e-6))
        alone.after_bead(planned, planned.area)


def test_beads_weave_by_the_metal_that_a_closing_groove_takes() -> None:
    p3, p4, g, p2 = corners = np.array(((-1e-3, 0.0), (1e-3, 0.0), (9e-3, 14e-3), (-10e-3, 18e-3)))
    u = np.arange(-25e-3, 25e-3, 0.25e-3)
    leg, wall = g + 2 * (g - p4), p2 + np.array((-20e-3, 5e-3))
    w = np.interp(u, *np.array((wall, p2, p3, p4, leg)).T)
    state = WeldState.of_groove(np.zeros(1), u, w[None], np.array(((p2[0], g[0]),)), np.zeros(1))
    metal = area_that_closing_leaves(corners[None], WPS)
    cap = replace(ORDER, cap_height=WPS.bead.cap_height)
    assert metal == pytest.approx(WeldPlanner(state, cap, WPS).total, rel=0.02)


def test_passes_stay_where_their_station_looks() -> None:
    edges = ring()
    stretches = two_stretches(edges, 0.15)
    reach = {one.station: one for one in stretches}
    for one in passes_of_weld(ORDER, edges, WPS, stretches):
        there, turn = reach[one.station], edges.length
        least = min(abs(one.begin - there.begin - k * turn) for k in (-1, 0, 1))
        assert least > 0.99 * STRETCH_MARGIN
        at = (one.begin - there.begin) % turn
        assert at + one.end - one.begin < there.end - there.begin - 0.99 * STRETCH_MARGIN


def test_groove_that_no_station_scanned_all_of_is_refused() -> None:
    edges = ring()
    with pytest.raises(ConfigurationError, match="no station scanned the groove from"):
        passes_of_weld(ORDER, edges, WPS, two_stretches(edges, 0.01))


def test_stretch_of_a_station_goes_on_over_the_start_of_the_groove() -> None:
    edges = ring()
    seen = np.zeros(48, dtype=bool)
    seen[:5] = seen[40:] = True
    begin, end = _stretch_of_sections(edges, seen)
    assert (begin, end) == pytest.approx(
        (edges.sections[40], edges.length + edges.sections[4]), abs=1e-12
    )
    s = np.linspace(0.0, edges.length, 101)[:-1]
    part = _part_of_groove(s, edges, begin, end)
    assert (np.diff(part.s) > 0).all()
    assert part.s == pytest.approx(s[part.rows] + edges.length * (part.rows < 50))
    assert (begin <= part.s[0]) & (part.s[-1] <= end)
