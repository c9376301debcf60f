"""What is wrong with the laser: it bends every profile alike, in the profile's own plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.frames import Array
from tjscan.groove.measures import measure_groove
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.model import LaserModel
from tjscan.scanning.section import ScannedSection
from tjscan.uncertainty.causes import ViewCause

LINEARITY: Final = "laser's linearity"
RANGE_BIAS: Final = "range bias at steep incidence"

MOST_TANGENT: Final = 5.0
"""Tangent of the incidence beyond which a range errs by no more: such points are lost."""

STEP: Final = 1e-6
"""Metres along a side over which its turn is taken: far more than rounding, less than it bends."""

SIDES: Final = ((0, 1), (1, 2), (2, 3), (3, 4))
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
    moves, measures = [], []
    for section in sections:
        xz, tangents = _in_plane(section)
        points = field.at(xz)
        turns = []
        for at, t in ((xz[1], tangents[0]), (xz[3], tangents[3])):
            ahead, here = field.at(np.array((at + STEP * t, at)))
            by_step = (ahead - here) / STEP
            turns.append(t[0] * by_step[1] - t[1] * by_step[0])
        moves.append(points)
        measures.append(_measures(section, points, np.array(turns)))
    return _bending_cause(LINEARITY, evidence, sections, moves, measures)


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
    moves, measures = [], []
    for section in sections:
        xz, tangents = _in_plane(section)
        normals = np.column_stack((tangents[:, 1], -tangents[:, 0]))
        offsets = np.empty((4, 2))  # of each side along its normal, at its first and second point
        for k, side in enumerate(SIDES):
            for end, i in enumerate(side):
                ray = xz[i] / np.linalg.norm(xz[i])
                square, along = abs(normals[k] @ ray), abs(tangents[k] @ ray)
                tangent = min(along / max(square, 1e-9), MOST_TANGENT)
                offsets[k, end] = bias * tangent * (normals[k] @ ray)
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
    return _bending_cause(RANGE_BIAS, evidence, sections, moves, measures)


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
    moves: Sequence[Array],
    measures: Sequence[Array],
) -> ViewCause:
    """Cause of the points' moves in x and z of s, (5, 2, m) each, and the measures' changes."""
    points, twists = [], []
    for section, moved in zip(sections, moves, strict=True):
        R_b_s, p_s = section.view.T_b_s[:3, :3], section.groove.points_s
        points.append(R_b_s[:, [0, 2]] @ moved)
        # The motion in the plane that moves both outer sides across themselves as the bending does.
        _, tangents = _in_plane(section)
        n = np.column_stack((tangents[:, 1], -tangents[:, 0]))[[0, 0, 3, 3]]
        ends = p_s[[0, 1, 3, 4]][:, [0, 2]]
        by_turn = n[:, 0] * ends[:, 1] - n[:, 1] * ends[:, 0]  # a turn about y moves x by z
        design = np.column_stack((n, by_turn))
        across = np.einsum("ki,kim->km", n, moved[[0, 1, 3, 4]])
        x, z, turn = np.linalg.lstsq(design, across, rcond=None)[0]
        zero = np.zeros_like(x)
        in_s = np.array((x, zero, z, zero, turn, zero))
        twists.append(pose_vector.adjoint(section.view.T_b_s) @ in_s)
    return ViewCause(name, evidence, True, np.array(twists), np.array(points), np.array(measures))
