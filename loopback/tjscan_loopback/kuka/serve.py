"""Run a loopback controller as this process: packets, answers, and faults of the wire."""

from __future__ import annotations

import json
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Final

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.core.signals import survive_background_terminal_read
from tjscan.robot.kinematics import Kinematics
from tjscan_loopback.kuka.controller import Answer, LoopbackController, parse_answer
from tjscan_loopback.kuka.faults import InjectedFault, ScheduledFault, parse_scheduled_fault
from tjscan_loopback.process import (
    TRUTH_COMMAND,
    check_is_loopback_address,
    parse_loopback_port,
    print_line,
    start_posture,
)

LOOK_INTERVAL: Final = 0.05
"""Seconds between two looks at stdin, and between two tries to find the other computer."""

LARGEST_ANSWER: Final = 4096

LOST_IN_A_ROW: Final = {InjectedFault.LOSE_PACKET: 1, InjectedFault.LOSE_PACKETS: 10}
"""Packets that get lost."""

UNAWAITED_FAULTS: Final = {
    InjectedFault.LATE_ANSWER,
    InjectedFault.UNANSWERED,
    InjectedFault.FROZEN_IPOC,
}
"""Faults in whose cycles no answer comes in time."""

LASTING_FAULTS: Final = {
    InjectedFault.LOSE_ANSWERS,
    InjectedFault.UNANSWERED,
    InjectedFault.FROZEN_IPOC,
}
"""Faults of the wire that last until they are cleared."""

IPOC_JUMP: Final = 1001
"""Milliseconds by which a wrong time stamp jumps: no whole number of cycles."""

FOREIGN_HOST: Final = "127.255.255.253"


