"""The stream in a process of its own: ``python -m tjscan.robot.cyclic.client SOCKET``.

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
from tjscan.robot.cyclic.settings import CyclicSettings
from tjscan.robot.cyclic.stream import CyclePacket, CyclicStream, StreamState

WATCH_INTERVAL: Final = 0.05
"""Seconds between two looks at who is silent, when nothing comes."""

UNSUPERVISED_MOVE_LIMIT: Final = 1.0
"""Seconds for which the main process may ask nothing while the arm moves."""

GREETING_INTERVAL: Final = 0.5
"""Seconds between two tries to make a silent controller send."""

LARGEST_PACKET: Final = 4096
"""Bytes of a packet that are read: more is none of a controller."""

MOST_AT_ONCE: Final = 256
"""Packets that are taken before anything else is looked at."""

LEAVE_LIMIT: Final = 15.0
"""Seconds in which the arm comes to rest once the main process is gone."""


class CyclicClient:
    """Client of one controller: its socket, and what watches both sides of the stream."""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        self._stream: CyclicStream[CyclePacket] | None = None
        self._controller = ("", 0)
        self._heard = self._asked = self._looked = self._greeted = time.monotonic()
        self._silence_limit = inf
        self._left: float | None = None

    def connect(self, settings: CyclicSettings) -> None:
        """Listen to a controller.

        Raises
        ------
        ArmNotConnected
            If that address can't be listened on.
        """
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            address = socket.gethostbyname(settings.host)
            stream = settings.make_stream(address)  # before packets come: it may load for a while
            link.setblocking(False)
            link.bind(settings.local_address)
        except (OSError, UnicodeError) as error:
            link.close()
            raise errors.ArmNotConnected(
                f"the controller at {settings.host} can't be listened on, {settings.listening} "
                f"({error}). See that this is this computer's address in the controller's network, "
                "and that no other program listens there."
            ) from None
        self._stream, self._controller = stream, (address, settings.port)
        self._socket, self._silence_limit = link, settings.silence_limit
        self._greeted = -inf

    def read_state(self) -> StreamState | None:
        """State of the arm; None before the first packet. Raises the arm's fault."""
        return self._connected_stream.state()

    def read_ignored(self) -> dict[str, int]:
        """How many packets were not answered, by what was wrong with them."""
        return dict(self._connected_stream.ignored)

    def begin_move(self, q: Array, ramp: float) -> None:
        """Begin a move; see `CyclicStream.begin_move`."""
        self._connected_stream.begin_move(q, ramp)

    def stop_move(self) -> None:
        """Bring the arm to rest along its path."""
        self._connected_stream.brake()

    @property
    def _connected_stream(self) -> CyclicStream[CyclePacket]:
        if self._stream is None:
            raise errors.ArmFault("the arm's client is not connected")
        return self._stream

    def serve_main_process(self, connection: Connection) -> None:
        """Answer controller and main process until that is gone and the arm at rest."""
        while self._left is None or self._is_leaving(self._left):
            sources = [self._socket, connection if self._left is None else None]
            ready = wait([source for source in sources if source is not None], WATCH_INTERVAL)
            if self._socket in ready:
                self._take_packets()
            if connection in ready:
                self._serve_request(connection)
            self._watch()
        if self._stream is not None:
            self._send(self._stream.farewells())

    def _is_leaving(self, since: float) -> bool:
        stream = self._stream
        leaves = stream is not None and stream.connected and not stream.ended
        return leaves and time.monotonic() < since + LEAVE_LIMIT

    def _serve_request(self, connection: Connection) -> None:
        try:
            request: ClientMethodCall = connection.recv()
            self._asked = time.monotonic()
            connection.send(request.run_on_client(self, _fault_of_error))
        except (EOFError, OSError):
            self._left = time.monotonic()
            if self._stream is not None:
                self._stream.leave()

    def _take_packets(self) -> None:
        """Take what has come, all before the first is answered: so it shows whether it waited."""
        if self._socket is None or self._stream is None:
            return
        came: list[tuple[bytes, tuple[str, int]]] = []
        with suppress(BlockingIOError):
            came.extend(self._socket.recvfrom(LARGEST_PACKET + 1) for _ in range(MOST_AT_ONCE))
        if own := sum(self._stream.is_from_controller(sender) for _, sender in came):
            self._stream.note_waiting(own)
        for data, sender in came:
            answer = self._stream.answer(data, sender)
            if answer is not None:
                self._heard = time.monotonic()
                self._send([answer], sender)

    def _send(self, packets: list[bytes], to: tuple[str, int] | None = None) -> None:
        for packet in packets:
            if self._socket is not None:
                with suppress(OSError):  # what can't be sent is lost, as on the way
                    self._socket.sendto(packet, to or self._controller)

    def _watch(self) -> None:
        now = time.monotonic()
        pause, self._looked = now - self._looked, now
        if pause > 2 * WATCH_INTERVAL:  # in which this process was held up: the others may not be
            self._asked, self._heard = self._asked + pause, self._heard + pause
        if self._stream is None:
            return
        if not self._stream.connected:
            self._heard = now
            if now - self._greeted > GREETING_INTERVAL:
                self._greeted = now
                self._send(self._stream.greetings())
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
    CyclicClient().serve_main_process(Connection(int(sys.argv[1])))


if __name__ == "__main__":
    main()
