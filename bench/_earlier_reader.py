"""The reader of an earlier commit, in a process of its own: what today's times are held against.

Both read each profile in turns, and processor time counts, so that what else a machine does slows
both alike.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from time import thread_time
from types import TracebackType
from typing import IO, Final, Self

from _sections import Array

EARLIER_COMMIT: Final = "3e715d0"
EARLIER_MEDIAN: Final = 4.1e-3
"""Seconds that it takes, in the middle, on the machine for which the limits were set."""

_WARM_UP: Final = 3
"""Times that its first profile is read before any counts."""


class EarlierReader:
    """Times readings by the earlier commit.

    Raises
    ------
    FileNotFoundError
        If the commit is not in the checkout's history.
    """

    def __enter__(self) -> Self:
        """Unpack the commit and start it."""
        root = Path(__file__).parents[1]
        archive = subprocess.run(
            ["git", "-C", root, "archive", EARLIER_COMMIT, "tjscan"],
            capture_output=True,
            check=False,
        )
        if archive.returncode:
            raise FileNotFoundError(f"commit {EARLIER_COMMIT} is not in the history of {root}")
        self._folder = TemporaryDirectory()
        subprocess.run(["tar", "-x", "-C", self._folder.name], input=archive.stdout, check=True)
        self._process = subprocess.Popen(
            [sys.executable, __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": self._folder.name},
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End it."""
        self._to.close()
        self._process.wait()
        self._from.close()
        self._folder.cleanup()

    def seconds(self, points: Array) -> float:
        """Time of one reading of points, shape (n, 2)."""
        pickle.dump(points, self._to)
        self._to.flush()
        return float(self._from.readline())


def _serve(requests: IO[bytes]) -> None:
    """Read what comes, with the package on the path, and answer with the seconds that it took."""
    from tjscan.groove.find import find_groove  # type: ignore[import-not-found]

    from tjscan.core.errors import GrooveNotFound
    from tjscan.laser.profile import Profile

    repeats = _WARM_UP
    while True:
        try:
            points = pickle.load(requests)
        except EOFError:
            return
        profile = Profile(points[:, 0], points[:, 1])
        for _ in range(1 + repeats):
            start = thread_time()
            with suppress(GrooveNotFound):
                find_groove(profile)
            taken = thread_time() - start
        repeats = 0
        print(taken, flush=True)


if __name__ == "__main__":
    _serve(sys.stdin.buffer)
