"""The stream of corrections in a process of its own: ``python -m tjscan.robot.kuka.client SOCKET``.

A controller that is not answered within its cycle counts that, and stops the arm after some. Here
nothing else holds the interpreter. The main process asks over a socket; when it is gone, or leaves
a move unsupervised, the arm comes to rest.
"""

from __future__ import annotations

import socket
import sys
import time
from contextlib import suppress
from math import inf
from multiprocessing.connection import Connection, wait
from typing import Final

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.core.process import ClientMethodCall
from tjscan.core.signals import ignore_ctrl_c
from tjscan.robot.kuka.packets import LARGEST_PACKET
from tjscan.robot.kuka.settings import RSI_CYCLES, KukaSettings
from tjscan.robot.kuka.stream import CorrectionStream, StreamState

WATCH_INTERVAL: Final = 0.05
"""Seconds between two looks at who is silent, when nothing comes."""

UNSUPERVISED_MOVE_LIMIT: Final = 1.0
"""Seconds for which the main process may ask nothing while the arm moves."""

MOST_AT_ONCE: Final = 256
"""Packets that are taken before anything else is looked at."""

LEAVE_LIMIT: Final = 15.0
"""Seconds in which the arm comes to rest once the main process is gone."""


class RsiClient:
    """Client of one controller: its socket, and what watches both sides of the stream."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        self._stream = CorrectionStream("", "", RSI_CYCLES[0])
        self._heard = self._asked = self._looked = time.monotonic()
        self._silence_limit = inf
        self._left: float | None = None

    def connect(self, settings: KukaSettings) -> None:
        """Listen to a controller.

        Raises
        ------
        ArmNotConnected
            If that address can't be listened on.
        """
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            address = socket.gethostbyname(settings.host)
            link.setblocking(False)
            link.bind((settings.bind, settings.port))
        except (OSError, UnicodeError) as error:
            link.close()
            raise errors.ArmNotConnected(
                f"port {settings.port} of {settings.bind} can't be listened on for the controller "
                f"at {settings.host} ({error}). See that bind is this computer's "
                "address in its RSI network, and that no other program listens there."
            ) from None
        self._stream = CorrectionStream(address, settings.sen_type, settings.cycle)
        self._socket, self._silence_limit = link, settings.silence_limit

    def read_state(self) -> StreamState | None:
        """State of the arm; None before the first packet. Raises the arm's fault."""
        return self._stream.state()

    def begin_move(self, q: Array, ramp: float) -> None:
        """Begin a move; see `CorrectionStream.begin_move`."""
        self._stream.begin_move(q, ramp)

    def stop_move(self) -> None:
        """Bring the arm to rest along its path."""
        self._stream.brake()

    def serve_main_process(self, connection: Connection) -> None:
        """Answer controller and main process until that is gone and the arm at rest."""
        while self._left is None or self._is_leaving(self._left):
            sources = [self._socket, connection if self._left is None else None]
            ready = wait([source for source in sources if source is not None], WATCH_INTERVAL)
            if self._socket is not None and self._socket in ready:
                self._take_packets(self._socket)
            if connection in ready:
                self._serve_request(connection)
            self._watch()

    def _is_leaving(self, since: float) -> bool:
        connected = self._socket is not None and self._stream.connected
        return connected and not self._stream.ended and time.monotonic() < since + LEAVE_LIMIT

    def _serve_request(self, connection: Connection) -> None:
        try:
            request: ClientMethodCall = connection.recv()
            self._asked = time.monotonic()
            connection.send(request.run_on_client(self, _fault_of_error))
        except (EOFError, OSError):
            self._left = time.monotonic()
            self._stream.leave()

    def _take_packets(self, link: socket.socket) -> None:
        answered = 0
        with suppress(BlockingIOError):
            for _ in range(MOST_AT_ONCE):
                data, sender = link.recvfrom(LARGEST_PACKET + 1)
                answer = self._stream.answer(data, sender)
                if answer is not None:
                    self._heard = time.monotonic()
                    answered += 1
                    with suppress(OSError):  # what can't be sent is lost, as on the way
                        link.sendto(answer, sender)
        self._stream.note_waiting(answered)

    def _watch(self) -> None:
        now = time.monotonic()
        pause, self._looked = now - self._looked, now
        if pause > 2 * WATCH_INTERVAL:  # in which this process was held up: the others may not be
            self._asked, self._heard = self._asked + pause, self._heard + pause
        if not self._stream.connected:
            self._heard = now
        elif now - self._heard > self._silence_limit:
            self._stream.fail_for_silence(self._silence_limit)
        if self._stream.moving and now - self._asked > UNSUPERVISED_MOVE_LIMIT:
            self._stream.fail(
                errors.MoveSupervisionLost(
                    "this program paused while the arm moved, and the arm was stopped on its way. "
                    "See that the way is clear, and that nothing holds this computer up, then "
                    "start again."
                )
            )


def _fault_of_error(error: Exception) -> errors.ArmFault:
    if isinstance(error, errors.ArmFault):
        return error
    return errors.ArmFault(f"the client of the arm's controller failed: {error!r}")


def main() -> None:
    """Run the client process on the socket whose number is the only argument."""
    ignore_ctrl_c()
    RsiClient().serve_main_process(Connection(int(sys.argv[1])))


if __name__ == "__main__":
    main()
