"""The list of a run directory's files and their SHA-256, which shows what was changed since.

It is written in the format of ``sha256sum``: ``sha256sum -c SHA256SUMS`` checks it as well.
Recordings are not in it: they grow, and check themselves.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from hashlib import file_digest
from pathlib import Path
from typing import Final

from tjscan.core.errors import RecordingError

MANIFEST_FILE: Final = "SHA256SUMS"

MOST_MANIFEST_BYTES: Final = 100_000
"""A larger file lists no run directory."""

_RECORDINGS_OF_SCANS: Final = ("scan.mcap", "*/scan.mcap")
"""In a run directory, or in one of several stations: what `tjscan reprocess` takes."""

MANIFEST_LINE: Final = re.compile(r"([0-9a-f]{64})  (\S.*)")


def check_files_unaltered(*files: Path) -> None:
    """Refuse files that are not as this program wrote them.

    Parameters
    ----------
    files : Path
        In run directories; those that are not there are passed over, and so is a directory
        without a list: it is of an earlier version, or no run directory.

    Raises
    ------
    RecordingError
        Naming those that were edited or damaged since.
    """
    changed = files_altered_since_written(*files)
    if changed:
        directory = changed[0].parent
        names = ", ".join(file.name for file in changed)
        scans = any(any(directory.glob(name)) for name in _RECORDINGS_OF_SCANS)
        again = f", or write results again from the recording (tjscan reprocess {directory})"
        raise RecordingError(
            f"{directory}: {names}: not as {MANIFEST_FILE} lists it: edited or damaged since, or "
            f"written by a program that was killed. Put back a copy{again if scans else ''}; "
            f"without {MANIFEST_FILE} files are taken as they are"
        )


def files_altered_since_written(*files: Path) -> list[Path]:
    """Those of some files that are there and not as this program wrote them.

    Raises
    ------
    RecordingError
        If one can't be read.
    """
    try:
        return [
            file
            for file in files
            if file.is_file()
            and (manifest := file.parent / MANIFEST_FILE).is_file()
            and _read_manifest(manifest).get(file.name) != _sha256_of_file(file)
        ]
    except OSError as error:
        raise RecordingError(f"{error.filename}: can't be read: {error.strerror}") from error


def manifest_text(directory: Path, written: Path, removed: Sequence[Path] = ()) -> str:
    """Text of a directory's list once the files in another folder have replaced those in it.

    Parameters
    ----------
    directory : Path
        Its list is kept for what is not replaced.
    written : Path
        Folder of the new files.
    removed : sequence of Path
        Files that are removed from it.
    """
    kept = _read_manifest(directory / MANIFEST_FILE)
    for file in removed:
        kept.pop(file.name, None)
    new = {file.name: _sha256_of_file(file) for file in written.iterdir() if file.is_file()}
    return "".join(f"{sha256}  {name}\n" for name, sha256 in sorted((kept | new).items()))


def _read_manifest(manifest: Path) -> dict[str, str]:
    """SHA-256 of each file that a list names; nothing if there is no list."""
    if not manifest.is_file():
        return {}
    with manifest.open("rb") as stream:
        text = stream.read(MOST_MANIFEST_BYTES).decode(errors="replace")
    matches = map(MANIFEST_LINE.fullmatch, text.splitlines())
    return {match[2]: match[1] for match in matches if match}


def _sha256_of_file(file: Path) -> str:
    with file.open("rb") as stream:
        return file_digest(stream, "sha256").hexdigest()
