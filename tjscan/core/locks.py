"""A lock on a directory, held against other processes; the only file that knows how."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tjscan.core.errors import RecordingError

try:
    import fcntl
except ModuleNotFoundError:  # Windows
    fcntl = None  # type: ignore[assignment]


@contextmanager
def lock_directory(directory: Path) -> Iterator[None]:
    """Hold an exclusive lock on a directory while the block runs.

    The system lets go of the lock when the process ends, however it ends.

    Raises
    ------
    RecordingError
        If another process does so already, or the directory can't be opened.
    """
    try:
        handle = _open_lock(directory)
    except OSError as error:
        raise RecordingError(f"{directory}: can't be opened: {error.strerror}") from error
    try:
        _lock_exclusively(handle)
    except OSError as error:
        os.close(handle)
        if isinstance(error, BlockingIOError):
            raise RecordingError(
                f"{directory}: another process is recording there; wait for it to end"
            ) from None
        raise RecordingError(f"{directory}: can't be locked: {error.strerror}") from error
    try:
        yield
    finally:
        os.close(handle)


def lock_file_of(directory: Path) -> Path:
    """File beside a directory that is locked on Windows, where a directory can't be opened."""
    whole = directory.resolve(strict=True)
    return whole.with_name(f".{whole.name}.lock")


def _open_lock(directory: Path) -> int:
    if fcntl is None:
        return os.open(lock_file_of(directory), os.O_RDWR | os.O_CREAT)
    return os.open(directory, os.O_RDONLY)


def _lock_exclusively(handle: int) -> None:
    if fcntl is None:
        import msvcrt

        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError from error
    else:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
