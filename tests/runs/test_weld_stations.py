"""A weld from several stations: who lays what, and that nothing is left out where they meet."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pytest

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.edges import GrooveEdges, fit_edges_to_corners
from tjscan.planning.stops import StationStretch
from tjscan.planning.wps import read_wps
from tjscan.runs.weld.beads import BORDER_STEP, STRETCH_MARGIN, WeldPass, passes_of_weld
from tjscan.runs.weld.stations import _part_of_groove, _stretch_of_sections
from tjscan.welding.replan import BeadOrder

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
    stations = [[one.station for one in passes if layers[one.bead] == k] for k in range(4)]
    assert stations[1] == ["right", "right", "left", "left"]  # who has laid a layer begins the next
    assert stations[2] == ["left"] * 3 + ["right"] * 3
    assert np.abs(np.diff(borders)).min() > 0.4 * BORDER_STEP


def test_passes_stay_where_their_station_looks() -> None:
    edges = ring()
    stretches = two_stretches(edges, 0.15)
    reach = {one.station: one for one in stretches}
    for one in passes_of_weld(ORDER, edges, WPS, stretches):
        there, turn = reach[one.station], edges.length
        least = min(abs(one.begin - there.begin - k * turn) for k in (-1, 0, 1))
        assert least > 0.4 * STRETCH_MARGIN
        at = (one.begin - there.begin) % turn
        assert at + one.end - one.begin < there.end - there.begin - 0.4 * STRETCH_MARGIN


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
