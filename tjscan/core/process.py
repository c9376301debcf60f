"""A client library in a process of its own: every question to it has a time limit.

Such a library may hold the interpreter's lock, wait for minutes, or take its process down. Here
the main process asks over a socket, waits as long as it likes, and ends the other process.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import Pipe
from typing import Final

QUOTED_OUTPUT_CHARACTERS: Final = 300
"""Characters of the process's last output that an error quotes."""


@dataclass(frozen=True, slots=True)
class ClientMethodCall:
    """Request to call a method of the client; its number is repeated in the answer."""

    number: int
    name: str
    arguments: tuple[object, ...]

    def run_on_client(self, client: object, explain: Callable[[Exception], object]) -> ClientAnswer:
        """Call the method, and return its value, or what `explain` makes of its exception."""
        try:
            value = getattr(client, self.name)(*self.arguments)
        except Exception as error:  # a library raises what it likes
            return ClientAnswer(self.number, failure=explain(error))
        return ClientAnswer(self.number, value)


@dataclass(frozen=True, slots=True)
class ClientAnswer:
    """Value that a method of the client returned, or its failure."""

    number: int
    value: object = None
    failure: object = None


class ClientProcess:
    """Process that runs a client, and the link to it; it raises nothing until it is asked.

    Parameters
    ----------
    module : str
        Module to run. Its only argument is the number of a `multiprocessing` connection, from
        which it reads a `ClientMethodCall` and sends a `ClientAnswer`, one after another.
    device : str
        What the client talks to, as errors call it.
    ended, silent : callable
        Make the device's errors from a message: the process has ended, or it gave no answer.
    """

    def __init__(
        self,
        module: str,
        device: str,
        ended: Callable[[str], Exception],
        silent: Callable[[str], Exception],
    ) -> None:
        self._device, self._ended, self._silent = device, ended, silent
        self._connection, theirs = Pipe()
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `close`
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", module, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=self._output,
                stderr=self._output,
            )
        self._open, self._number = True, 0
        self._asking = threading.Lock()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def call_method(self, name: str, *arguments: object, limit: float) -> ClientAnswer:
        """Call a method of the client in its process.

        Parameters
        ----------
        name : str
            Name of the method.
        *arguments : object
            Its arguments.
        limit : float
            Seconds to wait.

        Raises
        ------
        Exception
            The device's error `ended` if the process has ended, before it was asked or by itself;
            its error `silent` if no answer comes in time. The process is ended then.
        """
        with self._asking:
            if not self._open:
                raise self._ended(f"the connection to {self._device} has ended. Connect again.")
            self._number += 1
            until = time.monotonic() + limit
            try:
                self._connection.send(ClientMethodCall(self._number, name, arguments))
                while self._connection.poll(max(until - time.monotonic(), 0.0)):
                    answer: ClientAnswer = self._connection.recv()
                    if answer.number == self._number:  # not of an interrupted question
                        return answer
            except (EOFError, OSError):
                raise self._ended(
                    f"the connection to {self._device} broke.{self._end_and_quote_output()} See "
                    "that nothing moves and its network cable sits, then start again."
                ) from None
            self.close()
            raise self._silent(
                f"{self._device} did not answer within {limit:g} s ({name}). See that it is on and "
                "its network cable sits, then start again."
            )

    def close(self, *, patience: float = 0.0) -> None:
        """End the process, whatever it is doing, and wait for that.

        Parameters
        ----------
        patience : float, optional
            Seconds in which it may end by itself, for its link has ended.
        """
        if not self._open:
            return
        self._open = False
        self._connection.close()
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._output.close()

    def _end_and_quote_output(self) -> str:
        self._output.seek(0)
        last = self._output.read().decode(errors="replace").strip()[-QUOTED_OUTPUT_CHARACTERS:]
        self.close()
        return f" Its last output: {' / '.join(last.splitlines())}." if last else ""
