"""Files that are there whole, and together, or not at all; and who may write them."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from tjscan.errors import RecordingError


@contextmanager
def sole_writer(directory: Path) -> Iterator[None]:
    """Keep every other process from measuring into a directory while the block runs.

    Raises
    ------
    RecordingError
        If another process does so already, or the directory can't be opened.
    """
    try:
        handle = os.open(directory, os.O_RDONLY)
    except OSError as error:
        raise RecordingError(f"{directory}: can't be opened: {error.strerror}") from error
    try:
        # The system lets go of the lock when the process ends, however it ends.
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise RecordingError(
            f"{directory}: another process is recording there; wait for it to end"
        ) from None
    finally:
        os.close(handle)


@contextmanager
def drafted(directory: Path) -> Iterator[Path]:
    """Give a draft folder whose files move into `directory` when the block succeeds.

    No file is replaced before all of them are written.

    Raises
    ------
    RecordingError
        If writing fails; the directory then holds what it held before.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=directory, prefix=".partial-") as name:
            draft = Path(name)
            yield draft
            for file in draft.iterdir():
                file.replace(directory / file.name)
    except OSError as error:
        raise RecordingError(f"{directory}: can't be written: {error.strerror or error}") from error
