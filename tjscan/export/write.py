"""Write what a run hands on."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from tjscan.core.errors import ConfigurationError
from tjscan.core.files import atomic_directory
from tjscan.export.document import Length, document_of
from tjscan.export.files import FORMATS
from tjscan.export.weldx import write_weldx

Format = Literal["csv", "ply", "json", "weldx"]

STEM: Final = "export"
"""Name of the file in the run directory, where none is given."""


def export(directory: Path, to: Format, units: Length = "mm", out: Path | None = None) -> Path:
    """Write a run's sections for another tool, and return the file.

    Parameters
    ----------
    directory : Path
        The run directory, of one scan or stitched.
    to : str
        csv, ply, json or weldx.
    units : str
        Unit of its lengths: mm or m.
    out : Path, optional
        The file to write; ``export.FORMAT`` in the run directory where left out.

    Raises
    ------
    ConfigurationError
        If there is no finished run, the folder of the file does not exist, or an extra is not
        installed.
    RecordingError
        If the file can't be written; what stood there before then still does.
    """
    document = document_of(directory, units)
    file = out or directory / f"{STEM}.{to}"
    if not file.parent.is_dir() or file.is_dir():
        raise ConfigurationError("is no file in a folder that exists", file=file, key="--out")
    with atomic_directory(file.parent) as draft:
        if to == "weldx":
            write_weldx(draft / file.name, document)
        else:
            (draft / file.name).write_bytes(FORMATS[to](document))
    return file
