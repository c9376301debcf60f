"""Knots of a path to a controller, and the states on it: RTDE, spoken directly.

The client library writes one register at a time. Here a package fills all of them, with three
knots: each that the controller publishes, every two milliseconds, sets off one to it, until it
has acknowledged them all. A thread of the client's process does so, which nothing holds up.
"""

from __future__ import annotations

import socket
import threading
import time
from collections import deque
from dataclasses import dataclass
from struct import Struct
from typing import Final

import numpy as np

from tjscan.core.frames import Array

RTDE_PORT: Final = 30004
FOLLOWING_HZ: Final = 500.0
"""Times a second that the controller publishes: each of its ticks."""

FIRST_REGISTER: Final = 24
REGISTER_COUNT: Final = 24
"""Registers of an e-Series that are free for programs of one's own."""

ACKNOWLEDGED_REGISTER, VERDICT_REGISTER, PATH_TIME_REGISTER = 24, 25, 24
"""Numbers of the output registers: the package and the epoch that came last; the epoch that is
followed, negative if it was refused; seconds on the path."""

KNOTS_OF_PACKAGE: Final = 3
MOST_KNOTS: Final = 126
"""Knots of an epoch that the program has room for."""

ANGLE_STEPS, SPEED_STEPS, SPEED_RANGE = 2.0**24, 2.0**20, 8.0
"""Steps in a radian and in a rad/s, and the largest speed: together 53 bits, a register."""

STATE_PERIOD: Final = 0.008
"""Seconds between two states that are kept."""

HEARTBEAT_PERIOD: Final = 0.1
"""Seconds between two packages when there is nothing to say."""

CONNECTION_LIMIT: Final = 2.0
"""Seconds that an answer may take."""

_PACKAGE_HEADER: Final = Struct(">HB")
_INPUT_RECIPE: Final = Struct(f">B{REGISTER_COUNT}d")
_OUTPUT_RECIPE: Final = Struct(">Bd6d6dIiid")
_OUTPUT_NAMES: Final = (
    "timestamp,actual_q,actual_TCP_pose,runtime_state,"
    f"output_int_register_{ACKNOWLEDGED_REGISTER},output_int_register_{VERDICT_REGISTER},"
    f"output_double_register_{PATH_TIME_REGISTER}"
)


