"""How long a path takes: rest to rest, within limits of joints and flange."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite, radians, sqrt
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, frozen_arrays

SAMPLES_PER_WAYPOINT: Final = 4
"""Between waypoints the derivatives of the spline are looked at this often."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Largest speeds and accelerations with which an arm may move.

    The defaults are those a Universal Robots pendant proposes for a linear move, at half of
    the joint speeds.

    Parameters
    ----------
    tcp_speed : float
        Speed of the flange's origin in m/s, in every move. 0.25 m/s is what ISO 10218-1 calls
        reduced speed.
    tcp_acceleration : float
        Acceleration of the flange's origin in m/s².
    joint_speed : float
        Fraction of the joint speed limits that is used, above 0, at most 1.
    joint_acceleration : float
        Acceleration of every joint in rad/s².

    Raises
    ------
    ConfigurationError
        If a limit is not a positive number, or the fraction is above 1.
    """

    tcp_speed: float = 0.25
    tcp_acceleration: float = 1.2
    joint_speed: float = 0.5
    joint_acceleration: float = radians(80)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (isfinite(value) and value > 0):
                raise ConfigurationError(f"it must be positive (found {value})", key=field.name)
        if self.joint_speed > 1:
            raise ConfigurationError(
                f"it is a fraction of the joints' limits, at most 1 (found {self.joint_speed})",
                key="joint_speed",
            )


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class JointTrajectory:
    """A timed path in joint space, rest to rest.

    Between the waypoints runs a cubic spline. Its parameter u goes from 0 to 1 with a
    trapezoid of speed: it ramps up, cruises and ramps down.

    Parameters
    ----------
    q : ndarray, shape (m, n)
        Waypoints at evenly spaced u, in radians.
    duration : float
        Seconds.
    ramp : float
        Seconds of the first ramp, and of the last.
    """

    q: Array
    duration: float
    ramp: float

    def joint_angles_at(self, time: float | Array) -> Array:
        """Joint angles in radians, shape (..., n), at times in seconds from the start.

        Before the start the arm is at the first waypoint, after the end at the last.
        """
        if self.duration == 0:
            return np.broadcast_to(self.q[-1], (*np.shape(time), self.q.shape[1])).copy()
        t = np.clip(time, 0.0, self.duration)
        cruise = 1 / (self.duration - self.ramp)
        # Area under the trapezoid: both ramps as parabolas from their own end of the path.
        left = np.minimum(t, self.duration - t)
        ramped, cruised = cruise * left**2 / (2 * self.ramp), cruise * (left - self.ramp / 2)
        from_end = np.where(left < self.ramp, ramped, cruised)
        u = np.where(2 * t <= self.duration, from_end, 1 - from_end)
        return np.asarray(_spline_through(self.q)(u))


def fastest_joint_path(
    q: Array, points_b: Array, velocity: Array, limits: MotionLimits
) -> JointTrajectory:
    """Time a path as fast as the limits allow, with a trapezoid of speed.

    With path speed v = du/dt and path acceleration a, a joint has speed q' v and acceleration
    q' a + q'' v², and the flange likewise. Bounding q' and q'' by their largest values on the
    path, v is bounded by the speed limits and a(v) = (1 - C v²) / G by the accelerations.
    The duration 1/v + v/a(v) is convex in v, so the best v is its minimum or the bound.

    Parameters
    ----------
    q : ndarray, shape (m, n)
        Waypoints, evenly spaced along the path, in radians.
    points_b : ndarray, shape (m, 3)
        The flange's origin at the waypoints, in metres.
    velocity : ndarray, shape (n,)
        Joint speed limits in rad/s.
    limits : MotionLimits
        What to keep within.
    """
    first, second = _spline_derivatives(q)
    first_p, second_p = (np.linalg.norm(d, axis=1).max() for d in _spline_derivatives(points_b))
    first, second = np.abs(first).max(axis=0), np.abs(second).max(axis=0)
    of_joints = float((first / (limits.joint_speed * velocity)).max())
    slowness = max(of_joints, float(first_p / limits.tcp_speed))
    if slowness == 0:
        return JointTrajectory(q, 0.0, 0.0)
    fastest = 1 / slowness
    G, C = (
        max(float(d.max() / limits.joint_acceleration), float(d_p / limits.tcp_acceleration))
        for d, d_p in ((first, first_p), (second, second_p))
    )
    B = C / G
    # Where d/dv (1/v + v/a(v)) = 0.
    best = sqrt(2 / (G * (2 * B + 1 + sqrt(8 * B + 1))))
    v = min(fastest, best)
    ramp = v * G / (1 - C * v**2)
    return JointTrajectory(q, 1 / v + ramp, ramp)


def _spline_through(values: Array) -> CubicSpline:
    return CubicSpline(np.linspace(0, 1, len(values)), values)


def _spline_derivatives(values: Array) -> tuple[Array, Array]:
    """First and second derivative by u, at and between the waypoints."""
    spline = _spline_through(values)
    u = np.linspace(0, 1, SAMPLES_PER_WAYPOINT * (len(values) - 1) + 1)
    return np.asarray(spline(u, 1)), np.asarray(spline(u, 2))
