"""The data of a report: all that a run directory holds, of one scan or stitched."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tjscan.comparison.compare import AlignmentMethod, Comparison, check_tolerance, compare_shapes
from tjscan.comparison.shapes import Shape, UserUnitAndFrame
from tjscan.core.errors import ComparisonRefused, ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.manifest import check_files_unaltered
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.settings import GrooveSettings
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.laser.profile import Profile
from tjscan.recording.journal import RunEvent
from tjscan.result.chapter import ReportChapter, ReportChart
from tjscan.result.directory import JOINT_FILE, RECORDING_FILE, SECTIONS_FILE, SUMMARY_FILE
from tjscan.result.shapes import read_run_shape, read_shape
from tjscan.result.summary import ScanSummary, StitchingReport, read_stitching_report, read_summary
from tjscan.result.table import read_sections_csv
from tjscan.runs.tasks import ALL_TASKS


@dataclass(frozen=True, slots=True, eq=False)
class StationRunData:
    """What a report shows of one station's run: its summary and chapters.

    Parameters
    ----------
    name : str
        What sections call it.
    summary : ScanSummary
        What was found there, in a few numbers.
    chapters : tuple of ReportChapter
        What each algorithm reports on it.
    directory : Path
        Its run directory.
    """

    name: str
    summary: ScanSummary
    chapters: tuple[ReportChapter, ...]
    directory: Path

    @property
    def facts(self) -> dict[str, str]:
        """Facts of all chapters, by their names."""
        return {name: value for chapter in self.chapters for name, value in chapter.facts}

    @property
    def findings(self) -> list[str]:
        """Findings of all chapters."""
        return [finding for chapter in self.chapters for finding in chapter.findings]

    @property
    def charts(self) -> list[ReportChart]:
        """Charts of all chapters."""
        return [chart for chapter in self.chapters for chart in chapter.charts]

    @property
    def events(self) -> list[RunEvent]:
        """Events of all chapters."""
        return [event for chapter in self.chapters for event in chapter.events]

    def profile_of_section(self, index: int) -> tuple[Profile, GrooveSettings] | None:
        """The profile of a section, and how it was read; None if it is not there."""
        for chapter in self.chapters:
            if index in chapter.profiles:
                return chapter.profiles[index], chapter.settings
        return None


@dataclass(frozen=True, slots=True, eq=False)
class ReportData:
    """All that a report shows of a run: summary, sections, shape, stations, comparison.

    Parameters
    ----------
    directory : Path
        The run directory.
    summary : ScanSummary
        What came out, in a few numbers.
    sections : tuple of MeasuredSection
        In the frame that the summary names, in the order along the groove.
    shape : Shape
        Cloud and corners.
    places : tuple of StationRunData
        Where it was scanned from, as far as their recordings are there.
    joint : JointDefinition or None
        The joint as designed, if the run names one and is in its frame.
    comparison : Comparison or None
        With the joint as designed, or with another reference.
    stitching : StitchingReport or None
        How its stations were stitched; None for a scan from one place.
    caveats : tuple of str
        What could not be done.
    """

    directory: Path
    summary: ScanSummary
    sections: tuple[MeasuredSection, ...]
    shape: Shape
    places: tuple[StationRunData, ...]
    joint: JointDefinition | None
    comparison: Comparison | None
    stitching: StitchingReport | None
    caveats: tuple[str, ...]

    @property
    def cloud(self) -> Array:
        """The scanned points, shape (n, 3), metres; none if there is no cloud."""
        return np.empty((0, 3)) if self.shape.points is None else self.shape.points

    @property
    def unwrapped_azimuths(self) -> Array | None:
        """Azimuths of the sections in degrees, without a jump; None if they are not known."""
        azimuths = np.array([section.azimuth for section in self.sections])
        if np.isnan(azimuths).any():
            return None
        unbroken = np.degrees(np.unwrap(azimuths))
        return np.asarray(unbroken - 360 * np.floor((unbroken.mean() + 180) / 360))

    def section_number(self, section: MeasuredSection) -> str:
        """Number of a section in its scan, and which scan that is where several were stitched."""
        station = section.station.split("+")[0]  # which the section's number is of
        return f"{section.index}" if self.stitching is None else f"{section.index} of {station}"

    def station_of_section(self, section: MeasuredSection) -> StationRunData | None:
        """Where a section was scanned from, the first if it was several; None if not there."""
        first = section.station.split("+")[0]  # which the section's number is of
        return next((place for place in self.places if place.name == first), None)


def read_report_data(
    directory: Path,
    reference: Path | None = None,
    tolerance: float | None = None,
    options: UserUnitAndFrame | None = None,
) -> ReportData:
    """Read what a report shows of a finished run.

    Parameters
    ----------
    directory : Path
        The run directory.
    reference : Path, optional
        What to compare it with, in place of the joint that it names.
    tolerance : float, optional
        Of the comparison, metres.
    options : UserUnitAndFrame, optional
        Unit and frame of a reference that does not state them.

    Raises
    ------
    ConfigurationError
        If there is no finished run, or the reference can't be read.
    """
    check_tolerance(tolerance)
    shape = read_run_shape(directory)  # which holds a section or more
    summary = read_summary(directory / SUMMARY_FILE)
    sections = read_sections_csv(directory / SECTIONS_FILE)
    stitching = read_stitching_report(directory)
    folders = station_folders(directory, stitching) or {sections[0].station: directory}
    file = _joint_file(directory, folders.values()) if summary.frame == "j" else None
    other = None if reference is None else read_shape(reference, options)

    comparison, caveats = _compare_with_reference(shape, file, other, tolerance)
    places = []
    for name, folder in folders.items():
        if (folder / RECORDING_FILE).is_file() and (folder / SUMMARY_FILE).is_file():
            chapters = tuple(task.load("chapter")(folder) for task in ALL_TASKS)
            places.append(
                StationRunData(name, read_summary(folder / SUMMARY_FILE), chapters, folder)
            )
    run = directory, summary, sections, shape, tuple(places)
    joint = None if file is None else read_joint(file)
    return ReportData(*run, joint, comparison, stitching, caveats)


def station_folders(directory: Path, report: StitchingReport | None) -> dict[str, Path]:
    """Run directories of the stations, wherever the result was moved to.

    Parameters
    ----------
    directory : Path
        The stitched run's.
    report : StitchingReport or None
        How it was stitched; None for a scan from one place, which has no stations.
    """
    stations = () if report is None else report.stations
    return {station.name: directory / station.source for station in stations}


def _joint_file(directory: Path, folders: Iterable[Path]) -> Path | None:
    """The joint that the run, or one of its stations, names."""
    files = (folder / JOINT_FILE for folder in (directory, *folders))
    file = next((file for file in files if file.is_file()), None)
    if file is not None:
        check_files_unaltered(file)
    return file


def _compare_with_reference(
    shape: Shape, joint: Path | None, other: Shape | None, tolerance: float | None
) -> tuple[Comparison | None, tuple[str, ...]]:
    """The comparison, or why there is none."""
    if other is not None:
        same = shape.stated.frame == other.stated.frame and not shape.is_in_joint_frame
        return compare_shapes(shape, other, "none" if same else "joint", tolerance), ()
    if joint is None and tolerance is not None:
        raise ConfigurationError(
            "there is nothing to compare with: name a --reference", key="tolerance-mm"
        )
    if joint is None:
        return None, ()
    # A stitched run's frame j is made of its own tubes: which way x points may be left to choose.
    align: AlignmentMethod = "joint" if shape.is_in_joint_frame else "none"
    try:
        return compare_shapes(shape, read_shape(joint), align, tolerance), ()
    except (ComparisonRefused, ConfigurationError) as error:
        return None, (f"It was not compared with the joint that the job names: {error}",)
