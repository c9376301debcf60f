"""The controller's side of the wire: packets, answers and faults."""

from __future__ import annotations

import json
import socket
import sys
import time
from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Thread
from typing import ClassVar, Final, TypeVar

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.core.signals import survive_background_terminal_read
from tjscan.robot.kinematics import Kinematics
from tjscan_loopback.cyclic.controller import Answer, CyclicController
from tjscan_loopback.cyclic.faults import FAULT_COMES, InjectedFault
from tjscan_loopback.cyclic.options import CyclicOptions
from tjscan_loopback.faults import ScheduledFault, parse_scheduled_fault
from tjscan_loopback.process import (
    TRUTH_COMMAND,
    check_is_loopback_address,
    print_line,
    start_posture,
)

C = TypeVar("C", bound=CyclicController)

LOOK_INTERVAL: Final = 0.05
"""Seconds between two looks at stdin, and between two tries to find the other computer."""

LARGEST_ANSWER: Final = 4096

LOST_IN_A_ROW: Final = {InjectedFault.LOSE_PACKET: 1, InjectedFault.LOSE_PACKETS: 10}
"""Packets that get lost."""

UNAWAITED_FAULTS: Final = {
    InjectedFault.LATE_ANSWER,
    InjectedFault.UNANSWERED,
    InjectedFault.FROZEN_STAMP,
}
"""Faults in whose cycles no answer comes in time."""

LASTING_FAULTS: Final = {
    InjectedFault.LOSE_ANSWERS,
    InjectedFault.UNANSWERED,
    InjectedFault.FROZEN_STAMP,
}
"""Faults of the wire that last until they are cleared."""

STAMP_JUMP: Final = 1001
"""By how much a wrong stamp jumps: no whole number of cycles, if it is in milliseconds."""

FOREIGN_HOST: Final = "127.255.255.253"


