"""Bring to the disk what the system still holds in memory; the only file that knows how."""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO, Any, Final

WINDOWS: Final = os.name == "nt"
"""There the names of a directory need no help, and a file must be open for writing."""


def bring_stream_to_disk(stream: IO[Any]) -> None:
    """Bring everything that was written to an open file to the disk; OSError if it can't be."""
    stream.flush()
    os.fsync(stream.fileno())


def bring_to_disk(path: Path) -> None:
    """Bring a closed file to the disk, or the names in a directory; OSError if it can't be."""
    if WINDOWS and path.is_dir():
        return
    handle = os.open(path, os.O_RDWR if WINDOWS else os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
