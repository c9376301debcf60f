"""A Universal Robots arm behind the `Arm` protocol.

The client library ur-rtde runs in a process of its own (`client`); this one asks it, never
longer than a time limit, and keeps the dashboard at hand to stop the arm without it. Every
move is begun and then followed, so that it can be stopped; the state that the arm reports is
watched with it. After a fault the arm takes no more commands: nothing resumes by itself.

Connecting sets the controller up for poses of the flange.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import NoneType
from typing import Any, Final, Self

import numpy as np

from tjscan.core import errors, pose_vector
from tjscan.core.devices import EventListener
from tjscan.core.frames import Array, inverse_pose
from tjscan.robot.arm import ArmState, MotionLock
from tjscan.robot.following import Following
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.robot.planned import PathPlan, PlannedArm
from tjscan.robot.ur import moving
from tjscan.robot.ur.dashboard import DashboardClient, UrIdentity, read_ur_identity
from tjscan.robot.ur.following import follow_paths
from tjscan.robot.ur.kinematics_info import describe_kinematics_difference, read_kinematics_info
from tjscan.robot.ur.messages import ControllerState, connection_fault, fault_from_state
from tjscan.robot.ur.session import ClientLibraryError, ControllerSession, not_ready_fault
from tjscan.robot.ur.settings import UrSettings

CONTROLLER_SETTING_TIMEOUT: Final = 2.0
"""Seconds within which a program starts or ends, and a value that was set is shown."""

READ_BACK_TOLERANCE: Final = 1e-6
"""Metres, radians or kilograms between a value that was set and the same read back."""

WRONG_ARM_MODEL_DISTANCE: Final = 0.005
"""Metres between the flange as the controller and as the model has it, beyond calibration. Less
than the clearance's default margins: what is planned on the model holds for the arm."""


def connect_to_controller(
    settings: UrSettings, kinematics: Kinematics, latch: MotionLock, note: EventListener
) -> ControllerSession:
    """Connect to the controller, set TCP and payload, and read them back; nothing moves.

    Parameters
    ----------
    settings : UrSettings
        Where it is, and how long to wait for it.
    kinematics : Kinematics
        Which arm it should be.
    latch : MotionLock
        Keeps its moves apart, and stops them.
    note : callable
        Receives the events of the session.

    Raises
    ------
    ArmFault
        If the arm can't be reached or is not ready, each cause by its own error.
    ConfigurationError
        If it is another model than it should be.
    """
    dashboard = DashboardClient(settings.host)
    try:
        if (fault := not_ready_fault(dashboard)) is not None:
            raise fault
        _await_end_of_other_program(dashboard, latch)
        session = ControllerSession(dashboard, settings, latch, note)
    except BaseException:
        dashboard.close()
        raise
    try:
        _begin_session(session, kinematics)
    except BaseException as error:
        if session.fault is None and not isinstance(
            error, (errors.RegistersInUse, errors.ArmNotConnected)
        ):
            session.stop_program(error)  # ours runs, or may
        session.disconnect()
        raise
    return session


def _begin_session(session: ControllerSession, kinematics: Kinematics) -> None:
    host, limit = session.settings.host, session.settings.connect_limit
    try:
        session.ask_client(NoneType, "connect", host, limit=limit)
        _set_up_control_script(session)
        _check_arm_model(session, kinematics)
    except ClientLibraryError as failed:
        words = str(failed)
        raise not_ready_fault(session.dashboard) or connection_fault(host, words) from None


def _set_up_control_script(session: ControllerSession) -> None:
    _await_control_script(session)
    for late in _polls_until_limit(session.latch):  # commands wait for a link of their own
        if session.call_client_method(bool, "start_watchdog") or late:
            break
    _set_tcp(session)
    _set_payload(session)


def _polls_until_limit(latch: MotionLock) -> Iterator[bool]:
    """Let a moment pass between two polls; true once the limit is over."""
    limit = time.monotonic() + CONTROLLER_SETTING_TIMEOUT
    while True:
        yield time.monotonic() > limit
        latch.wait_for_stop(moving.MOVE_POLL_PERIOD)


def _await_end_of_other_program(dashboard: DashboardClient, latch: MotionLock) -> None:
    """See that no program runs: the client library would end it without asking.

    The dashboard is slow to report a program's end.
    """
    for late in _polls_until_limit(latch):
        if dashboard.ask_dashboard_value("running").lower() != "true":
            return
        if late:
            raise errors.ArmBusy(
                "another program runs on the arm's controller. End it on the pendant, or end "
                "the program that sent it, then start again."
            )


def _await_control_script(session: ControllerSession) -> None:
    """Let both links show the program that was started."""
    for late in _polls_until_limit(session.latch):
        now = session.ask_client(ControllerState, "read_state", limit=CONTROLLER_SETTING_TIMEOUT)
        fault = fault_from_state(now)
        if fault is None:
            return
        if late or not isinstance(fault, errors.ProgramStopped):
            raise fault


