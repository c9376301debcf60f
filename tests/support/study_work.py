"""Work that worker processes of the study's tests import: quickly, so nothing else is imported."""

from __future__ import annotations

import os
import signal
import threading


def double_or_die(n: int) -> int:
    """Twice the number; 1 takes its process with it, as what runs out of memory does."""
    if n == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * n


def threads(_: int) -> str:
    """How many threads NumPy may take in this process."""
    return os.environ["OPENBLAS_NUM_THREADS"]


def once(n: int) -> int:
    """End for 0 alone; any other number keeps its worker busy for ever."""
    if n:
        threading.Event().wait()
    return n
