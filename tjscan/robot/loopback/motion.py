"""Moves of the controller, on the project's own kinematics and motion profiles."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final, Protocol

import numpy as np

from tjscan.core.frames import Array
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.motion import MotionLimits, fastest_joint_path
from tjscan.robot.path import FEWEST, JOINT_SPACING, linear_path

UNBOUNDED: Final = 1e3
"""m/s or m/s²: the controller bounds only what the program asks it to."""

FASTEST_JOINTS: Final = 40.0
"""rad/s²: what the joints can do at most, an assumption."""

STILL: Final = 1e-9
"""rad/s: slower than this is rest."""

INSTANT: Final = 1e-6
"""Seconds over which a speed is taken."""


class Motion(Protocol):
    """A motion of the arm: joint angles over time."""

    @property
    def duration(self) -> float:
        """Duration of the motion in seconds."""
        ...

    def joint_angles_at(self, time: float) -> Array:
        """Joint angles in radians, shape (6,), at a time in seconds from the start."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class DecelerationMotion:
    """A motion that decelerates from a speed to rest, along that speed.

    Parameters
    ----------
    q, speed : ndarray, shape (6,)
        Where it begins and how fast, in radians and rad/s.
    duration : float
        Seconds until rest.
    """

    q: Array
    speed: Array
    duration: float

    def joint_angles_at(self, time: float) -> Array:
        """Joint angles in radians at a time in seconds."""
        t = min(time, self.duration)
        share = t - t**2 / (2 * self.duration) if self.duration > 0 else 0.0
        return np.asarray(self.q + share * self.speed)


def decelerate_motion(motion: Motion, time: float, deceleration: float) -> DecelerationMotion:
    """Motion that stops another one at a time, with the leading axis' deceleration in rad/s²."""
    q = motion.joint_angles_at(time)
    speed = (motion.joint_angles_at(time + INSTANT) - q) / INSTANT
    fastest = float(np.abs(speed).max())
    return DecelerationMotion(
        q, speed, 0.0 if fastest < STILL else fastest / max(deceleration, 0.1)
    )


def joint_motion(
    kinematics: Kinematics, q: Array, goal: Array, speed: float, acceleration: float
) -> Motion:
    """Motion of all joints in proportion; speed and acceleration are those of the leading axis."""
    pieces = max(FEWEST, ceil(float(np.abs(goal - q).max()) / JOINT_SPACING))
    waypoints = np.linspace(q, goal, pieces + 1)
    points_b = np.array([kinematics.forward(w)[:3, 3] for w in waypoints])
    limits = MotionLimits(UNBOUNDED, UNBOUNDED, 1.0, acceleration)
    return fastest_joint_path(waypoints, points_b, np.full(len(q), speed), limits)


def linear_motion(
    kinematics: Kinematics, q: Array, T_b_f: Array, speed: float, acceleration: float
) -> Motion:
    """Motion of the flange on a straight line.

    Raises
    ------
    PoseUnreachable
        If the line leaves the reach or the joint limits.
    """
    limits = MotionLimits(speed, acceleration, 1.0, FASTEST_JOINTS)
    return linear_path(kinematics, q, T_b_f, limits)
