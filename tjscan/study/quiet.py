"""What a worker process does before anything else. It imports nothing heavy: order matters here."""

from __future__ import annotations

import os
import signal
from typing import Final

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def quiet() -> None:
    """One thread per process, set before NumPy loads, and Ctrl-C left to the parent.

    More threads than cores only stand in each other's way, and sums that are split differently
    round differently.
    """
    for name in THREADS:
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
