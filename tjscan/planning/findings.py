"""What of a planned bead is out of the WPS, and where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.core.units import MM2, FileUnit
from tjscan.planning.bead import PlannedBead
from tjscan.planning.wps import KJ_MM, M_MIN, MM_MIN, WeldingProcedure

ROUNDING: Final = 1e-9
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
        First and last length along the groove where it is so, metres.
    share : float
        Of the bead's points.
    text : str
        What was planned, and what the WPS says.
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
    checks: tuple[tuple[str, FileUnit, Array, tuple[float, float]], ...] = (
        ("arc.wire_feed", M_MIN, np.full_like(bead.speed, bead.feed), wps.arc.wire_feed),
        ("arc.travel_speed", MM_MIN, bead.speed, wps.arc.travel_speed),
        ("arc.heat_input", KJ_MM, bead.heat, wps.arc.heat_input),
        (f"bead.{bead.kind}_area", MM2, bead.area, getattr(wps.bead, f"{bead.kind}_area")),
    )
    for name, unit, values, (low, high) in checks:
        out = (values < low * (1 - ROUNDING)) | (values > high * (1 + ROUNDING))
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
    out = ~np.isin(bead.positions, wps.sequence.positions)
    if out.any():
        names = sorted(set(np.array(bead.positions)[out].tolist()))
        allowed = ", ".join(wps.sequence.positions)
        yield _finding(bead, "sequence.positions", out, f"{', '.join(names)}, allowed {allowed}")


def _finding(bead: PlannedBead, key: str, out: NDArray[np.bool_], text: str) -> WpsFinding:
    at = bead.s[out]
    return WpsFinding(key, bead.number, float(at.min()), float(at.max()), float(out.mean()), text)
