"""The main process's end of the client's process: every question has a time limit."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from multiprocessing import Pipe
from typing import Final, TypeVar

from tjscan.core.errors import LaserFault, LaserNotResponding
from tjscan.laser.genicam.messages import LaserAnswer, LaserRequest

QUOTED: Final = 300
"""Characters of the client's last words that an error quotes."""

T = TypeVar("T")


class GenicamProcess:
    """Process that runs the client library, and the link to it; a context manager for both."""

    def __init__(self) -> None:
        ours, theirs = Pipe()
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `close`
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tjscan.laser.genicam.client", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=self._words,
                stderr=self._words,
            )
        self._connection = ours
        self._open, self._number = True, 0
        self._asking = threading.Lock()

    @property
    def pid(self) -> int:
        """Process number of the client."""
        return self._process.pid

    def call(self, kind: type[T], name: str, *, limit: float, **arguments: object) -> T:
        """Call a method of `camera.GenicamClient` in its process, and return what it returns.

        Parameters
        ----------
        kind : type
            Of the value.
        name : str
            Of the method.
        limit : float
            Seconds to wait.
        **arguments : object
            What it takes.

        Raises
        ------
        LaserNotResponding
            If it does not answer in time, or died. It is ended then.
        LaserFault
            What the method raised.
        """
        with self._asking:
            answer = self._exchange(name, limit, arguments)
        if answer.fault is not None:
            raise answer.fault
        if not isinstance(answer.value, kind):
            raise LaserFault(f"{name} gave {answer.value!r}")
        return answer.value

    def close(self, *, give_back: float = 0.0) -> None:
        """End the process.

        Parameters
        ----------
        give_back : float, optional
            Seconds that it may take to give the laser back before.
        """
        if not self._open:
            return
        self._open = False
        self._connection.close()
        try:
            self._process.wait(give_back)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._words.close()

    def _exchange(self, name: str, limit: float, arguments: dict[str, object]) -> LaserAnswer:
        if not self._open:
            raise LaserNotResponding("the connection to the laser has ended. Connect again.")
        self._number += 1
        until = time.monotonic() + limit
        try:
            self._connection.send(LaserRequest(self._number, name, arguments))
            while self._connection.poll(max(until - time.monotonic(), 0.0)):
                answer: LaserAnswer = self._connection.recv()
                if answer.number == self._number:  # not that of a question that was interrupted
                    return answer
        except (EOFError, OSError):
            raise self._died() from None
        self.close()
        raise LaserNotResponding(
            f"the laser did not answer within {limit:.2g} s ({name}). See that it is on and its "
            "network cable sits, then start again."
        )

    def _died(self) -> LaserNotResponding:
        self._process.wait()
        self._words.seek(0)
        lines = self._words.read().decode(errors="replace").strip()[-QUOTED:]
        self.close()
        said = f" It said: {' / '.join(lines.splitlines())}." if lines else ""
        return LaserNotResponding(f"the laser's client has ended.{said} Start again.")
