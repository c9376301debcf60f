"""Motions of the controller: along a path with a speed of the tool, to joint angles, to rest."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt
from typing import Final, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array, inverse_pose
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import (
    FEWEST_PIECES,
    JOINT_TURN_SPACING,
    LARGEST_JOINT_TURN,
    MotionLimits,
    fastest_trajectory,
)
from tjscan_loopback.ur.tool_path import ToolPath

UNBOUNDED_SPEED: Final = 1e3
"""m/s or m/s²: the controller bounds only what the program asks it to."""

FASTEST_JOINTS: Final = 40.0
"""rad/s²: what the joints can do at most, an assumption."""

STILL_SPEED: Final = 1e-9
"""rad/s: slower than this is rest."""

NO_PATH: Final = 1e-9
"""Metres: a shorter path is none."""


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


@dataclass(frozen=True, slots=True, eq=False)
class PathMotion:
    """A motion of the tool along a path: up to a speed, on with it, and down to its end's speed.

    Parameters
    ----------
    spline : CubicSpline
        Joint angles in radians over the length of the path in metres.
    length : float
        Metres.
    speeds : tuple of float
        At the beginning, on the way and at the end, in m/s.
    acceleration : float
        m/s².
    """

    spline: CubicSpline
    length: float
    speeds: tuple[float, float, float]
    acceleration: float

    @property
    def duration(self) -> float:
        """Duration of the motion in seconds."""
        return sum(self._times)

    @property
    def _times(self) -> tuple[float, float, float]:
        """Seconds of speeding up, going on and slowing down."""
        (first, way, last), a = self.speeds, self.acceleration
        up, down = (abs(way**2 - v**2) / (2 * a) for v in (first, last))
        return abs(way - first) / a, max(self.length - up - down, 0.0) / way, abs(way - last) / a

    def joint_angles_at(self, time: float) -> Array:
        """Joint angles in radians at a time in seconds."""
        (first, way, last), (up, on, down) = self.speeds, self._times
        t = min(max(time, 0.0), up + on + down)
        begun, left = min(t, up), min(max(t - up - on, 0.0), down)
        s = first * begun + (way - first) * begun**2 / (2 * up) if up > 0 else 0.0
        s += way * min(max(t - up, 0.0), on)
        s += way * left - (way - last) * left**2 / (2 * down) if down > 0 else 0.0
        return np.asarray(self.spline(min(s, self.length)))


@dataclass(frozen=True, slots=True, eq=False)
class StretchedMotion:
    """A motion that takes another time than it would.

    Parameters
    ----------
    motion : Motion
        What is stretched.
    duration : float
        Seconds.
    """

    motion: Motion
    duration: float

    def joint_angles_at(self, time: float) -> Array:
        """Joint angles in radians at a time in seconds."""
        return self.motion.joint_angles_at(time * self.motion.duration / self.duration)


def joint_motion(
    kinematics: Kinematics, q: Array, goal: Array, speed: float, acceleration: float
) -> Motion:
    """Motion of all joints in proportion; the leading axis gives speed and acceleration."""
    pieces = max(FEWEST_PIECES, ceil(float(np.abs(goal - q).max()) / JOINT_TURN_SPACING))
    waypoints = np.linspace(q, goal, pieces + 1)
    points_b = np.array([kinematics.forward(w)[:3, 3] for w in waypoints])
    limits = MotionLimits(UNBOUNDED_SPEED, UNBOUNDED_SPEED, 1.0, acceleration)
    return fastest_trajectory(waypoints, points_b, np.full(len(q), speed), limits)


def path_motion(
    kinematics: Kinematics,
    q: Array,
    path: ToolPath,
    T_f_tcp: Array,
    speeds: tuple[float, float, float],
    acceleration: float,
) -> Motion:
    """Motion of the tool along a path, slower if a joint would exceed its limit.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    q : ndarray, shape (6,)
        Where it begins, radians.
    path : ToolPath
        Of the active TCP in frame b.
    T_f_tcp : ndarray, shape (4, 4)
        The TCP on the flange.
    speeds : tuple of float
        At the beginning, on the way at most and at the end at most, in m/s.
    acceleration : float
        m/s².

    Raises
    ------
    PoseUnreachable
        If the path leaves the reach or the joint limits, or passes near a singularity.
    """
    T_tcp_f = inverse_pose(T_f_tcp)
    waypoints = [np.asarray(q, dtype=float)]
    for T in path.poses[1:]:
        found = kinematics.inverse(T @ T_tcp_f, near=waypoints[-1])
        if np.abs(found - waypoints[-1]).max() > LARGEST_JOINT_TURN:
            raise PoseUnreachable("a joint would have to swing at once.", T @ T_tcp_f)
        waypoints.append(found)
    if path.length < NO_PATH:
        return joint_motion(
            kinematics, q, waypoints[-1], float(kinematics.velocity.min()), FASTEST_JOINTS
        )
    spline = CubicSpline(path.lengths, np.array(waypoints))
    rates = np.abs(spline(np.linspace(0, path.length, 4 * len(waypoints)), 1)).max(axis=0)
    fastest = float((kinematics.velocity / np.maximum(rates, STILL_SPEED)).min())
    a = min(acceleration, FASTEST_JOINTS / max(float(rates.max()), STILL_SPEED))
    first, way, last = (min(v, fastest) for v in speeds)
    # A short path is left before the speed is reached, or before the end's is.
    way = max(min(way, sqrt(a * path.length + (first**2 + last**2) / 2)), first, last)
    last = min(last, sqrt(first**2 + 2 * a * path.length))
    if first**2 - last**2 > 2 * a * path.length:
        a = (first**2 - last**2) / (2 * path.length)
    return PathMotion(spline, path.length, (first, way, last), a)


def tool_jacobian(kinematics: Kinematics, q: Array, T_f_tcp: Array) -> Array:
    """Velocity of the TCP for unit joint speeds, shape (6, 6), along the axes of b.

    Its origin's in m/s before the angular one in rad/s.
    """
    J = kinematics.jacobian(q)
    arm = kinematics.forward(q)[:3, :3] @ T_f_tcp[:3, 3]
    return np.vstack([J[:3] + np.cross(J[3:].T, arm).T, J[3:]])
