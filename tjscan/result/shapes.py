"""A run, or a file, as a shape to compare."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tjscan.comparison.clouds import read_shape_file as read_file
from tjscan.comparison.shapes import Shape, UnitAndFrame, UserUnitAndFrame
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import refuse_links_outside
from tjscan.core.frames import Array, readonly_copy
from tjscan.core.manifest import check_files_unaltered
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.root import WELD_IN_GROOVE
from tjscan.result.directions import section_directions
from tjscan.result.directory import BUDGET_FILE, CLOUD_FILE, SECTIONS_FILE, SUMMARY_FILE
from tjscan.result.section import absent_corners
from tjscan.result.summary import ScanSummary, read_budget, read_summary
from tjscan.result.table import read_sections_csv


def read_shape(path: Path, options: UserUnitAndFrame | None = None) -> Shape:
    """Read a run directory, of one scan or stitched, or any file that `read_shape_file` reads.

    Parameters
    ----------
    path : Path
        The directory or file.
    options : UserUnitAndFrame, optional
        Unit and frame of a file that does not state them.

    Raises
    ------
    ConfigurationError
        If it is missing, damaged or empty, or nothing states its unit or its frame.
    """
    if path.is_dir():
        return read_run_shape(path)
    if path.name == CLOUD_FILE and (path.parent / SUMMARY_FILE).is_file():
        frame = read_summary(path.parent / SUMMARY_FILE).frame
        check_files_unaltered(path)
        shape = read_file(path, UserUnitAndFrame("mm", frame))
        return replace(shape, stated=UnitAndFrame("mm", f"the {SUMMARY_FILE} beside it", frame))
    return read_file(path, options)


def read_finished_summary(directory: Path) -> ScanSummary:
    """Read the summary of a finished run, of one scan or stitched.

    Raises
    ------
    ConfigurationError
        If the directory holds no finished run, or files that lead out of it.
    """
    refuse_links_outside(directory, SUMMARY_FILE, SECTIONS_FILE, CLOUD_FILE, BUDGET_FILE)
    if not (directory / SUMMARY_FILE).is_file():
        hint = f"; its stations are not stitched yet: tjscan stitch {directory}"
        stations = directory.is_dir() and any(directory.glob(f"*/{SUMMARY_FILE}"))
        problem = f"is no finished run: it holds no {SUMMARY_FILE}{hint if stations else ''}"
        raise ConfigurationError(problem, file=directory)
    return read_summary(directory / SUMMARY_FILE)


def read_finished_sections(directory: Path) -> tuple[ScanSummary, tuple[MeasuredSection, ...]]:
    """Read summary and sections of a finished run, sections by growing azimuth.

    Raises
    ------
    ConfigurationError
        If the directory holds no finished run, or its files are damaged.
    """
    summary = read_finished_summary(directory)
    return summary, sort_sections_by_azimuth(read_sections_csv(directory / SECTIONS_FILE))


def sort_sections_by_azimuth(sections: tuple[MeasuredSection, ...]) -> tuple[MeasuredSection, ...]:
    """Sections by growing azimuth, whichever way the scan went; as they are if none is known.

    Parameters
    ----------
    sections : tuple of MeasuredSection
        In their order along the groove.
    """
    azimuths = np.unwrap([section.azimuth for section in sections])
    if np.isnan(azimuths).any():
        return sections
    return tuple(sections[i] for i in np.argsort(azimuths))


def read_run_shape(directory: Path) -> Shape:
    """Read the cloud and the corners of a run, in the frame that its summary names.

    Raises
    ------
    ConfigurationError
        If the directory holds no finished run, or its files are damaged.
    """
    summary = read_finished_summary(directory)
    frame = summary.frame
    sections = read_sections_csv(directory / SECTIONS_FILE)
    if not sections:
        raise ConfigurationError("holds no section", file=directory / SECTIONS_FILE)
    check_files_unaltered(directory / CLOUD_FILE)
    cloud = read_file(directory / CLOUD_FILE, UserUnitAndFrame("mm", frame))
    welded = [WELD_IN_GROOVE in section.conditions for section in sections]
    return Shape(
        directory.resolve().name,
        UnitAndFrame("mm", "the run", frame),
        cloud.points,
        readonly_copy(np.array([section.points for section in sections])),
        # Under a weld the root's corners are buried: the toes are at hand for them.
        absent_corners(sections) | np.outer(welded, (False, True, True)),
        dropped=cloud.dropped,
        # Stitching makes frame j of the tubes that it finds; a job only states where j should be.
        is_in_joint_frame=frame == "j" and bool(summary.stations),
        budget=read_budget(directory / BUDGET_FILE, len(sections)),
        wall_normals=_wall_normals(sections),
    )


def _wall_normals(sections: tuple[MeasuredSection, ...]) -> Array | None:
    """Out of the brace's wall and the leg; None if one section alone has no direction."""
    if len(sections) < 2:
        return None
    found = section_directions(sections)
    return np.stack((found.wall, found.leg), axis=1)
