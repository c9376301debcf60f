"""A groove beside the joint details of a user's table, sorted by the local dihedral angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.core.units import DEG, MM
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.path import cut_groove_stations
from tjscan.planning.wps import JointDetail


@dataclass(frozen=True, slots=True)
class DetailStretch:
    """Consecutive sections for which the table gives the same result.

    Parameters
    ----------
    begin, end : float
        Along the groove, metres.
    dihedral : tuple of float
        Least and most, radians.
    sigma_dihedral : float
        The largest standard deviation of the dihedral angle, radians.
    details : tuple of str
        Whose windows of the dihedral angle hold it, in the table's order.
    out_of_table : tuple of str
        Of the one that fits best: measures outside its windows, and these windows.
    """

    begin: float
    end: float
    dihedral: tuple[float, float]
    sigma_dihedral: float
    details: tuple[str, ...]
    out_of_table: tuple[str, ...]


NO_DETAIL_TEXT: Final = "no detail of the table holds this dihedral angle"

MEASURE_UNITS: Final = {
    "groove_angle": (DEG, "°"),
    "root_opening": (MM, " mm"),
    "size": (MM, " mm"),
}


def find_stretches_off_details(
    edges: GrooveEdges, dihedral: Array, sigma: Array, details: Sequence[JointDetail]
) -> tuple[DetailStretch, ...]:
    """Compare every section with the details whose dihedral angles hold its own.

    If several do, the one with the fewest measures out of their windows is reported. This states
    what was measured beside the user's table, and no more.

    Parameters
    ----------
    edges : GrooveEdges
        The groove, with k sections.
    dihedral, sigma : ndarray, shape (k,)
        Local dihedral angle at each section, and its standard deviation, radians.
    details : sequence of JointDetail
        The table.
    """
    sections = zip(edges.sections.tolist(), dihedral.tolist(), sigma.tolist(), strict=True)
    found = [
        (*section, *_details_and_excess(section[1], measures, details))
        for section, measures in zip(sections, _section_measures(edges), strict=True)
    ]
    stretches = []
    for (names, keys), group in groupby(found, key=lambda one: (one[3], tuple(one[4]))):
        places, angles, sigmas, _, excess = zip(*group, strict=True)
        out = tuple(_excess_text(key, [one[key] for one in excess]) for key in keys)
        out = out if names else (NO_DETAIL_TEXT,)
        span = min(angles), max(angles)
        stretches.append(DetailStretch(places[0], places[-1], span, max(sigmas), names, out))
    return tuple(stretches)


Excess = dict[str, tuple[float, tuple[float, float]]]
"""Value and window of each measure outside its window."""


def _details_and_excess(
    angle: float, measures: dict[str, float], details: Sequence[JointDetail]
) -> tuple[tuple[str, ...], Excess]:
    """Names of the details that hold a dihedral angle, and what is out of the best one."""
    held = [one for one in details if one.dihedral[0] <= angle <= one.dihedral[1]]
    outs: list[Excess] = [
        {
            name: (value, window)
            for name, value in measures.items()
            if not (window := getattr(one, name))[0] <= value <= window[1]
        }
        for one in held
    ]
    return tuple(one.name for one in held), min(outs, key=len, default={})


def _excess_text(name: str, out: Sequence[tuple[float, tuple[float, float]]]) -> str:
    unit, symbol = MEASURE_UNITS[name]
    values = [value / unit.factor for value, _ in out]
    low, high = (limit / unit.factor for limit in out[0][1])
    span = f"{min(values):.1f} to {max(values):.1f}{symbol}"
    return f"{name.replace('_', ' ')} {span}, in the table {low:g} to {high:g}"


def _section_measures(edges: GrooveEdges) -> list[dict[str, float]]:
    """Measures of each section square to the groove; the opening only if the root is open."""
    p3, p4, g, p2 = np.moveaxis(cut_groove_stations(edges, edges.sections).corners, 1, 0)
    bevel, leg, line = p2 - p3, g - p4, g - p2
    turn = np.abs(leg[:, 0] * bevel[:, 1] - leg[:, 1] * bevel[:, 0])
    angles = np.arctan2(turn, np.sum(leg * bevel, axis=1))
    away = 0.5 * (p3 + p4) - p2
    sizes = np.abs(line[:, 0] * away[:, 1] - line[:, 1] * away[:, 0]) / np.linalg.norm(line, axis=1)
    rows = np.column_stack((angles, sizes, edges.root_opening(edges.sections))).tolist()
    return [
        {"groove_angle": angle, "size": size} | ({"root_opening": width} if width > 0 else {})
        for angle, size, width in rows
    ]
