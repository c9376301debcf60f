"""The groove's direction and the surfaces' normals, from sections that are across it.

A section's own plane is turned from the groove's normal plane by about the pull angle, and so are
the axes of its frame g. A torch needs the groove's true direction, which only neighbouring
sections show.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tjscan.core.frames import Array, array_dataclass, unit_vectors
from tjscan.groove.measured import MeasuredSection

NEIGHBOUR_DISTANCE: Final = 60e-3
"""Metres to either side within which neighbours count for the direction."""

FEWEST_NEIGHBOURS: Final = 5
"""Fewest sections that count, itself included, if there are as many."""

TANGENT_POLYNOMIAL_DEGREE: Final = 3
"""Of the polynomial through them: a tube's edge bends, and bends differently along its way."""

NEIGHBOUR_WEIGHT_SIGMA: Final = 0.4
"""Standard deviation of the neighbours' weights, as a share of the width: near ones count more.

On the edge of a 457 mm brace on a 600 mm leg, noise of 0.05 mm included, nine directions of ten
are then right to 0.3° inside the chain and 1.1° at its ends for steps of 5 to 40 mm; for steps
of 80 mm to 1.2° and 5°.
"""


@array_dataclass
class SectionDirections:
    """Directions at each of n sections, unit vectors of shape (n, 3) in the sections' frame.

    Parameters
    ----------
    tangent : ndarray
        Along the groove at p3, counterclockwise seen from above.
    wall, bevel, leg : ndarray
        Normals out of the steel: of the brace's wall at p2, the bevel between p2 and p3, and the
        leg at p4.
    """

    tangent: Array
    wall: Array
    bevel: Array
    leg: Array


def section_directions(sections: Sequence[MeasuredSection]) -> SectionDirections:
    """Directions at each section, from its neighbours.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        Two or more, in their order along the groove.
    """
    frames = np.array([section.T_r_g[:3, :3] for section in sections])
    x, y, z = (frames[:, :, i] for i in range(3))
    edges = np.array([section.points[1:4] for section in sections])
    along = [tangents_along_line(edges[:, i], x) for i in range(3)]
    opening = np.array([section.measures[0] for section in sections])
    work = np.array([section.work_angle for section in sections])
    # From (16): gamma_1 raises the bevel over z_g, gamma_2 lowers the leg below it.
    gamma_1, gamma_2 = (0.5 * opening + work)[:, None], (0.5 * opening - work)[:, None]
    bevel = np.cos(gamma_1) * z + np.sin(gamma_1) * y
    leg = np.cos(gamma_2) * z - np.sin(gamma_2) * y
    return SectionDirections(
        tangent=along[1],
        wall=unit_vectors(np.cross(along[0], y)),
        bevel=unit_vectors(np.cross(along[1], bevel)),
        leg=unit_vectors(np.cross(leg, along[2])),
    )


def tangents_along_line(points: Array, x: Array) -> Array:
    """Unit tangents of a smooth line at its points, each turned to the side of `x`.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In their order along the line; closed if the last is about a step from the first.
    x : ndarray, shape (n, 3)
        To whose side each direction goes.

    Returns
    -------
    ndarray, shape (n, 3)
        Unit vectors.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    s = np.concatenate(([0.0], steps.cumsum()))
    gap = float(np.linalg.norm(points[-1] - points[0]))
    closed = len(points) > FEWEST_NEIGHBOURS and gap <= 2 * float(np.median(steps))
    if closed:
        whole = s[-1] + gap
        s = np.concatenate((s - whole, s, s + whole))
        points = np.tile(points, (3, 1))
    n = len(x)
    first = n if closed else 0
    directions = np.array([_local_slope(s, points, i) for i in range(first, first + n)])
    sides = np.sign(np.sum(directions * x, axis=1))[:, None]
    return unit_vectors(np.where(sides == 0, 1.0, sides) * directions)


def _local_slope(s: Array, points: Array, i: int) -> Array:
    """Derivative at ``s[i]`` of a polynomial through the points about it."""
    away = np.abs(s - s[i])
    reach = max(NEIGHBOUR_DISTANCE, float(np.sort(away)[min(FEWEST_NEIGHBOURS, len(s)) - 1]))
    near = away <= reach
    u = (s[near] - s[i]) / reach
    weights = np.exp(-0.5 * (u / NEIGHBOUR_WEIGHT_SIGMA) ** 2)[:, None]
    degree = min(TANGENT_POLYNOMIAL_DEGREE, len(np.unique(u)) - 1)
    powers = u[:, None] ** np.arange(degree + 1)
    coefficients, *_ = np.linalg.lstsq(weights * powers, weights * points[near])
    return np.asarray(coefficients[1])
