"""Straight paths: a line of the flange in space, and a line in joint space."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, radians
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array, rotation_angle_between
from tjscan.robot.kinematics import SINGULARITY_THRESHOLD, Kinematics
from tjscan.robot.motion import JointTrajectory, MotionLimits, fastest_joint_path

WAYPOINT_SPACING: Final = 5e-3
"""Metres between the waypoints of a line; the spline between them strays by micrometres."""

TURN_SPACING: Final = radians(2)
"""Radians the flange turns between waypoints."""

JOINT_SPACING: Final = radians(4)
"""Radians a joint turns between the waypoints of a path in joint space."""

FEWEST_PIECES: Final = 4
"""Pieces of the shortest path, so that its spline has a cubic to it."""

LARGEST_TURN: Final = radians(20)
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
        return fastest_joint_path(waypoints, points_b, self.kinematics.velocity, self.limits)

    def path_to_joint_angles(self, q: Array, goal: Array) -> JointTrajectory:
        """Timed path on a straight line in joint space, both ends in radians, shape (n,)."""
        waypoints = interpolate_joints(q, goal)
        points_b = np.array([self.kinematics.forward(q)[:3, 3] for q in waypoints])
        return fastest_joint_path(waypoints, points_b, self.kinematics.velocity, self.limits)

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
            raise PoseUnreachable(place_on_path(share) + error.reason, T_b_f) from None
        if np.abs(following - waypoints[-1]).max() > LARGEST_TURN:
            reason = _reason_of_jump(kinematics, waypoints[-1], following)
            raise PoseUnreachable(place_on_path(share) + reason, T_b_f)
        waypoints.append(following)
    return np.array(waypoints), poses_b_f[:, :3, 3]


def interpolate_joints(q: Array, goal: Array) -> Array:
    """Joint angles evenly spaced from `q` to `goal`, shape (m, n), in radians."""
    pieces = max(FEWEST_PIECES, ceil(float(np.abs(goal - q).max()) / JOINT_SPACING))
    return np.linspace(q, goal, pieces + 1)


def _poses_on_line(T_start: Array, T_end: Array) -> Array:
    """Poses on a line, shape (m, 4, 4)."""
    length = float(np.linalg.norm(T_end[:3, 3] - T_start[:3, 3]))
    angle = rotation_angle_between(T_start, T_end)
    pieces = max(FEWEST_PIECES, ceil(length / WAYPOINT_SPACING), ceil(angle / TURN_SPACING))
    u = np.linspace(0, 1, pieces + 1)[:, None]
    turn = pose_vector.rotation_to_vector(T_start[:3, :3].T @ T_end[:3, :3])
    poses = np.tile(np.eye(4), (pieces + 1, 1, 1))
    poses[:, :3, :3] = T_start[:3, :3] @ pose_vector.rotation_from_vector(u * turn)
    poses[:, :3, 3] = (1 - u) * T_start[:3, 3] + u * T_end[:3, 3]
    return poses


def place_on_path(share: float) -> str:
    """Where on the way something happens, to begin a sentence with; nothing for its two ends."""
    return "" if share in (0, 1) else f"{share:.0%} of the way there, "


def _reason_of_jump(kinematics: Kinematics, q: Array, following: Array) -> str:
    """Why two waypoints close to each other have joint angles far apart."""
    smallest = kinematics.smallest_singular_value(q)
    room = np.minimum(q - kinematics.lower, kinematics.upper - q)
    i = int(room.argmin())
    if room[i] < LARGEST_TURN and smallest > SINGULARITY_THRESHOLD:
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
