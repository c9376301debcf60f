"""What all loopback devices share: their address, their output, and a process for each."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

import numpy as np

from tjscan.core.errors import (
    ArmNotConnected,
    ArmNotResponding,
    ConfigurationError,
    LaserNotConnected,
    LaserNotResponding,
    PowerFault,
    PowerLinkLost,
    TjscanError,
    VehicleFault,
    VehicleLinkLost,
)

if TYPE_CHECKING:
    from tjscan.core.frames import Array
    from tjscan.robot.kinematics import Kinematics

REPLY_TIMEOUT: Final = 60.0
"""Seconds to wait for a line; a busy machine takes its time."""

TRUTH_COMMAND: Final = "truth"
"""Line that asks for the truth of a device, and the first word of its reply."""


def print_line(line: str) -> None:
    """Print a line to stdout at once, also when its reader has gone."""
    with suppress(BrokenPipeError):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()


def check_is_loopback_address(host: str) -> None:
    """Refuse any address but this machine's own.

    Raises
    ------
    ConfigurationError
        If others could reach it.
    """
    try:
        own = IPv4Address(host).is_loopback
    except AddressValueError:
        own = False
    if not own:
        raise ConfigurationError(
            f"it uses addresses of this machine alone, 127.0.0.1 to 127.255.255.254 "
            f"(found {host!r})",
            key="host",
        )


def parse_loopback_port(text: str, key: str) -> tuple[str, int]:
    """Parse ``HOST:PORT`` of this machine.

    Raises
    ------
    ConfigurationError
        If it is none.
    """
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise ConfigurationError(
            f"HOST:PORT, for instance 127.0.0.1:1883 (found {text!r})", key=key
        )
    check_is_loopback_address(host)
    return host, int(port)


def start_posture(kinematics: Kinematics, home_deg: Sequence[float]) -> Array:
    """Joint angles in radians at which an arm starts.

    Raises
    ------
    ConfigurationError
        If it can't be there.
    """
    q = np.radians(home_deg)
    possible = q.shape == kinematics.lower.shape and np.all(
        (q >= kinematics.lower) & (q <= kinematics.upper)  # not if an angle is NaN
    )
    if not possible:
        raise ConfigurationError(f"{kinematics.name} can't be at {list(home_deg)}", key="home_deg")
    return q


class LoopbackProgram:
    """Process of a loopback device's command; a context manager starts and ends it.

    It prints a line that begins with ``ready`` when it is, and takes faults as lines on stdin.

    Parameters
    ----------
    command : str
        The command of ``tjscan``.
    *options : str
        Its options.
    """

    ended: ClassVar[type[TjscanError]] = TjscanError
    """Raised if the process has ended."""

    silent: ClassVar[type[TjscanError]] = TjscanError
    """Raised if it does not print the line that is waited for."""

    start_limit: ClassVar[float] = REPLY_TIMEOUT
    """Seconds in which it must be ready."""

    def __init__(self, command: str, *options: str) -> None:
        self._command, self._options = command, options
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()

    def __enter__(self) -> Self:
        """Start it, and wait until it is ready.

        Raises
        ------
        TjscanError
            If it does not start.
        """
        program = (sys.executable, "-c", "from tjscan.cli import main; main()", self._command)
        self._process = subprocess.Popen(
            [*program, "--attached", *self._options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self.wait_for_line("ready", timeout=self.start_limit)
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def schedule_fault(self, line: str) -> None:
        """Schedule a fault, and wait until it is accepted."""
        self.write_line(line)
        self.wait_for_line(f"ordered {line}")

    def write_line(self, line: str) -> None:
        """Write a line to its stdin."""
        if self._process.stdin is not None:
            self._process.stdin.write(f"{line}\n")
            self._process.stdin.flush()

    def wait_for_line(self, *wanted: str, timeout: float = REPLY_TIMEOUT) -> str:
        """Wait until the process prints a line that begins with one of these, and return it.

        Raises
        ------
        TjscanError
            If it ended instead (`ended`), or prints no such line for the time (`silent`).
        """
        while True:
            try:
                line = self._lines.get(timeout=timeout)
            except queue.Empty:
                raise self.silent(f"tjscan {self._command} prints no line {wanted}") from None
            if line is None:
                raise self.ended(f"tjscan {self._command} {' '.join(self._options)} has ended")
            if line.startswith(wanted):
                return line

    def ask_for_truth(self) -> dict[str, Any]:
        """What is true of the device, and was since it began, of those that state it."""
        self.write_line(TRUTH_COMMAND)
        line = self.wait_for_line(f"{TRUTH_COMMAND} ")
        truth: dict[str, Any] = json.loads(line.removeprefix(TRUTH_COMMAND))
        return truth

    def unread_output(self) -> Sequence[str]:
        """Lines that the process has printed and no call has waited for."""
        lines = []
        while not self._lines.empty():
            line = self._lines.get()
            if line is not None:
                lines.append(line)
        return lines

    def _read(self) -> None:
        if self._process.stdout is not None:
            for line in self._process.stdout:
                self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(BrokenPipeError):  # a line that was never read
                    stream.close()


class ArmLoopbackProcess(LoopbackProgram):
    """Process with an arm's loopback controller; a context manager starts and ends it.

    Parameters
    ----------
    command : str
        The command of ``tjscan``.
    host : str
        Its address.
    *options : str
        Further options of that command.
    """

    ended, silent = ArmNotConnected, ArmNotResponding

    def __init__(self, command: str, host: str, *options: str) -> None:
        super().__init__(command, "--host", host, *options)
        self.host = host


class UrLoopbackProcess(ArmLoopbackProcess):
    """Process of ``tjscan ur-loopback``; parameters as `ArmLoopbackProcess` has them."""

    def __init__(self, host: str, *options: str) -> None:
        super().__init__("ur-loopback", host, *options)


class LaserLoopbackProcess(LoopbackProgram):
    """Process with a loopback laser; a context manager starts and ends it.

    Parameters
    ----------
    host : str
        Its address.
    *options : str
        Further options of ``tjscan laser-loopback``.
    """

    ended, silent = LaserNotConnected, LaserNotResponding

    def __init__(self, host: str, *options: str) -> None:
        super().__init__("laser-loopback", "--host", host, *options)
        self.host = host


class VehicleLoopbackProcess(LoopbackProgram):
    """Process with loopback vehicles; a context manager starts and ends it.

    Parameters
    ----------
    broker : str
        ``HOST:PORT`` of a broker on this machine.
    *options : str
        Further options of ``tjscan vehicle-loopback``.
    """

    ended, silent = VehicleLinkLost, VehicleFault
    start_limit = 600.0
    """Seconds: at its very first start, what finds a tow's first shape is compiled for a minute."""

    def __init__(self, broker: str, *options: str) -> None:
        super().__init__("vehicle-loopback", "--broker", broker, *options)

    def wait_until_at_rest(self, vehicle: int = 1, *, timeout: float = 10.0) -> float:
        """When a vehicle came to rest, in seconds of `time.monotonic`.

        Raises
        ------
        VehicleFault
            If it goes on moving.
        """
        return float(self.wait_for_line(f"at rest {vehicle} ", timeout=timeout).split()[-1])


class PowerLoopbackProcess(LoopbackProgram):
    """Process with a loopback power source; a context manager starts and ends it.

    Parameters
    ----------
    job : Path
        Whose registers it has.
    host : str
        Its address.
    port : int
        Its port.
    *options : str
        Further options of ``tjscan power-loopback``.
    """

    ended, silent = PowerLinkLost, PowerFault

    def __init__(self, job: Path, host: str, port: int, *options: str) -> None:
        place = ("--host", host, "--port", str(port))
        super().__init__("power-loopback", str(job), *place, *options)

    def wait_for_current(self, *, on: bool, timeout: float = 10.0) -> float:
        """When current began or ceased to flow, in seconds of `time.monotonic`.

        Raises
        ------
        PowerFault
            If it does not.
        """
        word = "on" if on else "off"
        return float(self.wait_for_line(f"current {word} ", timeout=timeout).split()[-1])
