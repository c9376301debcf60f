"""A Universal Robots arm behind the `Arm` protocol.

The client library ur-rtde runs in a process of its own (`client`); this one asks it, never
longer than a time limit, and keeps the dashboard at hand to stop the arm without it. Every
move is begun and then followed, so that it can be stopped; the state that the arm reports is
watched with it. After a fault the arm takes no more commands: nothing resumes by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Self

from tjscan.core.devices import DeviceBase, EventListener
from tjscan.core.errors import ArmFault
from tjscan.core.frames import Array
from tjscan.robot.arm import ArmState
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.motion import JointTrajectory, MotionLimits
from tjscan.robot.motion_lock import MotionLock
from tjscan.robot.path import PathPlanner
from tjscan.robot.ur.commands import MoveCommand, joint_command, linear_command
from tjscan.robot.ur.connecting import connect_to_controller
from tjscan.robot.ur.dashboard import UrIdentity, read_ur_identity
from tjscan.robot.ur.kinematics_info import read_controller_kinematics
from tjscan.robot.ur.moving import POLL_PERIOD, await_arrival, check_target_is_safe, execute_move
from tjscan.robot.ur.program import UrProgram, run_program
from tjscan.robot.ur.session import ControllerSession
from tjscan.robot.ur.settings import UrSettings


class UrArm(DeviceBase):
    """A Universal Robots arm, or the loopback controller in its place.

    Parameters
    ----------
    kinematics : Kinematics
        The arm as its maker draws it; if it differs by its calibration, the controller's
        poses hold.
    settings : UrSettings
        Where it is.
    limits : MotionLimits, optional
        How fast it may move.
    """

    def __init__(
        self, kinematics: Kinematics, settings: UrSettings, limits: MotionLimits | None = None
    ) -> None:
        self.kinematics, self.settings = kinematics, settings
        self._planner = PathPlanner(kinematics, MotionLimits() if limits is None else limits)
        self._session: ControllerSession | None = None
        self._identity: UrIdentity | None = None
        self._latch = MotionLock()
        self._listener: EventListener | None = None

    def __enter__(self) -> Self:
        """Connect, set TCP and payload, and read them back; nothing moves.

        Raises
        ------
        ArmFault
            If the arm can't be reached or is not ready, each cause by its own error.
        ConfigurationError
            If it is another model than it should be.
        """
        self._latch.clear_stop()
        session = connect_to_controller(
            self.settings,
            self.kinematics,
            partial(self._latch.wait_for_stop, POLL_PERIOD),
            self._note,
        )
        try:
            stated = read_controller_kinematics(self.settings.host)
            self._identity = read_ur_identity(
                session.dashboard,
                session.read_state().payload,
                "" if stated is None else stated.compared_with(self.kinematics),
            )
        except BaseException as error:
            session.end_program_and_disconnect(error)
            raise
        self._session = session
        return self

    def __exit__(self, *error: Any) -> None:
        """Stop, end the program on the controller, and disconnect."""
        self.stop()
        session, self._session, self._identity = self._session, None, None
        if session is not None:
            session.end_program_and_disconnect(error[1])

    @property
    def identity(self) -> UrIdentity:
        """Which arm it is; known while connected."""
        if self._identity is None:
            raise ArmFault("the arm is not connected: use it inside a 'with' block")
        return self._identity

    def report_events_to(self, listener: EventListener) -> None:
        """Report events to a listener: that the dashboard was connected again."""
        self._listener = listener

    def state(self) -> ArmState:
        """Joint angles, flange pose and time, as the controller reports them."""
        return self._connected.arm_state()

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
        order = partial(linear_command, self.kinematics)
        return self._move(T_b_f, self._planner.linear_path, order)

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        """Move to the nearest configuration that holds a pose. See `move_linear`."""
        return self._move(T_b_f, partial(self._planner.joint_path, near=near), joint_command)

    def run_program(self, program: UrProgram, started: Callable[[], object]) -> None:
        """Run a program in URScript to its end; the arm takes no moves after it.

        Parameters
        ----------
        program : UrProgram
            The program.
        started : callable
            Is called once it runs.

        Raises
        ------
        ArmFault
            As `program.run_program` does. The program is stopped then.
        """
        session = self._connected
        with self._latch.hold_for_move():
            run_program(session, self._latch, self.settings, program, started)

    def stop(self) -> None:
        """Bring the arm to rest, and begin nothing more. See `Arm.stop`."""
        self._latch.stop()

    def accept_moves_again(self) -> None:
        """Take commands again after a stop. See `Arm.accept_moves_again`."""
        self._latch.clear_stop()

    def _note(self, name: str, detail: str) -> None:
        if self._listener is not None:
            self._listener(name, detail)

    @property
    def _connected(self) -> ControllerSession:
        if self._session is None:
            raise ArmFault("the arm is not connected: use it inside a 'with' block")
        return self._session

    def _move(
        self,
        T_b_f: Array,
        plan: Callable[[Array, Array], JointTrajectory],
        order: Callable[[ControllerSession, JointTrajectory, Array], MoveCommand],
    ) -> ArmState:
        session = self._connected
        with self._latch.hold_for_move():
            path = plan(session.arm_state().q, T_b_f)
            if path.duration > 0:
                check_target_is_safe(session, T_b_f)
                execute_move(session, self._latch, order(session, path, T_b_f), T_b_f)
            return await_arrival(session, self._latch, self.settings, T_b_f)
