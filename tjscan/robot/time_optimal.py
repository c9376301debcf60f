"""How fast a path may be run through: the quickest motion within the limits of joints and tool.

Reachability analysis of Pham and Pham (2018), A New Approach to Time-Optimal Path Parameterization
Based on Reachability Analysis, IEEE Trans. Robotics 34(3), by their library.
"""

from __future__ import annotations

import logging
import warnings
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicSpline

from tjscan.core.frames import Array, array_dataclass
from tjscan.robot.following import JointMotion
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits

with warnings.catch_warnings():  # of backslashes in its docstrings, where it is compiled first
    warnings.simplefilter("ignore")
    from toppra.algorithm import TOPPRA
    from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint
    from toppra.constraint.linear_constraint import (
        LinearConstraint,
        canlinear_colloc_to_interpolate,
    )
    from toppra.interpolator import AbstractGeometricPath

logging.getLogger("toppra").setLevel(logging.ERROR)

PIECES_OF_A_CUBIC: Final = 2
"""Into which each piece of a path's spline is cut by the places where limits are looked at. Its
knots are among them: there its bend changes its slope, so that in between nothing peaks."""

SHARES_OF_LIMITS: Final = (0.9, 0.94, 0.98)
"""Of speeds and accelerations that a motion may take at these places, tried in this order: a path
that leaves another one at full speed turns a little otherwise, and between the places it takes a
little more."""

ACCELERATION_DIRECTIONS: Final = np.linspace(0.0, np.pi, 9)
"""Radians, in the plane of a path and its bend: directions in which the tool's acceleration is
bounded. Its largest component in one of them is at least 0.98 of it."""


@array_dataclass
class LengthOverTime:
    """Length gone along a path over time; constant acceleration between knots.

    Parameters
    ----------
    times, lengths, speeds : ndarray, shape (m,)
        Seconds, metres, metres per second.
    """

    times: Array
    lengths: Array
    speeds: Array

    def knot_from(self, time: float) -> tuple[float, float, float]:
        """Time, length and speed at the first knot not before a time; at rest after the last."""
        i = int(np.searchsorted(self.times, time))
        if i == len(self.times):
            return time, float(self.lengths[-1]), 0.0
        return float(self.times[i]), float(self.lengths[i]), float(self.speeds[i])


class _SplinePath(AbstractGeometricPath):  # type: ignore[misc]  # the library has no types
    """A spline of joint angles, as the library takes paths; its parameter is scaled."""

    def __init__(self, q: CubicSpline, scale: float) -> None:
        self._q, self._scale = q, scale

    def __call__(self, places: Array, order: int = 0) -> Array:
        return np.asarray(self._scale**order * self._q(np.asarray(places) * self._scale, order))

    @property
    def dof(self) -> int:
        return int(self._q.c.shape[2])

    @property
    def path_interval(self) -> Array:
        return np.asarray(self._q.x[[0, -1]] / self._scale)

    @property
    def waypoints(self) -> tuple[Array, Array]:
        return self._q.x / self._scale, self._q(self._q.x)


class _ToolLimits(LinearConstraint):  # type: ignore[misc]
    """Speed and acceleration of the flange's origin, and the speed along the path."""

    def __init__(
        self, points_b: CubicSpline, scale: float, tcp_speed: float, tcp_acceleration: float
    ) -> None:
        super().__init__()
        self._points_b, self._scale = points_b, scale
        self._speed, self._acceleration = tcp_speed, tcp_acceleration
        self.identical = True

    def compute_constraint_params(self, path: Any, places: Array, *others: Any) -> tuple[Any, ...]:
        first, second = (
            self._scale**k * self._points_b(np.asarray(places) * self._scale, k) for k in (1, 2)
        )
        speed = np.maximum(np.linalg.norm(first, axis=1), 1e-9)
        along = np.sum(first * second, axis=1) / speed
        across = np.sqrt(np.maximum(np.sum(second**2, axis=1) - along**2, 0.0))
        a = np.column_stack((speed, np.zeros_like(speed)))
        b = np.column_stack((along, across))
        F = np.column_stack((np.cos(ACCELERATION_DIRECTIONS), np.sin(ACCELERATION_DIRECTIONS)))
        g = np.full(len(F), self._acceleration)
        fastest = np.minimum(self._speed / speed, 1.0)
        bounds = np.column_stack((np.zeros_like(fastest), fastest**2))
        at_places = a, b, np.zeros_like(a), F, g, None, None
        both_ends = canlinear_colloc_to_interpolate(*at_places, places, identical=True)
        return *both_ends[:5], None, bounds


