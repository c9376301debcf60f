"""Write a run's sections for another tool."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.core.provenance import LengthUnit, Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result.directory import SECTIONS, job_label_of_run
from tjscan.result.document import sections_to_json
from tjscan.result.ply import sections_to_ply
from tjscan.result.shapes import read_finished_summary
from tjscan.result.table import read_sections_csv, sections_to_csv
from tjscan.result.weldx import write_weldx

Format = Literal["csv", "ply", "json", "weldx"]

STEM: Final = "export"
"""Name of the file in the run directory, where none is given."""


def export_run(
    directory: Path, to: Format, units: LengthUnit = "mm", out: Path | None = None
) -> Path:
    """Write a run's sections as a file for another tool, and return that file.

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
    summary = read_finished_summary(directory)
    sections = sort_sections_by_azimuth(read_sections_csv(directory / SECTIONS))
    if len(sections) < 2:
        raise ConfigurationError(
            "two sections or more are needed to find the groove's direction",
            file=directory / SECTIONS,
        )
    run, calibration = directory.resolve().name, summary.calibration
    provenance = Provenance.for_file_written_now(job_label_of_run(directory), summary.frame, units)
    file = out or directory / f"{STEM}.{to}"
    if not file.parent.is_dir() or file.is_dir():
        raise ConfigurationError("is no file in a folder that exists", file=file, key="--out")
    with write_files_atomically(file.parent) as draft:
        made = draft / file.name
        match to:
            case "csv":
                made.write_text(sections_to_csv(sections, provenance), encoding="utf-8", newline="")
            case "ply":
                made.write_bytes(sections_to_ply(sections, provenance))
            case "json":
                made.write_bytes(sections_to_json(sections, provenance, run, calibration))
            case "weldx":
                write_weldx(made, sections, provenance, run, calibration)
    return file


def sort_sections_by_azimuth(sections: tuple[MeasuredSection, ...]) -> tuple[MeasuredSection, ...]:
    """Sections by growing azimuth, whichever way the scan went; as they are where none is known.

    Parameters
    ----------
    sections : tuple of MeasuredSection
        In their order along the groove.
    """
    azimuths = np.unwrap([section.azimuth for section in sections])
    if np.isnan(azimuths).any():
        return sections
    return tuple(sections[i] for i in np.argsort(azimuths))
