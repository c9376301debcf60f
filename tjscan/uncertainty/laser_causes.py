"""What is wrong with the laser: it bends every profile alike, in the profile's own plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.section import measure_groove
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.model import LaserModel
from tjscan.scanning.section import ScannedSection
from tjscan.uncertainty.causes import ProfileBend, ViewCause

LINEARITY_CAUSE: Final = "laser's linearity"
RANGE_BIAS_CAUSE: Final = "range bias at steep incidence"

MOST_TANGENT: Final = 5.0
"""Tangent of the incidence beyond which a range errs by no more: such points are lost."""

SLOPE_STEP: Final = 1e-6
"""Metres along a side over which its turn is taken: far more than rounding, less than it bends."""

SIDE_ENDS: Final = ((0, 1), (1, 2), (2, 3), (3, 4))
"""Points that wall, bevel, root and leg lie between."""


def linearity_cause(
    sections: Sequence[ScannedSection], deviation: float, model: LaserModel, evidence: str
) -> ViewCause:
    """What the laser deviates by all over its window, see `LaserDeviation`.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of one laser.
    deviation : float
        Largest deviation in the window, metres.
    model : LaserModel
        The window.
    evidence : str
        As of `BudgetComponent`.
    """
    field = LaserDeviation.in_window(
        deviation,
        near=model.near,
        far=model.far,
        apex_z=model.emitter_z,
        half_angle=model.half_angle,
    )

    def bend(xz: Array, _tangents: Array) -> Array:
        return field.at(xz)

    moves, measures = [], []
    for section in sections:
        xz, tangents = _in_plane(section)
        points = field.at(xz)
        turns = []
        for at, t in ((xz[1], tangents[0]), (xz[3], tangents[3])):
            ahead, here = field.at(np.array((at + SLOPE_STEP * t, at)))
            by_step = (ahead - here) / SLOPE_STEP
            turns.append(t[0] * by_step[1] - t[1] * by_step[0])
        moves.append(points)
        measures.append(_measures(section, points, np.array(turns)))
    return _bending_cause(LINEARITY_CAUSE, evidence, sections, bend, moves, measures)


def range_bias_cause(sections: Sequence[ScannedSection], bias: float, evidence: str) -> ViewCause:
    """Range that errs in proportion to the tangent of the incidence, the same on all profiles.

    Each side moves along the light; a corner is where its sides meet then. Incidence counts in
    the laser's plane, and light comes from the sensor's origin.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of one laser, on steel of one kind.
    bias : float
        Standard deviation of the range's error at 45° of incidence, metres.
    evidence : str
        As of `BudgetComponent`.
    """

    def bend(xz: Array, tangents: Array) -> Array:
        ray = xz / np.linalg.norm(xz, axis=1, keepdims=True)
        along = np.abs(np.sum(ray * tangents, axis=1))
        square = np.abs(ray[:, 0] * tangents[:, 1] - ray[:, 1] * tangents[:, 0])
        tangent = np.minimum(along / np.maximum(square, 1e-9), MOST_TANGENT)
        return np.asarray((bias * tangent[:, None] * ray)[..., None])

    moves, measures = [], []
    for section in sections:
        xz, tangents = _in_plane(section)
        normals = np.column_stack((tangents[:, 1], -tangents[:, 0]))
        offsets = np.empty((4, 2))  # of each side along its normal, at its first and second point
        for k, side in enumerate(SIDE_ENDS):
            offsets[k] = bend(xz[list(side)], np.tile(tangents[k], (2, 1)))[..., 0] @ normals[k]
        points = np.zeros((5, 2))
        points[0], points[4] = normals[0] * offsets[0, 0], normals[3] * offsets[3, 1]
        for i in (1, 2, 3):
            both = normals[[i - 1, i]]
            points[i] = np.linalg.lstsq(both, (offsets[i - 1, 1], offsets[i, 0]), rcond=1e-2)[0]
        lengths = np.linalg.norm(xz[[0, 4]] - xz[[1, 3]], axis=1)
        # The normal lies clockwise of the tangent: moving along it turns a side clockwise.
        turns = np.array((offsets[0, 0] - offsets[0, 1], offsets[3, 0] - offsets[3, 1])) / lengths
        moves.append(points[:, :, None])
        measures.append(_measures(section, points[:, :, None], turns[:, None]))
    return _bending_cause(RANGE_BIAS_CAUSE, evidence, sections, bend, moves, measures)


def _in_plane(section: ScannedSection) -> tuple[Array, Array]:
    """The five points (5, 2) in x and z of s, and unit tangents of the four sides (4, 2)."""
    groove = section.groove
    xz = groove.points_s[:, [0, 2]]
    tangents = np.diff(xz, axis=0)
    tangents[0], tangents[3] = groove.wall_s[[0, 2]], groove.leg_s[[0, 2]]
    size = np.linalg.norm(tangents, axis=1, keepdims=True)
    return xz, tangents / np.where(size > 0, size, 1.0)


def _measures(section: ScannedSection, points: Array, turns: Array) -> Array:
    """How the measures change with the points (5, 2, m) and with both outer tangents (2, m)."""
    groove = section.groove
    p2, p3, p4 = groove.points_s[1:4, [0, 2]].tolist()
    wall, leg = groove.wall_s[[0, 2]].tolist(), groove.leg_s[[0, 2]].tolist()
    by = np.concatenate((points[1:4].reshape(6, -1), turns))
    return np.asarray(measure_groove(p2, p3, p4, wall, leg).jacobian @ by)


def _bending_cause(
    name: str,
    evidence: str,
    sections: Sequence[ScannedSection],
    bend: ProfileBend,
    moves: Sequence[Array],
    measures: Sequence[Array],
) -> ViewCause:
    """Cause of the points' moves in x and z of s, (5, 2, m) each, and the measures' changes."""
    points = [
        section.view.T_b_s[:3, [0, 2]] @ moved
        for section, moved in zip(sections, moves, strict=True)
    ]
    unmoved = np.zeros((len(points), 6, points[0].shape[-1]))  # bent, and not moved as a whole
    return ViewCause(name, evidence, True, unmoved, np.array(points), np.array(measures), bend)
