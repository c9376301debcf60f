"""Where beads start and stop: spread from layer to layer, and divided among stations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, transform_points
from tjscan.planning.edges import GrooveEdges, Span
from tjscan.planning.path import LONGEST_STATION_STEP
from tjscan.planning.wps import SequenceSettings

UNREACHED_STATION: Final = ""
"""Name of the station of a length that none reaches, and of all if no stations are named."""

SHORTEST_SPAN: Final = 1e-6
"""Metres: a shorter span is none."""


@dataclass(frozen=True, slots=True)
class StationStretch:
    """Length of groove that a station welds, or can weld.

    Parameters
    ----------
    station : str
        Its name.
    begin, end : float
        Metres along the groove; beyond its length if it closes and the stretch passes its start.
    """

    station: str
    begin: float
    end: float


def crowns_and_saddles(edges: GrooveEdges, T_j_r: Array) -> Array:
    """Where the groove passes the crowns and saddles of a tubular joint, metres along it.

    Parameters
    ----------
    edges : GrooveEdges
        The groove, in frame r.
    T_j_r : ndarray, shape (4, 4)
        Frame r in frame j, whose z is the brace's axis and whose x is in the plane of both.
    """
    s = np.linspace(0.0, edges.length, ceil(edges.length / LONGEST_STATION_STEP) + 1)
    x, y, _ = transform_points(T_j_r, edges.corners(s)[:, 0]).T
    azimuth = np.unwrap(np.arctan2(y, x))
    if azimuth[-1] < azimuth[0]:
        azimuth = -azimuth
    first, last = azimuth[0] / (0.5 * np.pi), azimuth[-1] / (0.5 * np.pi)
    quarters = 0.5 * np.pi * np.arange(ceil(first - 1e-9), floor(last + 1e-9) + 1)
    found = np.interp(quarters, azimuth, s)
    if edges.closed:
        found = np.unique(np.round(np.mod(found, edges.length), 9))
    return np.asarray(found)


@dataclass(frozen=True, slots=True, eq=False)
class StopPlacement:
    """Places the starts and stops of beads.

    Parameters
    ----------
    length : float
        Of the groove, metres.
    closed : bool
        Whether it closes.
    sequence : SequenceSettings
        The WPS's table of starts and stops.
    landmarks : ndarray, shape (k,)
        Crowns and saddles, metres along the groove; none if they are not known.
    stretches : tuple of StationStretch
        What stations reach, in the order in which these weld: one has laid all of its beads before
        the next begins. Empty if there is only one place to weld from.
    """

    length: float
    closed: bool
    sequence: SequenceSettings
    landmarks: Array
    stretches: tuple[StationStretch, ...] = ()

    def spans(
        self, zones: Sequence[Span], zone: int, layers: int
    ) -> list[tuple[StationStretch, ...]]:
        """Spans of the beads of each layer of a zone, in the order of the stations.

        Parameters
        ----------
        zones : sequence of (float, float)
            Lengths of groove with one arrangement of beads, metres, in their order.
        zone : int
            Which.
        layers : int
            How many it has.

        Raises
        ------
        ConfigurationError
            If the groove is too short for a layer.
        """
        whole = self.closed and len(zones) == 1
        links = self._choose_station_chain(zones[0][0])
        seams = self._place_seams(links, layers, whole=whole)
        found = []
        for layer in range(layers):
            spans = []
            for i, link in enumerate(links):
                begin, end, goes_on = self._link_span(seams[:, layer], i, layer)
                parts = [(begin, end)] if whole else self._parts_in_zone(zones[zone], begin, end)
                for low, high in parts:
                    over = self.sequence.overlap if goes_on or high < end - SHORTEST_SPAN else 0.0
                    spans.append(StationStretch(link.station, low, high + over))
            if not spans:
                raise ConfigurationError(
                    f"layer {layer + 1} would have no length: the groove is too short for it",
                    key="sequence.start_spread_mm",
                )
            spans.sort(key=lambda one: (self._station_rank(one.station), one.begin))
            found.append(tuple(spans))
        return found

    def is_at_open_end(self, s: float) -> bool:
        """Whether an end of a groove that does not close is at s: a stop there can't be moved.

        Of a cascade it is the lowest layer's alone.
        """
        return not self.closed and min(abs(s), abs(s - self.length)) < SHORTEST_SPAN

    def length_between(self, a: float, b: float) -> float:
        """Length of groove between two places, the shorter way round, metres."""
        if not self.closed:
            return abs(a - b)
        return abs((a - b + 0.5 * self.length) % self.length - 0.5 * self.length)

    def distance_to_nearest_landmark(self, s: float) -> float:
        """Length of groove to the nearest crown or saddle, metres; infinite without any."""
        return min((self.length_between(s, float(mark)) for mark in self.landmarks), default=np.inf)

    def _station_rank(self, station: str) -> int:
        """Which of the stations it is, in the order of welding; those that are none come last."""
        order = [stretch.station for stretch in self.stretches]
        return order.index(station) if station in order else len(order)

    def _link_span(self, seams: Array, i: int, layer: int) -> tuple[float, float, bool]:
        """Span of link i without overlap, and whether another one follows."""
        if self.closed:
            return float(seams[i - 1]) - self.length * (i == 0), float(seams[i]), True
        back = layer * self.sequence.start_spread * (self.sequence.ends == "cascade")
        begin = back if i == 0 else float(seams[i - 1])
        goes_on = i < len(seams)
        return begin, float(seams[i]) if goes_on else self.length - back, goes_on

    def _parts_in_zone(self, zone: Span, begin: float, end: float) -> list[Span]:
        """Parts of a span in a zone, which recurs with every turn if the groove closes."""
        turns = range(-1, 3) if self.closed else range(1)
        parts = [
            (max(begin, zone[0] + k * self.length), min(end, zone[1] + k * self.length))
            for k in turns
        ]
        return [part for part in parts if part[1] - part[0] > SHORTEST_SPAN]

    def _place_seams(self, links: Sequence[StationStretch], layers: int, *, whole: bool) -> Array:
        """Where each link ends and the next begins, shape (seams, layers), metres."""
        overlap, seams = self.sequence.overlap, []
        for i in range(len(links) if self.closed else len(links) - 1):
            a, b = links[i], links[(i + 1) % len(links)]
            turn = self.length * (i + 1 == len(links))
            if len(links) == 1 and not whole:
                seams.append(np.full(layers, a.begin + self.length))  # zones begin and end anyway
            elif len(links) > 1 and UNREACHED_STATION in (a.station, b.station):
                seams.append(np.full(layers, b.begin + turn))
            else:
                window = (b.begin + turn, a.end - overlap)
                falls = self._station_rank(a.station) < self._station_rank(b.station)
                seams.append(self._place_stops(window, layers, falls=falls))
        return np.array(seams).reshape(-1, layers)

    def _place_stops(self, window: Span, layers: int, *, falls: bool) -> Array:
        """Places of the stops of each layer in a window, each further on than the one below.

        Spread and kept from the landmarks; without room for that, spread alone; without room for
        that either, evenly over the window.
        """
        sign = -1.0 if falls else 1.0
        begin, end = (window[1], window[0]) if falls else window
        for distance in (self.sequence.stop_distance, 0.0):
            at, found = begin, []
            for _ in range(layers):
                at = self._move_off_landmarks(at, sign, distance)
                found.append(at)
                at += sign * self.sequence.start_spread
            if sign * (end - found[-1]) >= -SHORTEST_SPAN:
                return np.array(found)
        return np.linspace(begin, end, layers)

    def _move_off_landmarks(self, at: float, sign: float, distance: float) -> float:
        """The first place from one on that is far enough from all landmarks."""
        marks = self.landmarks
        if self.closed:
            marks = (marks[:, None] + self.length * np.arange(-2, 4)).ravel()
        for mark in sorted(marks, key=lambda mark: sign * mark):
            if abs(at - mark) < distance - SHORTEST_SPAN:
                at = float(mark + sign * distance)
        return at

    def _choose_station_chain(self, begin: float) -> tuple[StationStretch, ...]:
        """Stretches that follow one another over the whole groove from its first zone on.

        Gaps belong to no station.

        Of a groove that closes, from the stretch on that leaves the shortest gaps, with the fewest
        stations.
        """
        if not self.stretches:
            end = begin + (3 * self.length if self.closed else self.length)
            return (StationStretch(UNREACHED_STATION, begin, end + self.sequence.overlap),)
        if not self.closed:
            return self._chain_stretches(0.0, self.stretches)
        turned = tuple(
            StationStretch(one.station, one.begin + k * self.length, one.end + k * self.length)
            for k in (-1, 0, 1)
            for one in self.stretches
        )
        chains = [self._chain_stretches(one.begin, turned) for one in self.stretches]

        def gaps_and_count(chain: tuple[StationStretch, ...]) -> tuple[float, int]:
            gaps = sum(link.end - link.begin for link in chain if link.station == UNREACHED_STATION)
            return round(gaps, 6), len(chain)

        return min(chains, key=gaps_and_count)

    def _chain_stretches(
        self, begin: float, stretches: Sequence[StationStretch]
    ) -> tuple[StationStretch, ...]:
        end, at, links = begin + self.length, begin, list[StationStretch]()
        overlap = self.sequence.overlap
        while at < end - SHORTEST_SPAN:
            follow = [one for one in stretches if one.begin <= at + SHORTEST_SPAN and one.end > at]
            best = max(follow, key=lambda one: one.end, default=None)
            if best is not None and best.end - overlap > at + SHORTEST_SPAN:
                links.append(best)
                last = end if not self.closed else end + overlap
                at = end if best.end >= last - SHORTEST_SPAN else best.end - overlap
                continue
            later = [one.begin for one in stretches if one.begin > at + SHORTEST_SPAN]
            follows = min([*later, end])
            links.append(StationStretch(UNREACHED_STATION, at, follows))
            at = follows
        return tuple(links)