def _set_tcp(session: ControllerSession) -> None:
    """Put the TCP on the flange itself: poses mean the flange, whatever the pendant had set."""
    session.call_client_method(bool, "set_tcp", (0.0,) * 6)
    offset = session.call_client_method(list, "active_tcp_offset")
    if len(offset) != 6 or np.abs(offset).max() > READ_BACK_TOLERANCE:
        session.read_state()  # the true reason, if the arm is not well
        raise _setting_ignored_error("TCP", "zero", offset)
    session.T_tcp_f = inverse_pose(pose_vector.pose_from_vector(offset))


def _set_payload(session: ControllerSession) -> None:
    mass, centre = session.settings.payload, session.settings.payload_centre
    if mass is None:
        return
    session.call_client_method(bool, "set_payload", mass, centre)
    for late in _polls_until_limit(session.latch):
        now = session.read_state()
        if _payload_is_set(now, np.array([mass, *centre])):
            return
        if late:
            raise _setting_ignored_error("payload", f"{mass:g} kg", now.payload)


def _payload_is_set(now: ControllerState, wanted: Array) -> bool:
    """Whether the payload is the one asked for, or is not reported at all."""
    if now.payload is None or now.centre_of_gravity is None:
        return True
    carried = np.array([now.payload, *now.centre_of_gravity])
    return bool(np.abs(carried - wanted).max() < READ_BACK_TOLERANCE)


def _check_arm_model(session: ControllerSession, kinematics: Kinematics) -> None:
    state = session.arm_state()
    apart = np.linalg.norm(kinematics.forward(state.q)[:3, 3] - state.T_b_f[:3, 3])
    if apart > WRONG_ARM_MODEL_DISTANCE:
        raise errors.ConfigurationError(
            f"the controller has its flange {1e3 * apart:.0f} mm from where a "
            f"{kinematics.name} with these joint angles has it: name the "
            "right arm, or check the mounting in its installation",
            key="arm.model",
        )


def _setting_ignored_error(what: str, wanted: str, found: object) -> errors.ArmFault:
    return errors.ArmFault(
        f"the controller was asked to set its {what} to {wanted} and reports {found}. See "
        "that no other program works with it, then start again."
    )


class UrArm(PlannedArm):
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
        super().__init__(kinematics, limits)
        self.settings = settings
        self._session: ControllerSession | None = None
        self._identity = UrIdentity()

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
        settings, latch = self.settings, self._latch
        session = connect_to_controller(
            settings, self.kinematics, latch, lambda *event: self._listener(*event)
        )
        try:
            stated = read_kinematics_info(settings.host)
            self._identity = read_ur_identity(
                session.dashboard,
                session.read_state().payload,
                "" if stated is None else describe_kinematics_difference(stated, self.kinematics),
            )
        except BaseException as error:
            session.end_program_and_disconnect(error)
            raise
        self._session = session
        return self

    def __exit__(self, *error: Any) -> None:
        """Stop, end the program on the controller, and disconnect."""
        self.stop()
        session, self._session = self._session, None
        if session is not None:
            session.end_program_and_disconnect(error[1])

    @property
    def identity(self) -> UrIdentity:
        """Which arm it is; known while connected."""
        self._connected_session  # noqa: B018 - refuses
        return self._identity

    def state(self) -> ArmState:
        """Joint angles, flange pose and time, as the controller reports them."""
        return self._connected_session.arm_state()

    def run_program(self, program: moving.UrProgram, started: Callable[[], object]) -> None:
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
        session = self._connected_session
        with self._latch.hold_for_move():
            moving.run_program(session, program, started)

    @contextmanager
    def follow(self) -> Iterator[Following]:
        """Follow paths that grow. See `FollowingArm.follow`."""
        session = self._connected_session
        with self._latch.hold_for_move():
            try:
                with follow_paths(session) as following:
                    yield following
            finally:
                if session.fault is None:
                    _set_up_control_script(session)

    @property
    def _connected_session(self) -> ControllerSession:
        if self._session is None:
            raise errors.ArmFault("the arm is not connected: use it inside a 'with' block")
        return self._session

    def _move(self, plan: PathPlan, T_b_f: Array, *, linear: bool) -> ArmState:
        session = self._connected_session
        with self._latch.hold_for_move():
            q = session.arm_state().q
            path = plan(q)
            # A controller's move without length ends before it is seen to begin.
            if np.abs(path.q - q).max() > moving.LEAST_MOVING_TURN:
                moving.check_target_is_safe(session, T_b_f)
                if linear:
                    command = moving.linear_command(self.kinematics, session, path, T_b_f)
                else:
                    command = moving.joint_command(session, path, T_b_f)
                moving.execute_move(session, command, T_b_f)
            return moving.await_arrival(session, T_b_f)