class LoopbackServer:
    """The controller's side of the wire; raises ConfigurationError for an address it can't have.

    Parameters
    ----------
    controller : CyclicController
        The controller.
    options : CyclicOptions
        Of its command. If its clock does not run with the wall's, it waits for each answer, however
        long that takes, and while the arm is moved a cycle ends with it.
    computer : tuple of str and int
        Address and port to which it sends.
    """

    stamp_word: ClassVar[str] = "stamp"
    """What faults call the stamp of a packet."""

    port: ClassVar[int] = 0
    """From which it sends; 0 is another for each start of the program."""

    def __init__(
        self,
        controller: CyclicController,
        options: CyclicOptions,
        computer: tuple[str, int],
    ) -> None:
        check_is_loopback_address(options.host)
        self._controller, self._host, self._computer = controller, options.host, computer
        self._realtime, self._attached = options.realtime, options.attached
        self._lines: SimpleQueue[str | None] = SimpleQueue()
        self._orders: list[ScheduledFault[InjectedFault]] = []
        self._faults: set[InjectedFault] = set()
        self._lost, self._before, self._program = 0, b"", controller.program
        self._fault_cycle = 0
        self._link, self._begun = self._bind(), False
        self._due = time.monotonic()
        self._ended = False

    def run(self) -> None:
        """Send packets until interrupted, or until stdin ends if it is attached to that."""
        survive_background_terminal_read()
        Thread(target=self._listen, daemon=True).start()
        print_line(f"ready {self._host} {self._computer[0]}:{self._computer[1]}")
        while not self._ended:
            link = self._link_of_program() if self._controller.runs else None
            if link is not None:
                self._cycle(link)
            busy = self._controller.runs and self._controller.answered
            self._obey_lines(0.0 if busy else LOOK_INTERVAL)

    def _link_of_program(self) -> socket.socket | None:
        """A socket for each start of the program; None if that is not to send yet."""
        if self._program != self._controller.program:
            self._link.close()
            self._link, self._begun = self._bind(), False
            self._program = self._controller.program
        self._begun = self._begun or self._find_computer(self._link)
        return self._link if self._begun else None

    def _bind(self) -> socket.socket:
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            link.bind((self._host, self.port))
        except OSError as error:
            link.close()
            raise ConfigurationError(
                f"port {self.port} of {self._host} can't be had: {error.strerror}. Each "
                "controller needs an address of its own.",
                key="host",
            ) from None
        return link

    def _find_computer(self, link: socket.socket) -> bool:
        """Connect the socket to where it is to send; False if that is not known yet."""
        link.connect(self._computer)
        return True

    def _cycle(self, link: socket.socket) -> None:
        controller, period = self._controller, 1e-3 * self._controller.cycle_ms
        # Moves of a clock that waits for answers take less than their cycles: none is made up for.
        self._due = max(self._due if self._realtime else 0.0, time.monotonic()) + period
        self._bring_faults()
        packet = controller.packet()
        was_answered, stamp, program = controller.answered, controller.stamp, controller.program
        moved = controller.moved
        with suppress(ConnectionRefusedError):  # of the packet before
            self._send(link, packet)
        lost, self._lost = self._lost > 0, max(self._lost - 1, 0)
        answer = None if lost or self._faults & UNAWAITED_FAULTS else self._await_answer(link)
        if self._faults & {InjectedFault.LOSE_ANSWER, InjectedFault.LOSE_ANSWERS}:
            answer = None
        if controller.runs and program == controller.program:
            controller.end_cycle(answer)
        if controller.answered and not was_answered:
            print_line("connected")
        if InjectedFault.FROZEN_STAMP in self._faults and program == controller.program:
            controller.stamp = stamp
        self._before, self._faults = packet, self._faults & LASTING_FAULTS
        if self._realtime or (answer is not None and controller.moved == moved):
            time.sleep(max(self._due - time.monotonic(), 0.0))

    def _send(self, link: socket.socket, packet: bytes) -> None:
        faults, controller = self._faults, self._controller
        if InjectedFault.FOREIGN_PACKET in faults:
            controller.stamp += controller.step
            later = controller.packet()
            controller.stamp -= controller.step
            for host in (FOREIGN_HOST, self._host):
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
                    other.bind((host, 0))
                    other.sendto(later, link.getpeername())
        if InjectedFault.WRONG_TYPE in faults:
            link.send(self._of_another_type(packet))
        if InjectedFault.MALFORMED in faults:
            link.send(packet[: len(packet) // 2])
        if self._lost == 0:
            link.send(packet)
        if InjectedFault.DOUBLE_PACKET in faults:
            link.send(packet)
        if InjectedFault.OLD_PACKET in faults:
            link.send(self._before)

    def _of_another_type(self, packet: bytes) -> bytes:
        """The packet as another device would send it."""
        raise NotImplementedError

    def _receive(self, link: socket.socket) -> Answer | None:
        """Receive a packet; None if it is no answer."""
        return self._controller.parse(link.recv(LARGEST_ANSWER))

    def _await_answer(self, link: socket.socket) -> Answer | None:
        """The answer to the packet of this cycle; None if it does not come in time."""
        controller, program = self._controller, self._controller.program
        while controller.runs and controller.program == program and not self._ended:
            left = self._due - time.monotonic() if self._realtime else LOOK_INTERVAL
            link.settimeout(min(max(left, 0.0), LOOK_INTERVAL))
            try:
                answer = self._receive(link)
            except ConnectionRefusedError:
                return None  # no one listens
            except (TimeoutError, BlockingIOError):
                self._obey_lines(0.0)
                late = self._realtime and left <= LOOK_INTERVAL
                if late or self._faults & UNAWAITED_FAULTS or not controller.answered:
                    return None
                continue
            if answer is not None and answer.stamp == controller.stamp:
                return answer
            if answer is not None:
                controller.note_other_answer(answer)
        return None

    def _bring_faults(self) -> None:
        moved = self._controller.moved
        due = [order for order in self._orders if order.when <= moved]
        self._orders = [order for order in self._orders if order.when > moved]
        for order in due:
            print_line(f"fault {order.fault}".replace("stamp", self.stamp_word))
            self._bring(order.fault)

    def _bring(self, fault: InjectedFault) -> None:
        controller = self._controller
        self._fault_cycle = controller.cycles
        match fault:
            case InjectedFault.CLEAR | InjectedFault.HOME:
                self._orders, self._faults, self._lost = [], set(), 0
                controller.start(home=fault == InjectedFault.HOME)
            case InjectedFault.STAND:
                controller.standing = True
            case InjectedFault.STOP_PROGRAM:
                controller.program_runs = False
            case InjectedFault.STOP:
                controller.stop("as ordered")
            case InjectedFault.WRONG_STAMP:
                controller.stamp += STAMP_JUMP
            case _:
                self._faults.add(fault)
                self._lost += LOST_IN_A_ROW.get(fault, 0)

    def _obey_lines(self, patience: float) -> None:
        """Obey the lines of stdin that have come, or come within some seconds."""
        with suppress(Empty):
            while True:
                line = self._lines.get(timeout=patience) if patience else self._lines.get_nowait()
                if line is None:
                    self._ended = self._attached
                    return
                self._obey(line.strip())

    def _obey(self, line: str) -> None:
        controller = self._controller
        if line == TRUTH_COMMAND:
            truth = {
                "q_deg": np.degrees(controller.q).tolist(),
                "fastest": controller.fastest,
                "misread": controller.misread,
                "rest_after_s": 1e-3
                * controller.cycle_ms
                * max(controller.turned - self._fault_cycle, 0),
            }
            print_line(f"{TRUTH_COMMAND} {json.dumps(truth)}")
            return
        try:
            words = line.replace(self.stamp_word, "stamp")
            order = parse_scheduled_fault(words, InjectedFault, FAULT_COMES)
        except ConfigurationError as error:
            print_line(f"refused {error}")
            return
        if order.when:
            self._orders.append(ScheduledFault(order.fault, order.when + controller.moved))
        else:
            self._bring(order.fault)
        print_line(f"ordered {line}")

    def _listen(self) -> None:
        # A thread, for stdin may be a terminal, a pipe, a file or nothing at all.
        with suppress(OSError, ValueError):
            for line in sys.stdin:
                self._lines.put(line)
        self._lines.put(None)


def load_controller(kind: type[C], options: CyclicOptions, *, patience: int) -> C:
    """Controller of an arm, where it starts; `patience` as it has it.

    Raises
    ------
    ConfigurationError
        If the arm or the joint angles can't be.
    """
    with add_file_to_errors(key="model"):
        kinematics = Kinematics.load(options.model)
    q = start_posture(kinematics, options.home_deg)
    cycle_ms = options.cycle_ms
    return kind(kinematics, q, cycle_ms=cycle_ms, patience=patience, report_line=print_line)
