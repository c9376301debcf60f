"""Files that are there whole, and together, or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from tjscan.errors import RecordingError


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
