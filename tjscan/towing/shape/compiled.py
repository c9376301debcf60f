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


def compiled(function: F, *, inline: bool = False) -> F:
    """Compile a function of numbers and arrays at its first call.

    Notes
    -----
    Sums may be reordered, so that loops run in vector registers; NaN and infinity stay what they
    are. Numba takes a stored result for good while the function's own file is unchanged, whatever
    became of the functions it calls: hence a directory for every state of what is compiled.
    """
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _cache_directory()
    try:
        compiler = numba.njit(
            cache=True, forceinline=inline, fastmath={"reassoc", "contract", "nsz"}
        )
        return cast(F, compiler(function))
    finally:
        numba.config.CACHE_DIR = before


def inlined(function: F) -> F:
    """The same for a part of a compiled function: tuples of arrays are slow to pass in a call."""
    return compiled(function, inline=True)


@cache
def _cache_directory() -> str:
    """Directory for this state of the sources, or the one Numba is set to if it can't be made."""
    room = Path(__file__).parent
    sources = (file.read_bytes() for file in sorted(room.glob("*.py")))
    marks = (b"@compiled", b"@inlined", b"(NamedTuple)")
    digest = sha256(b"".join(s for s in sources if any(mark in s for mark in marks)))
    directory = room / "__pycache__" / f"numba-{digest.hexdigest()[:16]}"
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError:
        return str(numba.config.CACHE_DIR)
    return str(directory) if os.access(directory, os.W_OK) else str(numba.config.CACHE_DIR)
