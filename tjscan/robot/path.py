"""Straight paths, of the flange or of the joints, and how long they take within their limits."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from math import ceil, isfinite, radians, sqrt
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from tjscan.core import pose_vector
from tjscan.core.errors import ConfigurationError, PoseUnreachable
from tjscan.core.frames import Array, array_dataclass, rotation_angle_between
from tjscan.robot.kinematics import SINGULARITY_THRESHOLD, Kinematics
from tjscan.robot.settings import InputShaper

SPLINE_SAMPLES_PER_WAYPOINT: Final = 4
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
    shaper : InputShaper, optional
        Spreads moves so that what carries the arm does not sway after them.

    Raises
    ------
    ConfigurationError
        If a limit is not a positive number, or the fraction is above 1.
    """

    tcp_speed: float = 0.25
    tcp_acceleration: float = 1.2
    joint_speed: float = 0.5
    joint_acceleration: float = radians(80)
    shaper: InputShaper | None = None

    def __post_init__(self) -> None:
        for limit in fields(self)[:-1]:
            value = getattr(self, limit.name)
            if not (isfinite(value) and value > 0):
                raise ConfigurationError(f"it must be positive (found {value})", key=limit.name)
        if self.joint_speed > 1:
            raise ConfigurationError(
                f"it is a fraction of the joints' limits, at most 1 (found {self.joint_speed})",
                key="joint_speed",
            )


@array_dataclass
class JointTrajectory:
    """A timed path in joint space, rest to rest.

    Between the waypoints runs a cubic spline. Its parameter u goes from 0 to 1 with a
    trapezoid of speed: it ramps up, cruises and ramps down. A shaped one goes through the sum of
    several such ways, each late by its delay and a share of u long; the path stays the same.

    Parameters
    ----------
    q : ndarray, shape (m, n)
        Waypoints at evenly spaced u, in radians.
    duration : float
        Seconds.
    ramp : float
        Seconds of the first ramp, and of the last.
    impulses : ndarray, shape (k, 2)
        Delay in seconds, rising from zero, and share of each way, see `InputShaper`.
    """

    q: Array
    duration: float
    ramp: float
    impulses: Array = field(default_factory=lambda: np.array([(0.0, 1.0)]))

    def joint_angles_at(self, time: float | Array) -> Array:
        """Joint angles in radians, shape (..., n), at times in seconds from the start.

        Before the start the arm is at the first waypoint, after the end at the last.
        """
        if self.duration == 0:
            return np.broadcast_to(self.q[-1], (*np.shape(time), self.q.shape[1])).copy()
        duration = self.duration - self.impulses[-1, 0]
        # One way after another, in the last axis.
        t = np.clip(np.expand_dims(time, -1) - self.impulses[:, 0], 0.0, duration)
        cruise = 1 / (duration - self.ramp)
        # Area under the trapezoid: both ramps as parabolas from their own end of the path.
        left = np.minimum(t, duration - t)
        ramped, cruised = cruise * left**2 / (2 * self.ramp), cruise * (left - self.ramp / 2)
        from_end = np.where(left < self.ramp, ramped, cruised)
        u = np.where(2 * t <= duration, from_end, 1 - from_end)
        return np.asarray(_spline_through(self.q)(np.sum(u * self.impulses[:, 1], axis=-1)))


