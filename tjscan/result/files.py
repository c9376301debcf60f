"""Files that are there whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tjscan.errors import RecordingError


@contextmanager
def whole(file: Path) -> Iterator[Path]:
    """Give a temporary name to write to, and rename it to `file` when the block succeeds.

    Raises
    ------
    RecordingError
        If writing fails; `file` is then as it was before.
    """
    draft = file.with_name(f".{file.name}.partial{file.suffix}")
    try:
        yield draft
        draft.replace(file)
    except OSError as error:
        raise RecordingError(f"{file}: can't be written: {error.strerror or error}") from error
    finally:
        draft.unlink(missing_ok=True)