class PathTiming:
    """The quickest motions along paths that keep the limits of an arm and a speed along the path.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    limits : MotionLimits
        Of its joints and its flange.
    speed : float
        Largest speed along the path, metres per second.
    """

    def __init__(self, kinematics: Kinematics, limits: MotionLimits, speed: float) -> None:
        self._kinematics, self._limits, self._speed = kinematics, limits, speed

    def speed_and_braking(self, q: CubicSpline) -> tuple[float, float]:
        """Largest speed at any place of a path that joints and flange can take, and how to brake.

        Parameters
        ----------
        q : CubicSpline
            Joint angles in radians over the length along the path in metres.

        Returns
        -------
        speed, braking : float
            Metres per second; and the seconds, the largest at a place, in which a metre per second
            is braked.
        """
        limits, turns = self._limits, q(q.x, 1)
        moves = [
            self._kinematics.jacobian(one)[:3] @ turn
            for one, turn in zip(q(q.x), turns, strict=True)
        ]
        tool, turns = np.linalg.norm(moves, axis=1), np.abs(turns)
        slowness = np.maximum(
            (turns / (limits.joint_speed * self._kinematics.velocity)).max(axis=1),
            tool / limits.tcp_speed,
        )
        braking = max(turns.max() / limits.joint_acceleration, tool.max() / limits.tcp_acceleration)
        return float(1.0 / slowness.min()), float(braking)

    def fastest(self, q: CubicSpline, start_speed: float, start: float) -> LengthOverTime | None:
        """Quickest way along a path, with a speed at its start, to rest at its end.

        Parameters
        ----------
        q : CubicSpline
            Joint angles in radians over the length along the path in metres.
        start_speed : float
            Metres per second at its start.
        start : float
            Seconds at its start.

        Returns
        -------
        LengthOverTime or None
            None if the path can't be run through: from this speed there is no stop on it.
        """
        points = [self._kinematics.forward(one)[:3, 3] for one in q(q.x)]
        begin, end = (self._kinematics.jacobian(q(s))[:3] @ q(s, 1) for s in q.x[[0, -1]])
        points_b = CubicSpline(q.x, points, bc_type=((1, begin), (1, end)))
        shares = np.arange(PIECES_OF_A_CUBIC) / PIECES_OF_A_CUBIC
        inner = q.x[:-1, None] + np.diff(q.x)[:, None] * shares
        places = np.append(inner.ravel(), q.x[-1])
        for share in SHARES_OF_LIMITS:
            speeds = self._speeds_within(share, q, points_b, places, start_speed)
            if speeds is not None:
                sums = speeds[1:] + speeds[:-1]
                times = start + np.append(0.0, np.cumsum(2 * np.diff(places) / sums))
                return LengthOverTime(times, places, speeds)
        return None

    def _speeds_within(
        self, share: float, q: CubicSpline, points_b: CubicSpline, places: Array, start_speed: float
    ) -> Array | None:
        """Largest speeds at places within a share of the limits; None if there are none."""
        limits, scale = self._limits, self._speed  # the library likes numbers about one
        fastest = share * limits.joint_speed * self._kinematics.velocity
        quickest = np.full(len(fastest), share * limits.joint_acceleration)
        constraints = [
            JointVelocityConstraint(np.column_stack((-fastest, fastest))),
            JointAccelerationConstraint(np.column_stack((-quickest, quickest))),
            _ToolLimits(points_b, scale, share * limits.tcp_speed, share * limits.tcp_acceleration),
        ]
        path = _SplinePath(q, scale)
        problem = TOPPRA(constraints, path, gridpoints=places / scale, solver_wrapper="seidel")
        begun = float(np.clip(start_speed / scale, 0.0, 1.0))  # at rest it may be rounded below
        _, speeds, _ = problem.compute_parameterization(begun, 0.0)
        if speeds is None or not np.isfinite(speeds).all():
            return None
        speeds = np.maximum(speeds, 0.0)
        return scale * speeds if (speeds[1:] + speeds[:-1] > 0).all() else None


def joint_motion(q: CubicSpline, gone: LengthOverTime) -> JointMotion:
    """Joint angles over time, of a path and the length gone along it."""
    speed = q(gone.lengths, 1) * gone.speeds[:, None]
    speed[-1] = 0.0
    return JointMotion(gone.times, q(gone.lengths), speed)
