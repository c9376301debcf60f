"""The main process's end of the client's process: every question has a time limit."""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from typing import Final, TypeVar

from tjscan.core.errors import ArmConnectionLost, ArmNotResponding, MoveSupervisionLost
from tjscan.robot.ur.messages import HOST_GONE, ClientAnswer, ClientRequest

QUICK: Final = 3.0
"""Seconds within which the client answers anything but a connection."""

QUOTED: Final = 300
"""Characters of the client's last words that an error quotes."""

T = TypeVar("T")


class ClientLibraryError(Exception):
    """The client library raised an error, which the driver interprets."""


class ClientProcess:
    """Separate process that runs the client library, and the link to it.

    Raises nothing itself until it is asked something.
    """

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `close`
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tjscan.robot.ur.client", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=self._words,
                stderr=self._words,
            )
        self._connection = Connection(ours.detach())
        self._open, self._number = True, 0
        self._asking = threading.Lock()

    @property
    def pid(self) -> int:
        """Process number of the client."""
        return self._process.pid

    def call_client_method(
        self, kind: type[T], name: str, *arguments: object, limit: float = QUICK
    ) -> T:
        """Call a method of the client in its process, and return what it returns.

        Parameters
        ----------
        kind : type
            Of the value.
        name : str
            A method of `client.RtdeClient`.
        *arguments : object
            What it takes.
        limit : float, optional
            Seconds to wait.

        Raises
        ------
        ArmNotResponding
            If the client does not answer in time. It is ended then.
        ArmConnectionLost
            If the client's process died.
        MoveSupervisionLost
            If the client had to stop a move because this process stood still.
        ClientLibraryError
            If the client library raised something.
        """
        with self._asking:
            answer = self._exchange(name, arguments, limit)
        if answer.failure == HOST_GONE:
            raise MoveSupervisionLost(
                "this program stood still while the arm moved, and the arm was stopped on its "
                "way. See that the way is clear, and that nothing holds this computer up, then "
                "start again."
            )
        if answer.failure is not None:
            raise ClientLibraryError(answer.failure)
        if not isinstance(answer.value, kind):
            raise ClientLibraryError(f"{name} gave {answer.value!r}")
        return answer.value

    def close(self) -> None:
        """End the client's process, whatever it is doing, and wait for that."""
        if self._open:
            self._open = False
            self._connection.close()
            self._process.kill()
            self._process.wait()
            self._words.close()

    def _exchange(self, name: str, arguments: tuple[object, ...], limit: float) -> ClientAnswer:
        if not self._open:
            raise ArmConnectionLost("the client's process has ended. Connect again.")
        self._number += 1
        until = time.monotonic() + limit
        try:
            self._connection.send(ClientRequest(self._number, name, arguments))
            while self._connection.poll(max(until - time.monotonic(), 0.0)):
                answer: ClientAnswer = self._connection.recv()
                if answer.number == self._number:  # not that of a question that was interrupted
                    return answer
        except (EOFError, OSError):
            raise self._died() from None
        self.close()
        raise ArmNotResponding(
            f"the arm's controller did not answer within {limit:g} s ({name}). See that it is on "
            "and its network cable sits, then start again."
        )

    def _died(self) -> ArmConnectionLost:
        self._words.seek(0)
        lines = self._words.read().decode(errors="replace").strip()[-QUOTED:]
        self.close()
        said = f" It said: {' / '.join(lines.splitlines())}." if lines else ""
        return ArmConnectionLost(
            f"the connection to the arm's controller broke.{said} See that the arm stands still "
            "and its network cable sits, then start again."
        )
