"""From a planned path to the command that the controller takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.errors import TargetRefused
from tjscan.core.frames import Array
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.motion import JointTrajectory
from tjscan.robot.ur.session import ControllerSession

NO_LENGTH: Final = 1e-6
"""Metres: a shorter line is none."""

LARGEST_SWING: Final = 0.005
"""Metres that the flange may swing aside while it turns on the spot, within any margin."""

OTHER_CONFIGURATION: Final = 0.1
"""Radians between the controller's inverse and ours, beyond calibration."""

FASTEST_JOINT: Final = 3.0
"""rad/s: the client library refuses more than 3.14."""

LARGEST_ACCELERATION: Final = 39.0
"""rad/s²: the client library refuses more than 40."""


@dataclass(frozen=True, slots=True)
class MoveCommand:
    """Command of a move as the client takes it: its kind, target, speed and acceleration.

    Parameters
    ----------
    name : str
        A method of `client.RtdeClient`.
    target : tuple of float
        Pose of the TCP, or joint angles.
    speed, acceleration : float
        Of the flange in m/s and m/s², or of the leading joint in rad/s and rad/s².
    """

    name: str
    target: tuple[float, ...]
    speed: float
    acceleration: float


def linear_command(
    kinematics: Kinematics, session: ControllerSession, path: JointTrajectory, T_b_f: Array
) -> MoveCommand:
    """Command that moves the flange on a straight line along a path that ends at a pose.

    Raises
    ------
    TargetRefused
        If it turns on the spot, and swings the flange aside.
    """
    way = kinematics.forward(path.q[-1])[:3, 3] - kinematics.forward(path.q[0])[:3, 3]
    length = float(np.linalg.norm(way))
    if length < NO_LENGTH:
        return _turn_command(kinematics, session, path, T_b_f)
    return MoveCommand("move_linear", session.active_tcp_pose(T_b_f), *_bounds(path, length))


def joint_command(session: ControllerSession, path: JointTrajectory, T_b_f: Array) -> MoveCommand:
    """Command that moves in joint space along a path that ends at a pose.

    The controller knows how its arm differs from the drawing; ours is the configuration.

    Raises
    ------
    TargetRefused
        If the controller has the pose in another configuration.
    """
    goal = path.q[-1]
    q = np.array(
        session.call_client_method(
            list, "inverse", session.active_tcp_pose(T_b_f), tuple(goal.tolist())
        )
    )
    if q.shape != goal.shape or np.abs(q - goal).max() > OTHER_CONFIGURATION:
        session.read_state()  # the true reason, if the arm is not well
        raise TargetRefused("it finds no configuration near the one planned.", T_b_f)
    speed, acceleration = _bounds(path, float(np.abs(goal - path.q[0]).max()))
    return MoveCommand(
        "move_joint",
        tuple(q.tolist()),
        min(speed, FASTEST_JOINT),
        min(acceleration, LARGEST_ACCELERATION),
    )


def _turn_command(
    kinematics: Kinematics, session: ControllerSession, path: JointTrajectory, T_b_f: Array
) -> MoveCommand:
    """A line without length: a speed of the flange bounds no turn, speeds of joints do."""
    straight = path.q[0] + np.linspace(0, 1, 9)[:, None] * (path.q[-1] - path.q[0])
    places = np.array([kinematics.forward(q)[:3, 3] for q in straight])
    if np.linalg.norm(places - places[0], axis=1).max() > LARGEST_SWING:
        raise TargetRefused(
            "a turn this wide on the spot would swing the flange aside; turn in parts.", T_b_f
        )
    return joint_command(session, path, T_b_f)


def _bounds(path: JointTrajectory, length: float) -> tuple[float, float]:
    """Speed and acceleration along a path of this length that take as long as it does."""
    speed = length / (path.duration - path.ramp)
    return speed, speed / path.ramp
