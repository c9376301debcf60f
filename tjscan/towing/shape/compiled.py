"""Numba's compiler with its results kept on disk, as a decorator that keeps a function's type."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

F = TypeVar("F", bound=Callable[..., object])

Indices = NDArray[np.int64]


def compiled(function: F) -> F:
    """Compile a function of numbers and arrays at its first call.

    Notes
    -----
    Sums may be reordered, so that loops run in vector registers; NaN and infinity stay what they
    are. Calls from one compiled function to another are inlined: else which of several copies of
    the other runs, and how it adds up, would depend on what else is loaded, and on whether this
    process has compiled it. Numba takes a stored result for good while the function's own file is
    unchanged, whatever became of the functions it calls: hence a directory for every state of what
    is compiled.
    """
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _cache_directory()
    try:
        fast = {"reassoc", "contract", "nsz"}
        return cast(F, numba.njit(cache=True, forceinline=True, fastmath=fast)(function))
    finally:
        numba.config.CACHE_DIR = before


@cache
def _cache_directory() -> str:
    """Directory for this state of the sources, or the one Numba is set to if it can't be made."""
    room = Path(__file__).parent
    sources = (file.read_bytes() for file in sorted(room.glob("*.py")))
    marks = (b"@compiled", b"(NamedTuple)")
    digest = sha256(b"".join(s for s in sources if any(mark in s for mark in marks)))
    directory = room / "__pycache__" / f"numba-{digest.hexdigest()[:16]}"
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError:
        return str(numba.config.CACHE_DIR)
    return str(directory) if os.access(directory, os.W_OK) else str(numba.config.CACHE_DIR)