class LoopbackServer:
    """The controller's side of the wire.

    Parameters
    ----------
    controller : LoopbackController
        The controller.
    host : str
        Its address.
    computer : tuple of str and int
        Address and port to which it sends.
    realtime : bool
        Whether its clock runs with the wall's. If not, it waits for each answer, however long that
        takes, and while the arm is moved a cycle ends with it.
    """

    def __init__(
        self,
        controller: LoopbackController,
        host: str,
        computer: tuple[str, int],
        *,
        realtime: bool,
    ) -> None:
        self._controller, self._host, self._computer = controller, host, computer
        self._realtime = realtime
        self._lines: SimpleQueue[str | None] = SimpleQueue()
        self._orders: list[ScheduledFault] = []
        self._faults: set[InjectedFault] = set()
        self._lost, self._before, self._program = 0, b"", 0
        self._link: socket.socket | None = None
        self._due = time.monotonic()
        self._ended = False

    def run(self, *, attached: bool) -> None:
        """Send packets until interrupted, or until stdin ends if it is attached to that."""
        Thread(target=self._listen, daemon=True).start()
        print_line(f"ready {self._host} {self._computer[0]}:{self._computer[1]}")
        while not (attached and self._ended):
            if self._controller.runs:
                self._cycle(self._link_of_program())
            busy = self._controller.runs and self._controller.answered
            self._obey_lines(0.0 if busy else LOOK_INTERVAL)

    def _link_of_program(self) -> socket.socket:
        """A socket for each start of the program: the controller's port is another one then."""
        if self._link is None or self._program != self._controller.program:
            if self._link is not None:
                self._link.close()
            self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._link.bind((self._host, 0))
            self._link.connect(self._computer)
            self._program = self._controller.program
        return self._link

    def _cycle(self, link: socket.socket) -> None:
        controller, period = self._controller, 1e-3 * self._controller.cycle_ms
        self._due = max(self._due, time.monotonic()) + period
        self._bring_faults()
        packet = controller.packet()
        was_answered, ipoc, program = controller.answered, controller.ipoc, controller.program
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
        if InjectedFault.FROZEN_IPOC in self._faults and program == controller.program:
            controller.ipoc = ipoc
        self._before, self._faults = packet, self._faults & LASTING_FAULTS
        if self._realtime or (answer is not None and controller.moved == moved):
            time.sleep(max(self._due - time.monotonic(), 0.0))

    def _send(self, link: socket.socket, packet: bytes) -> None:
        faults, ipoc = self._faults, self._controller.ipoc
        if InjectedFault.FOREIGN_PACKET in faults:
            later = f">{ipoc + self._controller.cycle_ms}<".encode()
            for host in (FOREIGN_HOST, self._host):
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
                    other.bind((host, 0))
                    other.sendto(packet.replace(f">{ipoc}<".encode(), later), self._computer)
        if InjectedFault.WRONG_TYPE in faults:
            link.send(packet.replace(b"KUKA", b"KAKU"))
        if InjectedFault.MALFORMED in faults:
            link.send(packet[: len(packet) // 2])
        if self._lost == 0:
            link.send(packet)
        if InjectedFault.DOUBLE_PACKET in faults:
            link.send(packet)
        if InjectedFault.OLD_PACKET in faults:
            link.send(self._before)

    def _await_answer(self, link: socket.socket) -> Answer | None:
        """The answer to the packet of this cycle; None if it does not come in time."""
        controller, program = self._controller, self._controller.program
        while controller.runs and controller.program == program and not self._ended:
            left = self._due - time.monotonic() if self._realtime else LOOK_INTERVAL
            link.settimeout(min(max(left, 0.0), LOOK_INTERVAL))
            try:
                answer = parse_answer(link.recv(LARGEST_ANSWER))
            except ConnectionRefusedError:
                return None  # no one listens
            except (TimeoutError, BlockingIOError):
                self._obey_lines(0.0)
                late = self._realtime and left <= LOOK_INTERVAL
                if late or self._faults & UNAWAITED_FAULTS or not controller.answered:
                    return None
                continue
            if answer is not None and answer.ipoc == controller.ipoc:
                return answer
            if answer is not None:
                controller.note_other_answer(answer)
        return None

    def _bring_faults(self) -> None:
        moved = self._controller.moved
        due = [order for order in self._orders if order.cycles <= moved]
        self._orders = [order for order in self._orders if order.cycles > moved]
        for order in due:
            print_line(f"fault {order.fault}")
            self._bring(order.fault)

    def _bring(self, fault: InjectedFault) -> None:
        controller = self._controller
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
            case InjectedFault.WRONG_IPOC:
                controller.ipoc += IPOC_JUMP
            case _:
                self._faults.add(fault)
                self._lost += LOST_IN_A_ROW.get(fault, 0)

    def _obey_lines(self, patience: float) -> None:
        """Obey the lines of stdin that have come, or come within some seconds."""
        with suppress(Empty):
            while True:
                line = self._lines.get(timeout=patience) if patience else self._lines.get_nowait()
                if line is None:
                    self._ended = True
                    return
                self._obey(line.strip())

    def _obey(self, line: str) -> None:
        controller = self._controller
        if line == TRUTH_COMMAND:
            truth = {
                "q_deg": np.degrees(controller.q).tolist(),
                "fastest": controller.fastest,
                "misread": controller.misread,
            }
            print_line(f"{TRUTH_COMMAND} {json.dumps(truth)}")
            return
        try:
            order = parse_scheduled_fault(line)
        except ConfigurationError as error:
            print_line(f"refused {error}")
            return
        if order.cycles:
            self._orders.append(ScheduledFault(order.fault, order.cycles + controller.moved))
        else:
            self._bring(order.fault)
        print_line(f"ordered {line}")

    def _listen(self) -> None:
        # A thread, for stdin may be a terminal, a pipe, a file or nothing at all.
        with suppress(OSError, ValueError):
            for line in sys.stdin:
                self._lines.put(line)
        self._lines.put(None)


def run_loopback_controller(
    model: str,
    host: str,
    computer: str,
    *,
    cycle_ms: int,
    timeout: int,
    home_deg: Sequence[float],
    realtime: bool,
    attached: bool,
) -> None:
    """Run the loopback controller until interrupted, or until an attached stdin ends.

    Raises
    ------
    ConfigurationError
        If the arm, an address, the cycle or the joint angles can't be.
    """
    check_is_loopback_address(host)
    address = parse_loopback_port(computer, key="computer")
    if cycle_ms not in (4, 12):
        raise ConfigurationError(f"it is 4 or 12 (found {cycle_ms})", key="cycle_ms")
    with add_file_to_errors(key="model"):
        kinematics = Kinematics.load(model)
    q = start_posture(kinematics, home_deg)
    survive_background_terminal_read()
    controller = LoopbackController(
        kinematics, q, cycle_ms=cycle_ms, patience=timeout, report_line=print_line
    )
    LoopbackServer(controller, host, address, realtime=realtime).run(attached=attached)
