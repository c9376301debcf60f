"""The client library in a process of its own: ``python -m tjscan.robot.ur.client SOCKET``.

Its constructors hold the interpreter's lock, some of its calls wait for minutes, and when it
loses the controller it reconnects for ever and then takes its process down. Here it does no
harm: the main process asks over a socket, waits as long as it likes, and ends this process.
When the main process is gone, this one stops the arm and ends; when it leaves a move unfollowed,
this one stops the arm and does nothing more.
"""

from __future__ import annotations

import os
import sys
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Final

from tjscan.core.frames import Array
from tjscan.core.process import ClientAnswer, ClientMethodCall
from tjscan.core.signals import ignore_ctrl_c
from tjscan.robot.ur.knot_link import KnotLink, PathReport, knot_packages
from tjscan.robot.ur.messages import NOT_SUPERVISED, WATCHDOG_PERIOD, ControllerState, SixNumbers

RTDE_HZ: Final = 125.0
"""Hz at which the controller publishes to this client: what every controller can do."""

RTDE_OUTPUTS: Final = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_TCP_pose",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "actual_digital_output_bits",
]
PAYLOAD_OUTPUTS: Final = ["payload", "payload_cog"]
"""Older controllers have no such outputs."""

WATCHDOG_FEED_INTERVAL: Final = 0.1
"""Seconds between signs of life, when nothing else is asked."""

SAFETY_STOP_DECELERATION: Final = 2.0
"""rad/s² with which an unsupervised arm is stopped."""

UNSUPERVISED_MOVE_LIMIT: Final = WATCHDOG_PERIOD
"""Seconds for which a move may go unfollowed: as long as the controller waits for this process."""

PROGRAM_END_LIMIT: Final = 2.0
"""Seconds within which the library's link shows that a program has ended."""

SILENCE_MEMORY: Final = 10.0
"""Seconds for which a silence is remembered: longer than its consequences take to be seen."""


class LongestSilence:
    """Longest time between two signs of life, of those that ended lately or last until now.

    Parameters
    ----------
    moment : float
        When it begins, in seconds on a clock that never jumps.
    """

    def __init__(self, moment: float) -> None:
        self._last = moment
        self._ended: list[tuple[float, float]] = []  # when, and how long: ever shorter ones

    def note_sign_of_life(self, moment: float) -> None:
        """Note that there was a sign of life at this moment."""
        length, self._last = moment - self._last, moment
        self._ended = [
            (end, gap) for end, gap in self._ended if moment - end < SILENCE_MEMORY and gap > length
        ] + [(moment, length)]

    def longest_until(self, moment: float) -> float:
        """Longest silence of the last seconds until this moment, in seconds."""
        lately = [gap for end, gap in self._ended if moment - end < SILENCE_MEMORY]
        return max([moment - self._last, *lately])


