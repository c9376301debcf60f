"""Commands to one controller and its replies while it is connected, and how that ends."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from types import NoneType
from typing import Final, TypeVar

import numpy as np

from tjscan.core import errors, pose_vector
from tjscan.core.devices import EventListener
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.process import ClientProcess
from tjscan.robot.arm import ArmState, MotionLock
from tjscan.robot.ur import messages
from tjscan.robot.ur.dashboard import DashboardClient
from tjscan.robot.ur.settings import UrSettings

T = TypeVar("T")

CLIENT_ANSWER_LIMIT: Final = 3.0
"""Seconds within which the client answers anything but a connection."""

MOVE_STOP_DECELERATION: Final = 2.0
"""rad/s² of the leading axis when a move is stopped."""

NEXT_STATE_REPORT_DELAY: Final = 0.02
"""Seconds after which the controller has reported again."""

ANSWER_SLACK: Final = 1.0
"""Seconds that the client's process may take for itself on a busy machine."""

RECONNECT_WAIT_SHARE: Final = 0.3
"""Share of the controller's longest silence for which a dashboard's new connection is waited for,
and as long for its greeting: a move goes unfollowed meanwhile."""


class ClientLibraryError(Exception):
    """The client library raised an error, which the driver interprets."""


class ControllerSession:
    """Session with a controller: reads and commands; none is passed on after a fault.

    Parameters
    ----------
    dashboard : DashboardClient
        To stop the arm without the client.
    settings : UrSettings
        Its address, limits and tolerances.
    latch : MotionLock
        Keeps moves apart, and stops them.
    note : callable
        Receives events.
    """

    def __init__(
        self,
        dashboard: DashboardClient,
        settings: UrSettings,
        latch: MotionLock,
        note: EventListener,
    ) -> None:
        self.dashboard, self.settings, self.latch, self._note = dashboard, settings, latch, note
        self.link = ClientProcess(
            "tjscan.robot.ur.client",
            "the arm's controller",
            errors.ArmConnectionLost,
            errors.ArmNotResponding,
        )
        self.fault: errors.ArmFault | None = None
        self.T_tcp_f = np.eye(4)
        """The flange in the active TCP, shape (4, 4)."""
        self._clock: float | None = None
        self._advanced = self._seen = 0.0

    def read_state(
        self, *, supervising_move: bool = False, beside_program: bool = False
    ) -> messages.ControllerState:
        """Read the controller's state; raises the arm's fault if there is one.

        Parameters
        ----------
        supervising_move : bool, optional
            During a move: the client stops the arm if this is not done for long.
        beside_program : bool, optional
            While a program of ours runs in place of the control script, or has ended.

        Raises
        ------
        ArmFault
            What is wrong with it; the session has ended then.
        """
        self._check_no_fault()
        limit = self.settings.silence_limit + ANSWER_SLACK
        name = "read_state_marking_followed" if supervising_move else "read_state"
        try:
            now = self.ask_client(messages.ControllerState, name, limit=limit)
            self._check_clock_advances(now)
            shown = replace(now, runtime_state=messages.PROGRAM_PLAYING) if beside_program else now
            fault = messages.fault_from_state(shown)
            if isinstance(fault, errors.ProgramStopped):  # blames people: confirm it first
                time.sleep(NEXT_STATE_REPORT_DELAY)
                now = self.ask_client(messages.ControllerState, name, limit=limit)
                fault = messages.fault_from_state(now)
        except errors.ArmFault as found:
            fault = found
        except ClientLibraryError as failed:
            fault = errors.ArmConnectionLost(
                f"the connection to the arm's controller broke ({failed})."
            )
        if fault is not None:
            raise self.end_session_for_fault(fault)
        return now

    def ask_client(
        self, kind: type[T], name: str, *arguments: object, limit: float = CLIENT_ANSWER_LIMIT
    ) -> T:
        """Call a method of the client in its process, and return what it returns.

        Parameters
        ----------
        kind : type
            Of the value.
        name : str
            A method of `client.RtdeClient`.
        *arguments : object
            What it takes.
        limit : float, optional
            Seconds to wait.

        Raises
        ------
        ArmNotResponding
            If the client does not answer in time. It is ended then.
        ArmConnectionLost
            If the client's process died.
        MoveSupervisionLost
            If the client had to stop a move because this process was held up.
        ClientLibraryError
            If the client library raised something.
        """
        answer = self.link.call_method(name, *arguments, limit=limit)
        if answer.failure == messages.NOT_SUPERVISED:
            raise errors.MoveSupervisionLost(
                "this program paused while the arm moved, and the arm was stopped on its "
                "way. See that the way is clear, and that nothing holds this computer up, then "
                "start again."
            )
        if answer.failure is not None:
            raise ClientLibraryError(answer.failure)
        if not isinstance(answer.value, kind):
            raise ClientLibraryError(f"{name} gave {answer.value!r}")
        return answer.value

    def arm_state(self) -> ArmState:
        """Read joint angles, flange pose and time; raises as `read_state` does."""
        return self.arm_state_from(self.read_state())

    def arm_state_from(self, now: messages.ControllerState) -> ArmState:
        """Convert a controller's state to joint angles, flange pose and time."""
        T_b_f = pose_vector.pose_from_vector(now.tcp) @ self.T_tcp_f
        return ArmState(np.array(now.q), T_b_f, now.time)

    def active_tcp_pose(self, T_b_f: Array) -> tuple[float, ...]:
        """Pose of the active TCP, as the controller takes it, for a pose of the flange."""
        return tuple(pose_vector.pose_to_vector(T_b_f @ inverse_pose(self.T_tcp_f)).tolist())

    def check_commands_are_answered(self) -> None:
        """Check that the controller carries out commands: it is asked for the TCP it was given.

        Raises
        ------
        ArmFault
            If it does not answer; the session has ended then.
        """
        if len(self.call_client_method(list, "active_tcp_offset")) != 6:
            self.read_state()  # the true reason, if the arm is not well
            raise self.end_session_for_fault(
                errors.ArmNotResponding(
                    "the arm's controller no longer carries out what it is asked. See that its "
                    "network cable sits and read its pendant's log, then start again."
                )
            )

    def ensure_dashboard_answers(self) -> None:
        """See that the dashboard answers, while nothing moves; connect it again if it does not.

        It is the way to stop the arm that needs no client.

        Raises
        ------
        ArmFault
            If it can't be connected again; the session has ended then.
        """
        try:
            self.dashboard.ask_dashboard("running")
        except errors.ArmNotResponding as lost:
            self._reconnect_dashboard(lost)

    def ensure_dashboard_connected(self) -> None:
        """See that the dashboard has not hung up; during a move, for it waits for no answer."""
        if self.dashboard.has_hung_up:
            self._reconnect_dashboard(errors.ArmNotResponding("the dashboard hung up."))

    def _reconnect_dashboard(self, lost: errors.ArmFault) -> None:
        try:
            self.dashboard.connect_again(RECONNECT_WAIT_SHARE * self.settings.silence_limit)
        except errors.ArmFault:
            self.stop_move()
            raise self.end_session_for_fault(
                errors.ArmConnectionLost(
                    f"{lost} It could not be connected again, and without it there is no second "
                    "way to stop the arm: the arm was stopped. See that its network cable sits and "
                    "the dashboard service is enabled, then start again."
                )
            ) from None
        self._note("dashboard", "the connection was lost, and made again")

    def call_client_method(self, kind: type[T], name: str, *arguments: object) -> T:
        """Call a method of the client process; what the client raises becomes the arm's fault."""
        try:
            self._check_no_fault()
            return self.ask_client(kind, name, *arguments)
        except ClientLibraryError as failed:
            self.read_state()  # the true reason, if the arm is not well
            raise self.end_session_for_fault(
                errors.ArmFault(f"the client library failed at {name}: {failed}. Start again.")
            ) from None
        except errors.ArmFault as fault:
            raise self.end_session_for_fault(fault) from None

    def stop_move(self) -> None:
        """Stop the move under way; the session goes on if the arm is well."""
        if self.fault is None:
            try:
                self.ask_client(NoneType, "stop_move", MOVE_STOP_DECELERATION)
            except (errors.ArmFault, ClientLibraryError) as failed:
                fault = (
                    failed if isinstance(failed, errors.ArmFault) else errors.ArmFault(str(failed))
                )
                self.end_session_for_fault(fault)

    def end_session_for_fault(self, fault: errors.ArmFault) -> errors.ArmFault:
        """End the session for a fault: stop the arm by whatever still works; returns the fault."""
        if self.fault is None:
            self.fault = fault
            # First: a client whose link broke would start its own program when that comes back.
            self.link.close()
            self.fault = self._find_cause_of_silence(fault)
            self.stop_program(self.fault)
        return self.fault

    def stop_program(self, because: BaseException) -> None:
        """Stop our program and all motion through the dashboard; note it if that fails."""
        try:
            self.dashboard.stop_program()
        except errors.ArmFault as unheard:
            advice = "Press the emergency stop if the arm still moves."
            because.add_note(f"What is more, {unheard} {advice}")

    def end_program_and_disconnect(self, because: BaseException | None) -> None:
        """End the control script and disconnect.

        Parameters
        ----------
        because : BaseException or None
            What ended the work, if it did not end well.

        Raises
        ------
        ArmFault
            If the program could not be ended, and nothing else went wrong.
        """
        try:
            if self.fault is None:
                self.ask_client(NoneType, "stop_control_script")
        except (errors.ArmFault, ClientLibraryError):
            if because is None:
                self.dashboard.stop_program()
            else:
                self.stop_program(because)
        finally:
            self.disconnect()

    def disconnect(self) -> None:
        """Disconnect client process and dashboard."""
        self.link.close()
        self.dashboard.close()

    def _check_no_fault(self) -> None:
        if self.fault is not None:
            raise self.fault

    def _check_clock_advances(self, now: messages.ControllerState) -> None:
        """Check that the controller's clock advances: stale readings still return."""
        moment, limit = time.monotonic(), self.settings.silence_limit
        # Between two readings nothing is known: a pause between them counts for nothing.
        if now.time != self._clock or moment - self._seen > limit / 4:
            self._clock, self._advanced = now.time, moment
        self._seen = moment
        if moment - self._advanced > limit:
            raise errors.ArmNotResponding(
                f"the controller's clock remains at {now.time:.3f} s for {limit:g} s: it "
                "is silent. Look at its pendant and cable, then start again."
            )

    def _find_cause_of_silence(self, fault: errors.ArmFault) -> errors.ArmFault:
        """Why the program stopped or the controller is silent, if the dashboard knows."""
        if isinstance(fault, (errors.ProgramStopped, errors.ArmNotResponding)):
            with suppress(errors.ArmFault):
                found = not_ready_fault(self.dashboard)
                if found is None and isinstance(fault, errors.ArmNotResponding):
                    fault.add_note(
                        "Its dashboard does answer: either this computer was held up, or only the "
                        "connection for data (RTDE) hangs."
                    )
                return found or fault
        return fault


def not_ready_fault(dashboard: DashboardClient) -> errors.ArmFault | None:
    """Fault that keeps the arm from moving, by its dashboard; None if it is ready."""
    return (
        messages.fault_of_safety_mode(dashboard.ask_dashboard_value("safetystatus"))
        or messages.fault_of_robot_mode(dashboard.ask_dashboard_value("robotmode"))
        or messages.fault_of_local_control(dashboard.ask_dashboard("is in remote control"))
    )
