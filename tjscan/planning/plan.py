"""The plan: zones of constant bead count, their beads in order, and what is out of the WPS."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import ceil

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, Mask, stretches_of_true_values
from tjscan.core.units import M_PER_MIN, MM2, FileUnit
from tjscan.planning.edges import GrooveEdges, RootAlongGroove, RootKind, Span
from tjscan.planning.lay import ArrangedGroove, PlannedBead
from tjscan.planning.path import LONGEST_STATION_STEP, cut_groove_stations, map_template_onto
from tjscan.planning.stops import SHORTEST_SPAN, StationStretch, StopPlacement
from tjscan.planning.topology import LIMIT_TOLERANCE, Arrangement, BeadArranger, NoArrangementFits
from tjscan.planning.wps import KJ_PER_MM, MM_PER_MIN, WeldingProcedure


@dataclass(frozen=True, slots=True)
class WpsFinding:
    """Something of a bead that is out of the WPS.

    Parameters
    ----------
    key : str
        Of the WPS.
    bead : int
        Number of the bead.
    begin, end : float
        First and last length along the groove that are out, metres.
    share : float
        Of the bead's points.
    text : str
        What was planned, and what the WPS allows.
    """

    key: str
    bead: int
    begin: float
    end: float
    share: float
    text: str


def number_beside(value: float, *limits: float) -> str:
    """A number, rounded so that it stays on the side of each limit that it is on."""
    for digits in range(3, 18):
        text = f"{value:.{digits}g}"
        rounded = float(text)
        if all(
            (rounded > one) == (value > one) and (rounded < one) == (value < one) for one in limits
        ):
            break
    return text


def span_beside(least: float, most: float, *limits: float) -> str:
    """Two numbers from where to where, each as `number_beside` has it."""
    return f"{number_beside(least, *limits)} to {number_beside(most, *limits)}"


def findings_of_bead(bead: PlannedBead, wps: WeldingProcedure) -> Iterator[WpsFinding]:
    """What of a bead is out of the WPS.

    Parameters
    ----------
    bead : PlannedBead
        The bead.
    wps : WeldingProcedure
        Its windows.
    """
    table, limits = wps.limits_of_bead(open_root=bead.open_root)
    checks: tuple[tuple[str, FileUnit, Array, tuple[float, float]], ...] = (
        (f"{table}.wire_feed", M_PER_MIN, bead.feed, limits.wire_feed),
        (f"{table}.travel_speed", MM_PER_MIN, bead.speed, limits.travel_speed),
        (f"{table}.heat_input", KJ_PER_MM, bead.heat, limits.heat_input),
        (f"bead.{bead.kind}_area", MM2, bead.area, getattr(wps.bead, f"{bead.kind}_area")),
    )
    for name, unit, values, (low, high) in checks:
        out = (values < low * (1 - LIMIT_TOLERANCE)) | (values > high * (1 + LIMIT_TOLERANCE))
        low, high, *found = (x / unit.factor for x in (low, high, values.min(), values.max()))
        text = f"{span_beside(*found, low, high)}, allowed {low:g} to {high:g}"
        yield from _findings_at(bead, f"{name}_{unit.suffix}", out, text)
    out = bead.width > wps.bead.weave_limit * (1 + LIMIT_TOLERANCE)
    limit = 1e3 * wps.bead.weave_limit
    text = f"{number_beside(1e3 * bead.width.max(), limit)} wide, allowed {limit:g}"
    yield from _findings_at(bead, "bead.weave_limit_mm", out, text)
    out = ~np.isin(bead.positions, wps.sequence.positions)
    names = sorted(set(np.array(bead.positions)[out].tolist()))
    text = f"{', '.join(names)}, allowed {', '.join(wps.sequence.positions)}"
    yield from _findings_at(bead, "sequence.positions", out, text)


def findings_of_stops(
    beads: Sequence[PlannedBead], stops: StopPlacement, wps: WeldingProcedure
) -> Iterator[WpsFinding]:
    """What of starts and stops is out of the WPS: too near, unspread, or a bead too short.

    The ends of a groove that does not close are where they are.

    Parameters
    ----------
    beads : sequence of PlannedBead
        In the order of welding.
    stops : StopPlacement
        Where crowns and saddles are.
    wps : WeldingProcedure
        Its windows.
    """
    spread, apart = wps.sequence.start_spread, 1e3 * wps.sequence.start_spread
    clear = 1e3 * wps.sequence.stop_distance
    seen: dict[tuple[int, str, int, int], list[float]] = {}
    for bead in beads:
        if bead.length < wps.sequence.shortest_bead * (1 - LIMIT_TOLERANCE):
            least = 1e3 * wps.sequence.shortest_bead
            text = f"{number_beside(1e3 * bead.length, least)}, allowed {least:g} or more"
            whole = np.ones(len(bead.s), dtype=bool)
            yield from _findings_at(bead, "sequence.shortest_bead_mm", whole, text)
        for end, at in enumerate((float(bead.s.min()), float(bead.s.max()))):
            seen.setdefault((bead.zone, bead.station, end, bead.layer), []).append(at)
            if stops.is_at_open_end(at):
                continue
            near = stops.distance_to_nearest_landmark(at)
            if near < wps.sequence.stop_distance - SHORTEST_SPAN:
                text = f"a stop {number_beside(1e3 * near, clear)} from crown or saddle"
                yield from _findings_at(bead, "sequence.stop_distance_mm", bead.s == at, text)
            if len(seen[bead.zone, bead.station, end, bead.layer]) > 1:
                continue  # the beads of a layer start and stop together
            below = seen.get((bead.zone, bead.station, end, bead.layer - 1), [])
            away = min((stops.length_between(at, other) for other in below), default=spread)
            if away < spread - SHORTEST_SPAN:
                gone = number_beside(1e3 * away, apart)
                text = f"a stop {gone} from that of the layer below, {apart:g} asked for"
                yield from _findings_at(bead, "sequence.start_spread_mm", bead.s == at, text)


def findings_of_root(edges: GrooveEdges, wps: WeldingProcedure) -> Iterator[WpsFinding]:
    """Where an open root is narrower or wider than the WPS allows: bead 1 is laid over it.

    Parameters
    ----------
    edges : GrooveEdges
        The groove; its sections show whether its root is open.
    wps : WeldingProcedure
        The window of the root opening.
    """
    low, high = wps.root.opening
    root = edges.root
    opening, open_at = edges.root_opening(root.s), root.openness == 1
    out = open_at & ((opening < low) | (opening > high))
    if out.any():
        at, widths = root.s[out], 1e3 * opening[out]
        ends, share = (float(at.min()), float(at.max())), float(out.sum() / open_at.sum())
        low, high = 1e3 * low, 1e3 * high
        text = f"{span_beside(widths.min(), widths.max(), low, high)}, allowed {low:g} to {high:g}"
        yield WpsFinding("root.opening_mm", 1, *ends, share, text)


def _findings_at(bead: PlannedBead, key: str, out: Mask, text: str) -> Iterator[WpsFinding]:
    """The finding of a bead at its points that are out; none if all are in."""
    if out.any():
        at = bead.s[out]
        ends = float(at.min()), float(at.max())
        yield WpsFinding(key, bead.number, *ends, float(out.mean()), text)


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
        return sum(bead.wire_length for bead in self.beads)

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
    check_root_is_welded(edges.root, after_pass)
    zones = _fit_zones(edges, wps, after_pass)
    borders = [(zone.begin, zone.end) for zone in zones]
    stops = StopPlacement(
        edges.length, edges.closed, wps.sequence, np.array(landmarks, dtype=float), stretches
    )
    beads, last = list[PlannedBead](), after_pass
    for number, zone in enumerate(zones, start=1):
        groove = ArrangedGroove(edges, zone.arrangement, wps)
        step = groove.sampling_step(zone.begin, zone.end)
        layers = len(zone.arrangement.counts)
        for layer, spans in enumerate(stops.spans(borders, number - 1, layers)):
            over_tacks = layer == 0 and after_pass == 0
            laid = []
            for span in spans:
                skipped = tack_spans_to_skip(edges.root, span, wps) if over_tacks else ()
                ends = [*(end for part in skipped for end in part), *_ends_of_ramps(span, wps)]
                done = groove.lay_layer(layer, span, step, gravity, ends)
                laid.append([bead_parts_outside_spans(bead, skipped) for bead in done])
            in_layer = list[PlannedBead]()
            for parts_by_span in zip(*laid, strict=True):
                last += 1
                for part, bead in enumerate(chain.from_iterable(parts_by_span), start=1):
                    begun = bead.with_start_and_stop(wps)
                    in_layer.append(replace(begun, number=last, part=part, zone=number))
            order = [span.station for span in spans]  # each welds its part before the next one
            beads += sorted(in_layer, key=lambda bead: order.index(bead.station))
    found = (
        *(finding for bead in beads for finding in findings_of_bead(bead, wps)),
        *findings_of_stops(beads, stops, wps),
        *(findings_of_root(edges, wps) if after_pass == 0 else ()),
    )
    return WeldPlan(edges, wps, gravity, zones, tuple(beads), found, after_pass)


def _fit_zones(
    edges: GrooveEdges, wps: WeldingProcedure, after_pass: int
) -> tuple[PlannedZone, ...]:
    """One zone if one arrangement fits all of the groove; else the longest that fit, in turn.

    Of a groove that closes, from the place on at which the zone about its smallest section ends:
    begun anywhere else, one zone would be cut in two.
    """
    zones = _fit_zones_from(0.0, edges, wps, after_pass)
    if edges.closed and len(zones) > 1:
        s = np.linspace(0.0, edges.length, ceil(edges.length / LONGEST_STATION_STEP) + 1)
        smallest = float(s[np.argmin(map_template_onto(cut_groove_stations(edges, s), 0.0).area)])
        around = _fit_zones_from(smallest, edges, wps, after_pass)[0].end % edges.length
        zones = _fit_zones_from(around, edges, wps, after_pass)
    return zones


def _fit_zones_from(
    begin: float, edges: GrooveEdges, wps: WeldingProcedure, after_pass: int
) -> tuple[PlannedZone, ...]:
    end = ceil(edges.length / LONGEST_STATION_STEP)
    over = ceil(wps.sequence.overlap / edges.length * end)
    count = end + 1 + over * edges.closed
    s: Array = begin + edges.length / end * np.arange(count, dtype=np.float64)
    root_area = wps.root.penetration * edges.root_opening(s)
    stations = cut_groove_stations(edges, s)
    template = map_template_onto(stations, wps.bead.cap_height, root_area)

    def fit(first: int, last: int) -> Arrangement:
        # A bead laps over the zone that follows: it has to fit there, too.
        if last < end or (edges.closed and first > 0):
            last = min(last + over, len(s) - 1)
        root: RootKind = "welded" if after_pass else "closed"
        turns = (0.0, edges.length) if s[last] > edges.length else (0.0,)
        ends = [(s[first] - turn, s[last] - turn) for turn in turns]
        if not after_pass and any(edges.root.is_open_between(*one) for one in ends):
            root = "open"
        parts = template.part(first, last), stations.part(first, last)
        return BeadArranger(*parts, wps, root).find_best_arrangement()

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
                    reason = f"at s = {1e3 * s[first]:.0f} mm: {problem.message}"
                    raise ConfigurationError(reason, key=problem.key) from None
                fails = last
            last = max(first + 1, (fits + fails) // 2)
        found.append(PlannedZone(float(s[first]), float(s[fits]), arrangement))
        first = fits
    return tuple(found)


def _ends_of_ramps(span: StationStretch, wps: WeldingProcedure) -> tuple[float, ...]:
    """Where along a span its run-in ends and its crater begins, metres."""
    if wps.start_stop is None:
        return ()
    lengths = wps.start_stop.run_in, wps.start_stop.crater
    first, last = lengths[::-1] if wps.sequence.reverse else lengths
    inside = span.begin + first, span.end - last
    return inside if inside[0] < inside[1] else ()


def check_root_is_welded(root: RootAlongGroove, after_pass: int) -> None:
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


def tack_spans_to_skip(
    root: RootAlongGroove, stretch: StationStretch, wps: WeldingProcedure
) -> tuple[Span, ...]:
    """Parts of a bead's path over which it is not laid because of tacks; metres.

    It ends `overlap` on each tack, and goes on as much before its end.

    Parameters
    ----------
    root : RootAlongGroove
        Where tacks are.
    stretch : StationStretch
        The bead's length of groove.
    wps : WeldingProcedure
        Whether tacks are skipped.
    """
    if wps.root.tacks == "fuse":
        return ()
    turns = (-root.length, 0.0, root.length) if root.closed else (0.0,)
    over = wps.sequence.overlap
    inner = [(a + over, b - over) for a, b in root.tack_spans(wps.root.tack_length)]
    begin, end = stretch.begin, stretch.end
    shifted = [(max(a + t, begin), min(b + t, end)) for t in turns for a, b in inner]
    return tuple(sorted((a, b) for a, b in shifted if b > a))


def bead_parts_outside_spans(bead: PlannedBead, spans: Sequence[Span]) -> tuple[PlannedBead, ...]:
    """A bead in parts, without some spans at whose ends it has points."""
    middles = 0.5 * (bead.s[1:] + bead.s[:-1])
    laid = np.ones(len(middles), dtype=bool)
    for a, b in spans:
        laid &= (middles < a) | (middles > b)
    starts, stops = stretches_of_true_values(laid)
    return bead.cut(list(zip(starts.tolist(), stops.tolist(), strict=True)))