def fastest_trajectory(
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
    path = JointTrajectory(q, 1 / v + ramp, ramp)
    if limits.shaper is None:
        return path
    # A mean of ways that each keep the limits keeps them.
    impulses = limits.shaper.impulses
    return replace(path, duration=path.duration + impulses[-1, 0], impulses=impulses)


def _spline_through(values: Array) -> CubicSpline:
    return CubicSpline(np.linspace(0, 1, len(values)), values)


def _spline_derivatives(values: Array) -> tuple[Array, Array]:
    """First and second derivative by u, at and between the waypoints."""
    spline = _spline_through(values)
    u = np.linspace(0, 1, SPLINE_SAMPLES_PER_WAYPOINT * (len(values) - 1) + 1)
    return np.asarray(spline(u, 1)), np.asarray(spline(u, 2))


WAYPOINT_SPACING: Final = 5e-3
"""Metres between the waypoints of a line; the spline between them strays by micrometres."""

FLANGE_TURN_SPACING: Final = radians(2)
"""Radians the flange turns between waypoints."""

JOINT_TURN_SPACING: Final = radians(4)
"""Radians a joint turns between the waypoints of a path in joint space."""

FEWEST_PIECES: Final = 4
"""Pieces of the shortest path, so that its spline has a cubic to it."""

LARGEST_JOINT_TURN: Final = radians(20)
"""A joint that turns so far between waypoints swings through a singularity, or takes another
configuration because it ran into its limit."""


@dataclass(frozen=True, slots=True)
class PathPlanner:
    """Planner of the moves of an arm that keeps its motion limits.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    limits : MotionLimits
        How fast it may go.
    """

    kinematics: Kinematics
    limits: MotionLimits

    def linear_path(self, q: Array, T_b_f: Array) -> JointTrajectory:
        """Timed path of the flange's origin on a straight line, turning evenly about one axis.

        Parameters
        ----------
        q : ndarray, shape (n,)
            Where it starts, in radians.
        T_b_f : ndarray, shape (4, 4)
            Where the flange ends, in the base frame.

        Raises
        ------
        PoseUnreachable
            As `linear_waypoints` does.
        """
        waypoints, points_b = linear_waypoints(self.kinematics, q, T_b_f)
        return fastest_trajectory(waypoints, points_b, self.kinematics.velocity, self.limits)

    def path_to_joint_angles(self, q: Array, goal: Array) -> JointTrajectory:
        """Timed path on a straight line in joint space, both ends in radians, shape (n,)."""
        waypoints = interpolate_joints(q, goal)
        points_b = np.array([self.kinematics.forward(q)[:3, 3] for q in waypoints])
        return fastest_trajectory(waypoints, points_b, self.kinematics.velocity, self.limits)

    def joint_path(self, q: Array, T_b_f: Array, near: Array | None = None) -> JointTrajectory:
        """Timed path to the configuration nearest to `near`, else to `q`, that holds a pose."""
        goal = self.kinematics.inverse(T_b_f, near=q if near is None else near)
        return self.path_to_joint_angles(q, goal)

    def check_moves(self, q: Array, *T_b_f: Array) -> None:
        """Check a move in joint space and straight lines on from `q`; see `Arm.check_moves`."""
        for i, T in enumerate(T_b_f):
            path = self.linear_path(q, T) if i else self.joint_path(q, T)
            q = path.q[-1]


def linear_waypoints(kinematics: Kinematics, q: Array, T_b_f: Array) -> tuple[Array, Array]:
    """Waypoints of a straight line: joint angles and flange origins, evenly spaced.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    q : ndarray, shape (n,)
        Where it starts, in radians.
    T_b_f : ndarray, shape (4, 4)
        Where the flange ends, in the base frame.

    Returns
    -------
    waypoints : ndarray, shape (m, n)
        Radians.
    points_b : ndarray, shape (m, 3)
        Metres, in the base frame.

    Raises
    ------
    PoseUnreachable
        If the line leaves the reach or the joint limits, or if a joint would have to jump:
        near a singularity, or if it has to turn back from its limit.
    """
    poses_b_f = _poses_on_line(kinematics.forward(q), T_b_f)
    waypoints = [np.asarray(q, dtype=float)]
    for i, T in enumerate(poses_b_f[1:], start=1):
        share = i / (len(poses_b_f) - 1)
        try:
            following = kinematics.inverse(T, near=waypoints[-1])
        except PoseUnreachable as error:
            raise PoseUnreachable(describe_place_on_path(share) + error.reason, T_b_f) from None
        if np.abs(following - waypoints[-1]).max() > LARGEST_JOINT_TURN:
            reason = _explain_joint_jump(kinematics, waypoints[-1], following)
            raise PoseUnreachable(describe_place_on_path(share) + reason, T_b_f)
        waypoints.append(following)
    return np.array(waypoints), poses_b_f[:, :3, 3]


def interpolate_joints(q: Array, goal: Array) -> Array:
    """Joint angles evenly spaced from `q` to `goal`, shape (m, n), in radians."""
    pieces = max(FEWEST_PIECES, ceil(float(np.abs(goal - q).max()) / JOINT_TURN_SPACING))
    return np.linspace(q, goal, pieces + 1)


def _poses_on_line(T_start: Array, T_end: Array) -> Array:
    """Poses on a line, shape (m, 4, 4)."""
    length = float(np.linalg.norm(T_end[:3, 3] - T_start[:3, 3]))
    angle = rotation_angle_between(T_start, T_end)
    pieces = max(FEWEST_PIECES, ceil(length / WAYPOINT_SPACING), ceil(angle / FLANGE_TURN_SPACING))
    u = np.linspace(0, 1, pieces + 1)[:, None]
    turn = pose_vector.rotation_to_vector(T_start[:3, :3].T @ T_end[:3, :3])
    poses = np.tile(np.eye(4), (pieces + 1, 1, 1))
    poses[:, :3, :3] = T_start[:3, :3] @ pose_vector.rotation_from_vector(u * turn)
    poses[:, :3, 3] = (1 - u) * T_start[:3, 3] + u * T_end[:3, 3]
    return poses


def describe_place_on_path(share: float) -> str:
    """Where on the way something happens, to begin a sentence with; nothing for its two ends."""
    return "" if share in (0, 1) else f"{share:.0%} of the way there, "


def _explain_joint_jump(kinematics: Kinematics, q: Array, following: Array) -> str:
    """Why two waypoints close to each other have joint angles far apart."""
    smallest = kinematics.smallest_singular_value(q)
    room = np.minimum(q - kinematics.lower, kinematics.upper - q)
    i = int(room.argmin())
    if room[i] < LARGEST_JOINT_TURN and smallest > SINGULARITY_THRESHOLD:
        return (
            f"{kinematics.joint_names[i]} runs into its limit (it is at {np.degrees(q[i]):.1f} "
            "deg). Start with that joint a turn further from its limit, or move the base."
        )
    i = int(np.abs(following - q).argmax())
    return (
        f"{kinematics.joint_names[i]} would have to swing by "
        f"{np.degrees(following[i] - q[i]):.0f} deg at once: the line passes near a singularity "
        f"(smallest singular value {smallest:.3f}). Move the base, or start from another "
        "configuration."
    )
