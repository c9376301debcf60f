"""Deviations of an arm's joints from their places in its model: offset, length and twist.

The frame of each joint is off by a small motion in its own axes: a translation (a length), a tilt
of its axis (a twist) and a turn about it (an offset). Six numbers a joint are more than the flange
can show, and stay regular where axes are parallel, as the axes of joints 2, 3 and 4 of a Universal
Robots arm are (Hayati and Mirmirani 1985, Improving the absolute positioning accuracy of robot
manipulators, J. Robotic Systems 2(4), on why DH parameters do not).

`CorrectedArm` corrects the poses of any arm by what a calibration found of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Self

import numpy as np

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.pose_vector import pose_from_vector
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.following import Following, FollowingThrough, check_can_follow
from tjscan.robot.kinematics import Kinematics


def joint_axis_bases(kinematics: Kinematics) -> Array:
    """Rotations that take a frame whose z is the joint's axis into the joint's, shape (n, 3, 3)."""
    bases = []
    for axis in kinematics.joint_axes:
        x, y = np.linalg.svd(axis[None])[2][1:]
        upright = np.eye(3) if np.allclose(axis, (0, 0, 1)) else np.column_stack((x, y, axis))
        bases.append(upright * (1, np.sign(np.linalg.det(upright)), 1))
    return np.array(bases)


def deviate_joint_frames(kinematics: Kinematics, deviations: Array) -> Kinematics:
    """Return the arm with its joints' frames moved by small motions.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    deviations : ndarray, shape (n, 6)
        Translation (metres) and rotation vector of each joint's frame, in axes of its own whose
        z is the joint's axis; see `joint_axis_bases`.
    """
    own = np.asarray(deviations, dtype=float).reshape(-1, 2, 3)
    in_joint = np.einsum("nij,nkj->nki", joint_axis_bases(kinematics), own).reshape(-1, 6)
    moves = np.array([pose_from_vector(step) for step in in_joint])
    return kinematics.with_joint_placements(kinematics.joint_placements @ moves)


def deviation_jacobian(kinematics: Kinematics, q: Array) -> Array:
    """Motion of the flange for small deviations, shape (6, n, 6), in the axes of f.

    Translation (metres) and rotation (radians), by the deviations of `deviate_joint_frames`.
    """
    J = kinematics.placement_jacobian(q).reshape(6, -1, 2, 3)
    turned = np.einsum("knci,nij->kncj", J, joint_axis_bases(kinematics))
    return np.asarray(turned.reshape(6, -1, 6))


def deviations_of_longer_links(kinematics: Kinematics) -> Array:
    """Deviations of an arm whose links are longer by their own length, shape (n, 6).

    What the last joint carries stays as it is.
    """
    placements = kinematics.joint_placements
    own = np.einsum("nji,nj->ni", placements[:, :3, :3], placements[:, :3, 3])
    along = np.einsum("nji,nj->ni", joint_axis_bases(kinematics), own)
    return np.hstack((along, np.zeros_like(along)))


class CorrectedArm:
    """An arm that takes and reports true poses of its flange, as far as a calibration knows.

    The arm itself goes on planning with its own kinematics. Its poses are corrected by the motion
    from where the model has the flange at its joint angles to where the calibrated model has it,
    as they were when it was calibrated. Between the ends of a line the flange is where the arm
    leads it: micrometres off.

    Parameters
    ----------
    arm : Arm
        The arm.
    model, calibrated : Kinematics
        Its model, and the same with the deviations found.
    """

    def __init__(self, arm: Arm, model: Kinematics, calibrated: Kinematics) -> None:
        self._arm, self._model, self._calibrated = arm, model, calibrated

    def __enter__(self) -> Self:
        """Connect the arm."""
        self._arm.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        """Stop and disconnect the arm."""
        self._arm.__exit__(*error)

    @property
    def identity(self) -> DeviceIdentity:
        """Which arm it is; known while connected."""
        return self._arm.identity

    def report_events_to(self, listener: EventListener) -> None:
        """Report the arm's events to a listener from now on."""
        self._arm.report_events_to(listener)

    def state(self) -> ArmState:
        """Joint angles, flange pose and time. See `Arm.state`."""
        return self._correct_state(self._arm.state())

    def check_moves(self, *T_b_f: Array) -> None:
        """Check that moves are possible, without moving. See `Arm.check_moves`."""
        q, commanded = self._arm.state().q, []
        for T in T_b_f:
            q = self._calibrated.inverse(T, near=q)
            commanded.append(self._pose_to_command(T, q))
        self._arm.check_moves(*commanded)

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Move the flange on a straight line to a pose. See `Arm.move_linear`."""
        q = self._calibrated.inverse(T_b_f, near=self._arm.state().q)
        return self._correct_state(self._arm.move_linear(self._pose_to_command(T_b_f, q)))

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        """Move to the nearest configuration that holds a pose. See `Arm.move_joint_to_pose`."""
        q = self._calibrated.inverse(T_b_f, near=self._arm.state().q if near is None else near)
        commanded = self._pose_to_command(T_b_f, q)
        return self._correct_state(self._arm.move_joint_to_pose(commanded, near, direct=direct))

    @property
    def moving_arm(self) -> Arm:
        """The arm that moves."""
        return self._arm

    @contextmanager
    def follow(self) -> Iterator[Following]:
        """Follow paths that grow. See `FollowingArm.follow`."""
        with check_can_follow(self._arm).follow() as following:
            yield FollowingThrough(following, correct=self._correct_state)

    def stop(self) -> None:
        """Bring the arm to rest now. See `Arm.stop`."""
        self._arm.stop()

    def accept_moves_again(self) -> None:
        """Take commands again after a stop. See `Arm.accept_moves_again`."""
        self._arm.accept_moves_again()

    def _correct_state(self, state: ArmState) -> ArmState:
        further = inverse_pose(self._model.forward(state.q)) @ self._calibrated.forward(state.q)
        return ArmState(state.q, state.T_b_f @ further, state.time)

    def _pose_to_command(self, T_b_f: Array, q: Array) -> Array:
        """Pose to command so that the flange truly gets to a pose."""
        back = inverse_pose(self._calibrated.forward(q)) @ self._model.forward(q)
        return T_b_f @ back