def knot_packages(epoch: int, times: Array, q: Array, speed: Array, first: int) -> Array:
    """Registers of the packages that carry an epoch of knots, shape (m, 24).

    Parameters
    ----------
    epoch : int
        Number of the epoch, growing.
    times : ndarray, shape (n,)
        Seconds on the path.
    q, speed : ndarray, shape (n, 6)
        Radians and rad/s.
    first : int
        The first knot that is not on the path before.
    """
    steps = np.rint(q * ANGLE_STEPS) * 2 * SPEED_RANGE * SPEED_STEPS
    packed = steps + np.rint(speed * SPEED_STEPS) + SPEED_RANGE * SPEED_STEPS
    knots = np.column_stack((times, packed))
    count = -(-len(knots) // KNOTS_OF_PACKAGE)
    room = np.zeros((count * KNOTS_OF_PACKAGE, knots.shape[1]))
    room[: len(knots)] = knots
    heads = ((epoch * 128.0 + len(knots)) * 128.0 + first) * 128.0 + np.arange(count)
    return np.column_stack((heads, np.zeros((count, 2)), room.reshape(count, -1)))


@dataclass(frozen=True, slots=True)
class PathReport:
    """What came of a path since the last report.

    Parameters
    ----------
    states : list of tuple
        Time on the controller's clock, six joint angles, and the pose of the active TCP.
    time, path_time : float
        Seconds on the controller's clock and on the path, of the latest.
    verdict : int
        Number of the epoch that is followed; negative of one that was refused.
    runs : bool
        Whether the program runs.
    silence : float
        Seconds since anything came; infinite if the link broke.
    """

    states: list[tuple[float, ...]]
    time: float
    path_time: float
    verdict: int
    runs: bool
    silence: float


class KnotLink:
    """Link to the program on the controller that follows knots; raises OSError if there is none.

    Parameters
    ----------
    host : str
        The controller's address.
    """

    def __init__(self, host: str) -> None:
        self._socket = socket.create_connection((host, RTDE_PORT), CONNECTION_LIMIT)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._data, self._lock = b"", threading.Lock()
        self._waiting: deque[tuple[int, Array]] = deque()
        self._states: list[tuple[float, ...]] = []
        self._latest = (0.0, 0.0, 0, 0)
        self._beat = self._stop = self._kept = 0.0
        self._open = True
        self._ask("V", b"\0\2")
        kinds = self._ask("O", Struct(">d").pack(FOLLOWING_HZ) + _OUTPUT_NAMES.encode())[1:]
        names = (f"input_double_register_{FIRST_REGISTER + i}" for i in range(REGISTER_COUNT))
        answer = self._ask("I", ",".join(names).encode())
        if b"NOT_FOUND" in kinds or b"IN_USE" in answer or b"NOT_FOUND" in answer:
            raise OSError("its registers from 24 on are in use, or it has none")
        self._recipe = answer[0]
        self._send_package(np.zeros(REGISTER_COUNT))  # what was written before counts for nothing
        self._ask("S", b"")
        self._heard = self._sent = time.monotonic()
        threading.Thread(target=self._run, daemon=True).start()

    def send(self, packages: Array) -> None:
        """Send the packages of an epoch in place of any before, shape (m, 24)."""
        with self._lock:
            self._waiting = deque((_acknowledgement(one[0]), one) for one in packages)

    def stop(self) -> None:
        """Let the arm come to rest on its path."""
        self._stop = 1.0

    def report(self) -> PathReport:
        """What came since the last report."""
        with self._lock:
            states, self._states = self._states, []
        at, path_time, verdict, runtime = self._latest
        silence = time.monotonic() - self._heard if self._open else float("inf")
        return PathReport(states, at, path_time, verdict, runtime == 2, silence)

    def close(self) -> None:
        """Close the link."""
        self._open = False
        self._socket.close()

    def _run(self) -> None:
        try:
            while self._open:
                self._take(self._receive("U"))
                if not self._data:  # or this thread was held up, and there is more to take
                    self._send_next()
        except OSError:
            self._open = False

    def _take(self, payload: bytes) -> None:
        _, at, *rest = _OUTPUT_RECIPE.unpack(payload)
        runtime, acknowledged, verdict, path_time = rest[12:]
        self._latest, self._heard = (at, path_time, verdict, runtime), time.monotonic()
        with self._lock:
            if at > self._kept + 0.9 * STATE_PERIOD:
                self._kept = at
                self._states.append((at, *rest[:12]))
            self._waiting = deque(one for one in self._waiting if one[0] != acknowledged)

    def _send_next(self) -> None:
        with self._lock:
            registers = self._waiting[0][1].copy() if self._waiting else np.zeros(REGISTER_COUNT)
            self._waiting.rotate(-1)
        if registers[0] or self._stop or time.monotonic() - self._sent > HEARTBEAT_PERIOD:
            self._beat += 1.0
            registers[1:3] = self._beat, self._stop
            self._send_package(registers)

    def _send_package(self, registers: Array) -> None:
        self._sent = time.monotonic()
        self._send("U", _INPUT_RECIPE.pack(self._recipe, *registers))

    def _send(self, kind: str, payload: bytes) -> None:
        self._socket.sendall(
            _PACKAGE_HEADER.pack(_PACKAGE_HEADER.size + len(payload), ord(kind)) + payload
        )

    def _ask(self, kind: str, payload: bytes) -> bytes:
        self._send(kind, payload)
        return self._receive(kind)

    def _receive(self, wanted: str) -> bytes:
        """Payload of the next package of a kind."""
        while True:
            while len(self._data) < _PACKAGE_HEADER.size or len(self._data) < self._size:
                piece = self._socket.recv(1 << 16)
                if not piece:
                    raise OSError("the controller closed the link")
                self._data += piece
            size, kind = self._size, self._data[2]
            payload, self._data = self._data[_PACKAGE_HEADER.size : size], self._data[size:]
            if kind == ord(wanted):
                return payload

    @property
    def _size(self) -> int:
        return int.from_bytes(self._data[:2], "big")


def _acknowledgement(head: float) -> int:
    """What the program acknowledges a package with, by its first register."""
    return int(head // 2**21) * 64 + int(head % 128)
