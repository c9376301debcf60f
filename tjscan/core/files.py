"""Files that are there whole, and together, or not at all.

It is the only module that brings to the disk what the system still holds in memory.
"""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any, Final

from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.locks import lock_directory
from tjscan.core.manifest import MANIFEST_FILE, manifest_text

IS_WINDOWS: Final = os.name == "nt"
"""There the names of a directory need no help, and a file must be open for writing."""


def sync_stream_to_disk(stream: IO[Any]) -> None:
    """Bring everything that was written to an open file to the disk; OSError if it can't be."""
    stream.flush()
    os.fsync(stream.fileno())


def sync_path_to_disk(path: Path) -> None:
    """Bring a closed file to the disk, or the names in a directory; OSError if it can't be."""
    if IS_WINDOWS and path.is_dir():
        return
    handle = os.open(path, os.O_RDWR if IS_WINDOWS else os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


DRAFT_PREFIX: Final = ".partial-"
"""How the names of draft folders begin."""


def check_file_size(file: Path, most: int, what: str) -> None:
    """Refuse, before it is opened, what is no file or is larger than it can be.

    A pipe or a device would be read for ever, and a file of that size would fill the memory.

    Parameters
    ----------
    file : Path
        Must exist.
    most : int
        Bytes of the largest file of its kind.
    what : str
        What it should be, in words.

    Raises
    ------
    ConfigurationError
        If it is something else, or larger.
    OSError
        If it is not there, or can't be looked at.
    """
    try:
        status = file.stat()
    except ValueError as error:
        raise ConfigurationError(f"is no name of a file: {error}", key=repr(file)) from None
    if not stat.S_ISREG(status.st_mode):
        raise ConfigurationError(f"is no file; {what} is needed", file=file)
    if status.st_size > most:
        raise ConfigurationError(
            f"is far too large for {what}: {status.st_size} bytes, {most} at most", file=file
        )


def read_small_file(file: Path, most: int, what: str) -> bytes:
    """Read a file of at most `most` bytes; raises as `check_file_size` does."""
    check_file_size(file, most, what)
    with file.open("rb") as stream:
        return stream.read(most)


def refuse_links_outside(directory: Path, *names: str) -> None:
    """Refuse files of a run directory that are links which lead out of it.

    Raises
    ------
    ConfigurationError
        Naming the first one.
    """
    for name in names:
        file = directory / name
        if file.is_symlink() and not file.resolve().is_relative_to(directory.resolve()):
            raise ConfigurationError(
                "is a link that leads out of the run directory; put the file itself there",
                file=file,
            )


@contextmanager
def lock_and_clean_directory(directory: Path) -> Iterator[None]:
    """Lock a directory against other processes while the block runs, and remove leftover drafts.

    Drafts that a dead process left there are swept away. Raises as `lock_directory` does.
    """
    with lock_directory(directory):
        for draft in directory.glob(f"{DRAFT_PREFIX}*"):  # of a process that died
            shutil.rmtree(draft, ignore_errors=True)
        yield


@contextmanager
def write_files_atomically(
    directory: Path, *, last: str = "", listed: bool = False, instead_of: Sequence[str] = ()
) -> Iterator[Path]:
    """Give a draft folder whose files move into `directory`, all or none, after the block.

    No file is replaced before all of them are on the disk. If a link is in the place of
    one, the link is replaced, and what it leads to stays as it is.

    Parameters
    ----------
    directory : Path
        Made if it is not there.
    last : str
        The file that is moved last: where it is, all are.
    listed : bool
        Whether a new directory gets a list of its files, see `tjscan.core.manifest`. One that is
        there is kept true in any case.
    instead_of : sequence of str
        Patterns of names whose files are removed if the draft holds none of that name: of an
        earlier result, and no longer true beside this one.

    Raises
    ------
    RecordingError
        If writing fails; the directory then holds what it held before.
    """
    order = {MANIFEST_FILE: 1, last: 2}
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=directory, prefix=DRAFT_PREFIX) as name:
            draft = Path(name)
            yield draft
            is_new = all(file == draft for file in directory.iterdir())
            earlier = {file for pattern in instead_of for file in directory.glob(pattern)}
            gone = [file for file in earlier if not (draft / file.name).exists()]
            if (listed and is_new) or (directory / MANIFEST_FILE).is_file():
                text = manifest_text(directory, draft, gone)
                (draft / MANIFEST_FILE).write_text(text, encoding="utf-8")
            for file in draft.iterdir():
                sync_path_to_disk(file)
            for file in gone:
                file.unlink()
            for file in sorted(draft.iterdir(), key=lambda file: order.get(file.name, 0)):
                file.replace(directory / file.name)
            sync_path_to_disk(directory)
    except OSError as error:
        raise RecordingError(f"{directory}: can't be written: {error.strerror or error}") from error
