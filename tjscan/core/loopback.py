"""What all stand-ins for devices on this machine share: their address, and their process."""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from ipaddress import AddressValueError, IPv4Address
from typing import ClassVar, Final, Self

from tjscan.core.errors import ConfigurationError, TjscanError

REPLY_TIMEOUT: Final = 60.0
"""Seconds to wait for a line; a busy machine takes its time."""


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


class LoopbackProgram:
    """Process of a command that stands in for a device; a context manager starts and ends it.

    It prints a line that begins with ``ready`` when it is, and takes faults as lines on stdin.

    Parameters
    ----------
    command : str
        The command of ``tjscan``.
    *options : str
        Its options.
    """

    ended: ClassVar[type[TjscanError]] = TjscanError
    """Raised where the process has ended."""

    silent: ClassVar[type[TjscanError]] = TjscanError
    """Raised where it does not say what it should."""

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
            If it ended instead (`ended`), or says no such thing for the time (`silent`).
        """
        while True:
            try:
                line = self._lines.get(timeout=timeout)
            except queue.Empty:
                raise self.silent(f"tjscan {self._command} does not say {wanted}") from None
            if line is None:
                raise self.ended(f"tjscan {self._command} {' '.join(self._options)} has ended")
            if line.startswith(wanted):
                return line

    def unread_output(self) -> Sequence[str]:
        """Lines that the process has printed and nobody has waited for."""
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
                with suppress(BrokenPipeError):  # a line that nobody read any more
                    stream.close()
