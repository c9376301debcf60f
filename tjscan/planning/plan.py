"""The plan: zones of constant bead count, their beads in order, and what is out of the WPS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.bead import PlannedBead
from tjscan.planning.edges import GrooveEdges, RootAlongGroove, RootKind, Span
from tjscan.planning.findings import (
    WpsFinding,
    findings_of_bead,
    findings_of_root,
    findings_of_stops,
)
from tjscan.planning.lay import lay_layer, sampling_step
from tjscan.planning.path import LONGEST_STEP, stations_at, template_at
from tjscan.planning.stops import StationStretch, StopPlacement
from tjscan.planning.topology import Arrangement, NoArrangementFits, arrange_beads
from tjscan.planning.wps import WeldingProcedure


@dataclass(frozen=True, slots=True)
class PlannedZone:
    """A length of groove with one arrangement of beads.

    Parameters
    ----------
    begin, end : float
        Lengths along the groove, metres.
    arrangement : Arrangement
        Its layers and beads.
    """

    begin: float
    end: float
    arrangement: Arrangement


@dataclass(frozen=True, slots=True, eq=False)
class WeldPlan:
    """Beads of a groove in the order of welding.

    Parameters
    ----------
    edges : GrooveEdges
        The smoothed groove.
    wps : WeldingProcedure
        What it was planned after.
    gravity : ndarray, shape (3,)
        Unit vector downwards in the frame of the sections.
    zones : tuple of PlannedZone
        One if one number of beads fits everywhere.
    beads : tuple of PlannedBead
        In the order of welding; a bead that stations share, or that tacks interrupt, is listed in
        parts of one number.
    findings : tuple of WpsFinding
        What is out of the WPS, and where.
    after_pass : int
        Passes that were welded before the sections were measured.
    """

    edges: GrooveEdges
    wps: WeldingProcedure
    gravity: Array
    zones: tuple[PlannedZone, ...]
    beads: tuple[PlannedBead, ...]
    findings: tuple[WpsFinding, ...]
    after_pass: int = 0

    @property
    def arc_time(self) -> float:
        """Seconds with the arc on."""
        return sum(bead.arc_time for bead in self.beads)

    @property
    def volume(self) -> float:
        """Laid down, m³."""
        return sum(bead.volume for bead in self.beads)

    @property
    def wire_mass(self) -> float:
        """Wire that is molten, kg."""
        wire = self.wps.wire
        return self.volume / wire.deposition_efficiency * wire.density

    @property
    def wire_length(self) -> float:
        """Wire that is fed, metres."""
        return sum(bead.arc_time * bead.feed for bead in self.beads)

    @property
    def gas_volume(self) -> float:
        """Shielding gas while the arc is on, m³."""
        return self.arc_time * self.wps.arc.gas_flow


def plan_weld(
    edges: GrooveEdges,
    wps: WeldingProcedure,
    gravity: Array,
    landmarks: Array | tuple[float, ...] = (),
    stretches: tuple[StationStretch, ...] = (),
    after_pass: int = 0,
) -> WeldPlan:
    """Plan the beads of a groove.

    Parameters
    ----------
    edges : GrooveEdges
        The smoothed groove.
    wps : WeldingProcedure
        Windows and values.
    gravity : ndarray, shape (3,)
        Downwards in the frame of the sections, of any length above zero.
    landmarks : array_like, shape (k,)
        Crowns and saddles, metres along the groove, from which starts and stops are kept.
    stretches : tuple of StationStretch
        What each station reaches, in the order in which they weld: beads are parted among them.
    after_pass : int
        Passes that were welded before the sections were measured: then no root bead is laid, and
        beads are numbered from there on.

    Raises
    ------
    ConfigurationError
        If nothing fits at some place, or the groove is too short for its starts.
    """
    size = float(np.linalg.norm(gravity))
    if not np.isfinite(size) or size == 0:
        raise ConfigurationError("must be a direction, not zero", key="--gravity")
    gravity = gravity / size
    check_passes_are_there(edges.root, after_pass)
    zones = _zones(edges, wps, after_pass)
    borders = [(zone.begin, zone.end) for zone in zones]
    stops = StopPlacement(
        edges.length, edges.closed, wps.sequence, np.array(landmarks, dtype=float), stretches
    )
    beads, last = list[PlannedBead](), after_pass
    for number, zone in enumerate(zones, start=1):
        step = sampling_step(edges, zone.begin, zone.end, zone.arrangement, wps)
        layers = len(zone.arrangement.counts)
        for layer, spans in enumerate(stops.spans(borders, number - 1, layers)):
            over_tacks = layer == 0 and after_pass == 0
            laid = []
            for span in spans:
                way = span.begin, span.end
                skipped = spans_to_skip(edges.root, way, wps) if over_tacks else ()
                ends = [end for part in skipped for end in part]
                done = lay_layer(edges, zone.arrangement, layer, way, step, wps, gravity, ends)
                laid.append([without_spans(bead, skipped) for bead in done])
            for parts in zip(*laid, strict=True):
                last += 1
                whose = [
                    (piece, span.station)
                    for pieces, span in zip(parts, spans, strict=True)
                    for piece in pieces
                ]
                beads += [
                    replace(piece, number=last, part=part, zone=number, station=station)
                    for part, (piece, station) in enumerate(whose, start=1)
                ]
    found = (
        *(finding for bead in beads for finding in findings_of_bead(bead, wps)),
        *findings_of_stops(beads, stops, wps),
        *(findings_of_root(edges, wps) if after_pass == 0 else ()),
    )
    return WeldPlan(edges, wps, gravity, zones, tuple(beads), found, after_pass)


def _zones(edges: GrooveEdges, wps: WeldingProcedure, after_pass: int) -> tuple[PlannedZone, ...]:
    """One zone if one arrangement fits all of the groove; else the longest that fit, in turn.

    Of a groove that closes, from the place on at which the zone about its smallest section ends:
    begun anywhere else, one zone would be cut in two.
    """
    zones = _zones_from(0.0, edges, wps, after_pass)
    if edges.closed and len(zones) > 1:
        s = np.linspace(0.0, edges.length, ceil(edges.length / LONGEST_STEP) + 1)
        smallest = float(s[np.argmin(template_at(stations_at(edges, s), 0.0).area)])
        around = _zones_from(smallest, edges, wps, after_pass)[0].end % edges.length
        zones = _zones_from(around, edges, wps, after_pass)
    return zones


def _zones_from(
    begin: float, edges: GrooveEdges, wps: WeldingProcedure, after_pass: int
) -> tuple[PlannedZone, ...]:
    end = ceil(edges.length / LONGEST_STEP)
    over = ceil(wps.sequence.overlap / edges.length * end)
    count = end + 1 + over * edges.closed
    s: Array = begin + edges.length / end * np.arange(count, dtype=np.float64)
    root_area = wps.root.penetration * edges.root_opening(s)
    stations = stations_at(edges, s)
    template = template_at(stations, wps.bead.cap_height, root_area)

    def fit(first: int, last: int) -> Arrangement:
        # A bead laps over the zone that follows: it has to fit there, too.
        if last < end or (edges.closed and first > 0):
            last = min(last + over, len(s) - 1)
        root: RootKind = "welded" if after_pass else "closed"
        turns = (0.0, edges.length) if s[last] > edges.length else (0.0,)
        ends = [(s[first] - turn, s[last] - turn) for turn in turns]
        if not after_pass and any(edges.root.is_open_between(*one) for one in ends):
            root = "open"
        return arrange_beads(template.part(first, last), stations.part(first, last), wps, root)

    found: list[PlannedZone] = []
    first = 0
    while first < end:
        fits, fails = first, end + 1
        arrangement: Arrangement | None = None
        last = end
        while fails - fits > 1 or arrangement is None:
            try:
                arrangement, fits = fit(first, last), last
            except NoArrangementFits as problem:
                if last - first <= 1:
                    where = f"at s = {1e3 * s[first]:.0f} mm"
                    raise ConfigurationError(
                        f"{where}: {problem.message}", key=problem.key
                    ) from None
                fails = last
            last = max(first + 1, (fits + fails) // 2)
        found.append(PlannedZone(float(s[first]), float(s[fits]), arrangement))
        first = fits
    return tuple(found)


def check_passes_are_there(root: RootAlongGroove, after_pass: int) -> None:
    """Refuse sections that show no weld where passes were welded.

    Raises
    ------
    ConfigurationError
        If the root is open somewhere.
    """
    if after_pass > 0 and (root.openness > 0).any():
        at = 1e3 * root.s[int(np.argmax(root.openness > 0))]
        raise ConfigurationError(
            f"at s = {at:.0f} mm the sections show an open root: was it scanned before the first "
            "pass?",
            key="--after-pass",
        )


def spans_to_skip(root: RootAlongGroove, span: Span, wps: WeldingProcedure) -> tuple[Span, ...]:
    """Parts of a bead's path over which it is not laid because of tacks; metres.

    It ends `overlap` on each tack, and goes on as much before its end.

    Parameters
    ----------
    root : RootAlongGroove
        Where tacks are.
    span : tuple of float
        Begin and end of the bead along the groove; beyond its length if it closes.
    wps : WeldingProcedure
        Whether tacks are skipped.
    """
    if wps.root.tacks == "fuse":
        return ()
    turns = (-root.length, 0.0, root.length) if root.closed else (0.0,)
    over = wps.sequence.overlap
    inner = [(a + over, b - over) for a, b in root.tack_spans(wps.root.tack_length)]
    shifted = [(max(a + t, span[0]), min(b + t, span[1])) for t in turns for a, b in inner]
    return tuple(sorted((a, b) for a, b in shifted if b > a))


def without_spans(bead: PlannedBead, spans: Sequence[Span]) -> tuple[PlannedBead, ...]:
    """A bead in parts, without some spans at whose ends it has points."""
    middles = 0.5 * (bead.s[1:] + bead.s[:-1])
    laid = np.ones(len(middles), dtype=bool)
    for a, b in spans:
        laid &= (middles < a) | (middles > b)
    changes = np.flatnonzero(np.diff(np.concatenate(((False,), laid, (False,))).astype(int)))
    return bead.cut([(int(a), int(b)) for a, b in zip(changes[::2], changes[1::2], strict=True)])
