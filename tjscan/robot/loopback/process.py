"""A loopback controller as a process of its own, for whoever wants one under control."""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
from collections.abc import Sequence
from typing import Final, Self

from tjscan.core.errors import ArmNotConnected, ArmNotResponding

REPLY_TIMEOUT: Final = 60.0
"""Seconds to wait for a line; a busy machine takes its time."""


class LoopbackProcess:
    """Process with a loopback controller; a context manager that starts and ends it.

    Parameters
    ----------
    host : str
        The address it shall listen on.
    *options : str
        Further options of ``tjscan ur-loopback``.
    """

    def __init__(self, host: str, *options: str) -> None:
        self.host, self._options = host, options
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()

    def __enter__(self) -> Self:
        """Start it, and wait until it is ready.

        Raises
        ------
        ArmNotConnected
            If it does not start.
        """
        command = (sys.executable, "-c", "from tjscan.cli import main; main()", "ur-loopback")
        self._process = subprocess.Popen(
            [*command, "--attached", "--host", self.host, *self._options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self.wait_for_line(f"ready {self.host}")
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def schedule_fault(self, line: str) -> None:
        """Schedule a fault in the controller, and wait until it is accepted."""
        if self._process.stdin is not None:
            self._process.stdin.write(f"{line}\n")
            self._process.stdin.flush()
        self.wait_for_line(f"ordered {line}")

    def wait_for_line(self, *wanted: str) -> str:
        """Wait until the process prints a line that begins with one of these, and return it.

        Raises
        ------
        ArmNotConnected
            If it ended instead.
        ArmNotResponding
            If it says no such thing for a long time.
        """
        while True:
            try:
                line = self._lines.get(timeout=REPLY_TIMEOUT)
            except queue.Empty:
                raise ArmNotResponding(f"the loopback controller does not say {wanted}") from None
            if line is None:
                raise ArmNotConnected(f"the loopback controller on {self.host} has ended")
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
                stream.close()
