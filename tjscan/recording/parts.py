"""The files of a recording: the first, and a further part for each time that it was resumed."""

from __future__ import annotations

import os
import re
from itertools import count, takewhile
from pathlib import Path
from typing import Final

from tjscan.core.files import refuse_links_outside

SCAN_RECORDING_KIND: Final = "scan"
"""Kind of recording that a run directory holds unless stated otherwise."""


def recording_files(directory: Path, kind: str = SCAN_RECORDING_KIND) -> list[Path]:
    """Files of a run's recording: ``scan.mcap``, and a further part for each time it was resumed.

    Parameters
    ----------
    directory : Path
        The run directory.
    kind : str
        What the names of its files begin with.

    Raises
    ------
    ConfigurationError
        If a part is a link that leads out of the directory.
    """
    others = (_part_file(directory, kind, number) for number in count(2))
    found = [_part_file(directory, kind, 1), *takewhile(os.path.lexists, others)]
    refuse_links_outside(directory, *(file.name for file in found))
    return found


def next_recording_file(directory: Path, kind: str = SCAN_RECORDING_KIND) -> Path:
    """File to record into next; one that is on disk is never written again."""
    found = recording_files(directory, kind)
    return _part_file(directory, kind, len(found) + 1) if found[0].exists() else found[0]


def neighbouring_parts(file: Path) -> tuple[Path | None, Path | None]:
    """The parts of a recording before and behind one of its files; None if there is none."""
    numbered = re.fullmatch(r"(.+)-([1-9]\d{0,8})", file.stem)
    kind, number = (numbered[1], int(numbered[2])) if numbered else (file.stem, 1)
    before, behind = (_part_file(file.parent, kind, number + step) for step in (-1, 1))
    found = before if number > 1 and before.is_file() else None
    return found, behind if behind.is_file() else None


def _part_file(directory: Path, kind: str, number: int) -> Path:
    return directory / (f"{kind}.mcap" if number == 1 else f"{kind}-{number}.mcap")
