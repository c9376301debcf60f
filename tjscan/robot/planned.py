"""What all arms share whose moves this program plans: checks, straight moves, and stops."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from tjscan.core.devices import DeviceBase
from tjscan.core.frames import Array
from tjscan.robot.arm import ArmState, MotionLock
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import JointTrajectory, MotionLimits, PathPlanner

PathPlan = Callable[[Array], JointTrajectory]
"""Plans a path from joint angles, shape (n,), in radians."""


class PlannedArm(DeviceBase, ABC):
    """Base of arms whose moves this program plans.

    Parameters
    ----------
    kinematics : Kinematics
        The arm as its maker draws it.
    limits : MotionLimits, optional
        How fast it may move.
    """

    def __init__(self, kinematics: Kinematics, limits: MotionLimits | None) -> None:
        self.kinematics = kinematics
        self._planner = PathPlanner(kinematics, MotionLimits() if limits is None else limits)
        self._latch = MotionLock()

    @abstractmethod
    def state(self) -> ArmState:
        """Joint angles, flange pose and time, as the arm reads them now."""

    @abstractmethod
    def _move(self, plan: PathPlan, T_b_f: Array, *, linear: bool) -> ArmState:
        """Plan a path to a pose, move along it, and return the state reached."""

    def check_moves(self, *T_b_f: Array) -> None:
        """Check that moves are possible, without moving; see `Arm.check_moves`."""
        self._planner.check_moves(self.state().q, *T_b_f)

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Move the flange on a straight line to a pose. See `Arm.move_linear`.

        Raises
        ------
        TargetRefused
            Before anything moves, if the controller holds the pose for unsafe.
        PoseNotReached
            If the arm came to rest somewhere else. It takes no more commands then.
        """
        return self._move(lambda q: self._planner.linear_path(q, T_b_f), T_b_f, linear=True)

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        """Move to the nearest configuration that holds a pose. See `move_linear`."""
        return self._move(lambda q: self._planner.joint_path(q, T_b_f, near), T_b_f, linear=False)

    def stop(self) -> None:
        """Bring the arm to rest, and begin nothing more. See `Arm.stop`."""
        self._latch.stop()

    def accept_moves_again(self) -> None:
        """Take commands again after a stop. See `Arm.accept_moves_again`."""
        self._latch.clear_stop()
