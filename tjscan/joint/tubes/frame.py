"""The joint's own frame j, made of its two tubes."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import Array, frozen_arrays, inverse_pose, pose, unit_vector
from tjscan.joint.tubes.cylinder import Cylinder
from tjscan.joint.tubes.fit import FittedTubes

MOST_UPRIGHT_TILT: Final = radians(2.0)
"""A brace that leans less has no heel: x may point either way along the leg."""

LEAST_AXES_ANGLE: Final = radians(15.0)
"""Tubes nearer to parallel than this make no joint."""


@dataclass(frozen=True, slots=True)
class TubeDimensions:
    """Dimensions of a pair of tubes: radii, angle between the axes, and their offset.

    Parameters
    ----------
    brace_radius, leg_radius : float
        Metres.
    angle : float
        Between the axes, on the heel's side, radians.
    offset : float
        How far the leg's axis passes the brace's, along y of j, metres.
    """

    brace_radius: float
    leg_radius: float
    angle: float
    offset: float

    @property
    def as_array(self) -> Array:
        """The four numbers as an array, shape (4,)."""
        return np.array((self.brace_radius, self.leg_radius, self.angle, self.offset))


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class JointFrame:
    """Frame j as fitted tubes define it: its pose and covariance.

    Parameters
    ----------
    T : ndarray, shape (4, 4)
        Frame j in the frame of the tubes.
    shape : TubeDimensions
        Radii, angle and offset of the tubes.
    covariance : ndarray, shape (10, 10)
        Of the pose, as translation and rotation vector in j (metres, radians), then of the
        shape's four numbers.
    by_points : ndarray, shape (n, 10, 3)
        How these change as each wall point moves in the frame of the tubes, see `FittedTubes`.
    """

    T: Array
    shape: TubeDimensions
    covariance: Array
    by_points: Array = field(default_factory=lambda: np.zeros((0, 10, 3)))


def joint_frame_from_tubes(tubes: FittedTubes, towards: Array) -> JointFrame:
    """Frame j of two tubes, with its covariance.

    Parameters
    ----------
    tubes : FittedTubes
        Brace and leg; the brace's `point` lies on the brace's side of the leg.
    towards : ndarray, shape (3,)
        For an upright brace: x points along the leg to the side that this vector points to. Half
        a turn about the brace changes nothing else. A leaning brace has a heel, which decides.

    Raises
    ------
    TubesNotFound
        If the tubes are all but parallel.
    """
    T, shape = joint_pose_from_cylinders(tubes.brace, tubes.leg, towards)
    step = 1e-6  # a micrometre, a microradian: deep in the linear range

    def around(k: int, sign: int) -> Array:
        moved = np.zeros(10)
        moved[k] = sign * step
        T_moved, there = joint_pose_from_cylinders(
            tubes.brace.boxplus(moved[:5]), tubes.leg.boxplus(moved[5:]), T[:3, 0]
        )
        return np.concatenate(
            (pose_vector.pose_to_vector(inverse_pose(T) @ T_moved), there.as_array)
        )

    jacobian = np.column_stack([(around(k, 1) - around(k, -1)) / (2 * step) for k in range(10)])
    covariance = jacobian @ tubes.covariance @ jacobian.T
    return JointFrame(T, shape, covariance, jacobian @ tubes.by_points)


def joint_pose_from_cylinders(
    brace: Cylinder, leg: Cylinder, towards: Array
) -> tuple[Array, TubeDimensions]:
    """Pose of frame j, and the tubes' dimensions, from two cylinders.

    Parameters
    ----------
    brace, leg : Cylinder
        In one frame; the brace's `point` lies on the brace's side of the leg.
    towards : ndarray, shape (3,)
        The side that x points to if the brace is upright, see `joint_frame_from_tubes`.

    Returns
    -------
    T : ndarray, shape (4, 4)
        Pose of frame j in the frame of the cylinders.
    shape : TubeDimensions
        Radii, angle and offset of the tubes.
    """
    cosine = float(brace.axis @ leg.axis)
    if 1 - cosine * cosine < np.sin(LEAST_AXES_ANGLE) ** 2:
        raise TubesNotFound(
            "the two tubes that were found are all but parallel: they make no joint"
        )
    # Where the axes come nearest: the joining line is square to both.
    between = leg.point - brace.point
    along = (between @ brace.axis - cosine * (between @ leg.axis)) / (1 - cosine * cosine)
    origin = brace.point + along * brace.axis
    z = -np.sign(along) * brace.axis
    leaning = abs(np.arccos(abs(cosine)) - np.pi / 2) > MOST_UPRIGHT_TILT
    to_heel = leg.axis * (np.sign(leg.axis @ z) if leaning else np.sign(leg.axis @ towards) or 1.0)
    x = unit_vector(to_heel - (to_heel @ z) * z)
    y = np.cross(z, x)
    angle = float(np.arctan2(to_heel @ x, to_heel @ z))
    shape = TubeDimensions(brace.radius, leg.radius, angle, float((leg.point - origin) @ y))
    return pose(np.column_stack((x, y, z)), origin), shape