class RtdeClient:
    """Client of a Universal Robots controller over RTDE: one link to command, one to receive."""

    def __init__(self) -> None:
        self._control: Any = None
        self._receive: Any = None
        self._reports_payload = True
        self._watched = self._foreign = False
        self._fed = self._followed = self._clock = 0.0
        self._sent = self._received = LongestSilence(time.monotonic())
        self._before: int | None = None  # the operation before the move that is to be followed
        self._knots: KnotLink | None = None

    def connect(self, host: str) -> None:
        """Connect to the controller, and start the control script."""
        from rtde_control import RTDEControlInterface
        from rtde_receive import RTDEReceiveInterface

        try:
            self._receive = RTDEReceiveInterface(host, RTDE_HZ, RTDE_OUTPUTS + PAYLOAD_OUTPUTS)
        except (RuntimeError, ValueError):
            self._reports_payload = False
            self._receive = RTDEReceiveInterface(host, RTDE_HZ, RTDE_OUTPUTS)
        self._control = RTDEControlInterface(host, RTDE_HZ)
        self._received = LongestSilence(time.monotonic())

    def start_watchdog(self) -> bool:
        """Start the controller's watchdog, which stops the arm when this process falls silent."""
        self._watched = bool(self._control.setWatchdog(1 / WATCHDOG_PERIOD))
        moment = time.monotonic()
        self._sent, self._received = LongestSilence(moment), LongestSilence(moment)
        return self._watched

    def read_state_marking_followed(self) -> ControllerState:
        """Read the state during a move, and note that the main process supervises it."""
        now = self.read_state()
        self._followed = time.monotonic()
        if not now.moving and now.operation != self._before:
            self._before = None  # it knows that the move has ended
        return now

    def read_state(self) -> ControllerState:
        """Read the controller's state."""
        self._note_clock_advance()
        receive, status = self._receive, self._control.getAsyncOperationProgressEx()
        reported, moment = self._reports_payload, time.monotonic()
        return ControllerState(
            connected=bool(receive.isConnected() and self._control.isConnected()),
            time=receive.getTimestamp(),
            q=tuple(receive.getActualQ()),
            speed=tuple(receive.getActualQd()),
            tcp=tuple(receive.getActualTCPPose()),
            robot_mode=receive.getRobotMode(),
            safety_mode=receive.getSafetyMode(),
            runtime_state=receive.getRuntimeState(),
            outputs=receive.getActualDigitalOutputBits(),
            operation=status.operationId(),
            moving=status.isAsyncOperationRunning(),
            unheard=self._sent.longest_until(moment) if self._watched else 0.0,
            unseen=self._received.longest_until(moment),
            payload=receive.getPayload() if reported else None,
            centre_of_gravity=tuple(receive.getPayloadCog()) if reported else None,
        )

    def set_tcp(self, T_f_tcp: SixNumbers) -> bool:
        """Set the active TCP."""
        return bool(self._control.setTcp(list(T_f_tcp)))

    def active_tcp_offset(self) -> list[float]:
        """Read the offset of the active TCP; nothing if the controller does not answer."""
        return list(self._control.getTCPOffset())

    def set_payload(self, mass: float, centre_of_gravity: tuple[float, ...]) -> bool:
        """Set the payload and its centre of gravity."""
        return bool(self._control.setPayload(mass, list(centre_of_gravity)))

    def pose_is_safe(self, tcp: SixNumbers) -> bool:
        """Ask the controller whether a pose is within its safety limits."""
        return bool(self._control.isPoseWithinSafetyLimits(list(tcp)))

    def inverse(self, tcp: SixNumbers, near: SixNumbers) -> list[float]:
        """Ask the controller for the inverse kinematics of a pose; nothing if it has none."""
        if not self._control.getInverseKinematicsHasSolution(list(tcp), list(near)):
            return []
        return list(self._control.getInverseKinematics(list(tcp), list(near)))

    def move_joint(self, q: SixNumbers, speed: float, acceleration: float) -> bool:
        """Begin a move in joint space."""
        self._expect_supervision()
        return bool(self._control.moveJ(list(q), speed, acceleration, True))

    def move_linear(self, tcp: SixNumbers, speed: float, acceleration: float) -> bool:
        """Begin a linear move."""
        self._expect_supervision()
        return bool(self._control.moveL(list(tcp), speed, acceleration, True))

    def stop_move(self, deceleration: float) -> None:
        """Stop the move under way, and wait until the arm is at rest."""
        self._control.stopJ(deceleration)
        self._before = None

    def stop_control_script(self) -> None:
        """End the control script."""
        self._watched, self._before = False, None
        self._control.stopScript()

    def feed_foreign_watchdog(self) -> None:
        """Feed the watchdog of the program that runs in place of the control script."""
        self._watched = self._foreign = True
        self._sent = LongestSilence(time.monotonic())

    def begin_following(self, host: str) -> None:
        """Open a link to the program that follows knots, before it runs."""
        self._knots = KnotLink(host)

    def send_knots(self, epoch: int, times: Array, q: Array, speed: Array, first: int) -> None:
        """Send an epoch of knots, see `knot_packages`."""
        self._knot_link.send(knot_packages(epoch, times, q, speed, first))

    def report_path(self) -> PathReport:
        """What came of the path since the last report."""
        return self._knot_link.report()

    def stop_following(self) -> None:
        """Let the arm come to rest on its path; that program ends then."""
        self._knot_link.stop()

    def end_following(self) -> bool:
        """Close the link to that program, and start the control script again."""
        self._knot_link.close()
        self._watched = self._foreign = False
        until = time.monotonic() + PROGRAM_END_LIMIT
        while not (begun := bool(self._control.reuploadScript())) and time.monotonic() < until:
            time.sleep(1 / RTDE_HZ)  # it is late to see that the other program has ended
        return begun

    @property
    def _knot_link(self) -> KnotLink:
        if self._knots is None:
            raise ValueError("no path is followed")
        return self._knots

    def feed_watchdog(self) -> None:
        """Feed the controller's watchdog, if it is time to."""
        if self._watched and time.monotonic() - self._fed >= WATCHDOG_FEED_INTERVAL:
            self._note_clock_advance()
            try:
                self._control.kickWatchdog()
            except Exception:  # the library raises what it likes
                if not self._foreign:
                    raise
                self._watched = False  # that program has ended
            self._fed = time.monotonic()
            self._sent.note_sign_of_life(self._fed)

    @property
    def supervision_lost(self) -> bool:
        """Whether the main process no longer supervises the move under way."""
        if self._before is None or time.monotonic() - self._followed < UNSUPERVISED_MOVE_LIMIT:
            return False
        status = self._control.getAsyncOperationProgressEx()
        if not status.isAsyncOperationRunning() and status.operationId() != self._before:
            self._before = None  # it has ended meanwhile
        return self._before is not None

    def stop_arm_and_script(self) -> None:
        """Stop the arm and end the control script: the arm is not supervised."""
        self._watched = False  # whatever hangs below, the controller's watchdog stops the arm
        if self._knots is not None:
            self._knots.close()  # and a path is followed to its end, which is at rest
        if self._control is not None:
            self._control.stopJ(SAFETY_STOP_DECELERATION)
            self._control.stopScript()

    def _note_clock_advance(self) -> None:
        """Note when something new has come from the controller: its clock has advanced."""
        if (clock := self._receive.getTimestamp()) != self._clock:
            self._clock = clock
            self._received.note_sign_of_life(time.monotonic())

    def _expect_supervision(self) -> None:
        self._followed = time.monotonic()
        self._before = self._control.getAsyncOperationProgressEx().operationId()


def serve_main_process(connection: Connection, client: RtdeClient) -> None:
    """Serve the main process's requests until it is gone, or leaves a move unsupervised."""
    while not client.supervision_lost:
        try:
            if not connection.poll(WATCHDOG_FEED_INTERVAL):
                client.feed_watchdog()
                continue
            request: ClientMethodCall = connection.recv()
        except (EOFError, OSError):
            client.stop_arm_and_script()
            return
        try:
            connection.send(request.run_on_client(client, lambda e: str(e) or type(e).__name__))
        except OSError:
            continue  # the main process is gone: the next poll finds out
        client.feed_watchdog()
    with suppress(Exception):  # the library raises what it likes
        client.stop_arm_and_script()
    with suppress(EOFError, OSError):  # the main process learns the reason until it is gone
        while True:
            request = connection.recv()
            connection.send(ClientAnswer(request.number, failure=NOT_SUPERVISED))


def main() -> None:
    """Run the client process on the socket whose number is the only argument."""
    ignore_ctrl_c()
    serve_main_process(Connection(int(sys.argv[1])), RtdeClient())
    # The library's destructors would wait half a second, or for a controller that is gone.
    os._exit(0)


if __name__ == "__main__":
    main()
