"""Findings: what of a planned bead is out of the WPS, and where along the groove."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.core.units import MM2, FileUnit
from tjscan.planning.bead import PlannedBead
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.stops import NO_LENGTH, StopPlacement
from tjscan.planning.wps import KJ_MM, M_MIN, MM_MIN, WeldingProcedure

LIMIT_TOLERANCE: Final = 1e-9
"""Share of a limit by which a number may pass it: they are computed, not measured."""


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


def findings_of_bead(bead: PlannedBead, wps: WeldingProcedure) -> Iterator[WpsFinding]:
    """What of a bead is out of the WPS.

    Parameters
    ----------
    bead : PlannedBead
        The bead.
    wps : WeldingProcedure
        Its windows.
    """
    table, limits = wps.limits(open_root=bead.open_root)
    checks: tuple[tuple[str, FileUnit, Array, tuple[float, float]], ...] = (
        (f"{table}.wire_feed", M_MIN, np.full_like(bead.speed, bead.feed), limits.wire_feed),
        (f"{table}.travel_speed", MM_MIN, bead.speed, limits.travel_speed),
        (f"{table}.heat_input", KJ_MM, bead.heat, limits.heat_input),
        (f"bead.{bead.kind}_area", MM2, bead.area, getattr(wps.bead, f"{bead.kind}_area")),
    )
    for name, unit, values, (low, high) in checks:
        out = (values < low * (1 - LIMIT_TOLERANCE)) | (values > high * (1 + LIMIT_TOLERANCE))
        if out.any():
            low, high, least, most = (
                x / unit.factor for x in (low, high, values.min(), values.max())
            )
            yield _finding(
                bead,
                f"{name}_{unit.suffix}",
                out,
                f"{least:.4g} to {most:.4g}, allowed {low:g} to {high:g}",
            )
    out = bead.width > wps.bead.weave_limit * (1 + LIMIT_TOLERANCE)
    if out.any():
        widest, limit = 1e3 * bead.width.max(), 1e3 * wps.bead.weave_limit
        yield _finding(bead, "bead.weave_limit_mm", out, f"{widest:.1f} wide, allowed {limit:g}")
    out = ~np.isin(bead.positions, wps.sequence.positions)
    if out.any():
        names = sorted(set(np.array(bead.positions)[out].tolist()))
        allowed = ", ".join(wps.sequence.positions)
        yield _finding(bead, "sequence.positions", out, f"{', '.join(names)}, allowed {allowed}")


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
    seen: dict[tuple[int, str, int, int], list[float]] = {}
    for bead in beads:
        if bead.length < wps.sequence.shortest_bead * (1 - LIMIT_TOLERANCE):
            text = f"{1e3 * bead.length:.0f}, allowed {1e3 * wps.sequence.shortest_bead:g} or more"
            whole = np.ones(len(bead.s), dtype=bool)
            yield _finding(bead, "sequence.shortest_bead_mm", whole, text)
        for end, at in enumerate((float(bead.s.min()), float(bead.s.max()))):
            seen.setdefault((bead.zone, bead.station, end, bead.layer), []).append(at)
            if stops.is_open_end(at):
                continue
            near = stops.nearest_landmark(at)
            if near < wps.sequence.stop_distance - NO_LENGTH:
                text = f"a stop {1e3 * near:.0f} from crown or saddle"
                yield _finding(bead, "sequence.stop_distance_mm", bead.s == at, text)
            if len(seen[bead.zone, bead.station, end, bead.layer]) > 1:
                continue  # the beads of a layer start and stop together
            below = seen.get((bead.zone, bead.station, end, bead.layer - 1), [])
            away = min((stops.apart(at, other) for other in below), default=spread)
            if away < spread - NO_LENGTH:
                text = f"a stop {1e3 * away:.0f} from that of the layer below, {apart:g} asked for"
                yield _finding(bead, "sequence.start_spread_mm", bead.s == at, text)


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
        yield WpsFinding(
            "root.opening_mm",
            1,
            float(at.min()),
            float(at.max()),
            float(out.sum() / open_at.sum()),
            f"{widths.min():.2f} to {widths.max():.2f}, allowed {1e3 * low:g} to {1e3 * high:g}",
        )


def _finding(bead: PlannedBead, key: str, out: NDArray[np.bool_], text: str) -> WpsFinding:
    at = bead.s[out]
    return WpsFinding(key, bead.number, float(at.min()), float(at.max()), float(out.mean()), text)
