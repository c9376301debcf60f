"""Start poses as a hand finds them, and an arm whose base is carried to the joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.frames import Array, inverse, pose, unit
from tjscan.joint.bevel import bevel_sections
from tjscan.joint.definition import JointDefinition
from tjscan.joint.geometry import tangential
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.target import Direction

HAND_STREAM: Final = 11
"""Keeps the hand's random numbers apart from those of arm and laser."""

AZIMUTHS: Final = np.linspace(-2 * np.pi, 4 * np.pi, 4321)
"""Where the groove's length is tabulated: a turn, and one more either way."""


@dataclass(frozen=True, slots=True)
class Hand:
    """How far off a hand leaves the sensor, at most, along and about each of its axes.

    Parameters
    ----------
    shift, turn : float
        Metres and radians.
    """

    shift: float
    turn: float

    def errors(self, rng: np.random.Generator) -> Array:
        """What the sensor is off by, in its own frame, shape (4, 4)."""
        turn = Rotation.from_rotvec(rng.uniform(-self.turn, self.turn, 3))
        return pose(turn.as_matrix(), rng.uniform(-self.shift, self.shift, 3))


def random_of(seed: int) -> np.random.Generator:
    """The hand's own random numbers."""
    return np.random.default_rng([seed, HAND_STREAM])


def ideal_view(joint: JointDefinition, azimuth: float, plan: ScanPlan) -> Array:
    """Where the sensor would best stand before the groove at an azimuth.

    Parameters
    ----------
    joint : JointDefinition
        The joint.
    azimuth : float
        In frame j, radians.
    plan : ScanPlan
        Direction, angles and stand-off.

    Returns
    -------
    ndarray, shape (4, 4)
        T_j_s, in metres.
    """
    phi = np.array([azimuth])
    tangent = joint.leg.tangent(phi, joint.brace_radius)[0]
    sections = bevel_sections(joint, phi)
    origin = joint.leg.point(phi, joint.brace_radius)[0]
    x = tangent if plan.direction is Direction.COUNTERCLOCKWISE else -tangent
    y = unit(np.array([0.0, 0.0, 1.0]) - x[2] * x)
    T_j_t = pose(np.column_stack((x, y, np.cross(x, y))), origin)
    return T_j_t @ inverse(plan.target(_work_angle(joint, sections.bevel[0], azimuth, tangent)))


def _work_angle(joint: JointDefinition, bevel: Array, azimuth: float, tangent: Array) -> float:
    """β from bevel and leg in the plane square to the groove, eq. (16), radians."""
    y = unit(np.array([0.0, 0.0, 1.0]) - tangent[2] * tangent)
    z = np.cross(tangent, y)
    around = tangential(azimuth)
    outward = np.array([around[1], -around[0], 0.0])
    up = bevel[0] * outward + np.array([0.0, 0.0, bevel[1]])
    leg = np.cross(tangent, joint.leg.normal(joint.leg.point(azimuth, joint.brace_radius)))
    gamma_1 = np.arctan2(up @ y, up @ z)
    gamma_2 = np.arctan2(-(leg @ y), leg @ z)
    return float(0.5 * (gamma_1 - gamma_2))


def further(joint: JointDefinition, azimuth: float, way: float, direction: Direction) -> float:
    """Azimuth that lies a way along the groove from another one.

    Parameters
    ----------
    joint : JointDefinition
        The joint.
    azimuth : float
        Radians, within a turn.
    way : float
        Metres along the outer edge, not negative.
    direction : Direction
        Which way round.
    """
    speed = np.linalg.norm(joint.leg.velocity(AZIMUTHS, joint.brace_radius), axis=1)
    length = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(AZIMUTHS))))
    signed = way if direction is Direction.COUNTERCLOCKWISE else -way
    return float(np.interp(np.interp(azimuth, AZIMUTHS, length) + signed, length, AZIMUTHS))


def taught_views(
    joint: JointDefinition, azimuth: float, plan: ScanPlan, hand: Hand, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Both start poses of the sensor, T_j_s, as a hand finds them, a step apart."""
    second = further(joint, azimuth, plan.step, plan.direction)
    first_view, second_view = (
        ideal_view(joint, phi, plan) @ hand.errors(rng) for phi in (azimuth, second)
    )
    return first_view, second_view


def carried(
    joint: JointDefinition, azimuth: float, sections: int, plan: ScanPlan, T_b_s_home: Array
) -> Array:
    """Where the joint stands for a base that was carried to it.

    Parameters
    ----------
    joint, azimuth, plan
        The joint, where its scan starts (radians), and what is scanned.
    sections : int
        How many sections are to be scanned, the two taught ones included.
    T_b_s_home : ndarray, shape (4, 4)
        The sensor's pose in the arm's home configuration.

    Returns
    -------
    ndarray, shape (4, 4)
        T_b_j: at home the arm looks at the middle of the arc.
    """
    middle = further(joint, azimuth, (sections - 1) / 2 * plan.step, plan.direction)
    return T_b_s_home @ inverse(ideal_view(joint, middle, plan))
