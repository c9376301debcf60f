"""What a report is made of: all that a run directory holds, of one scan or stitched."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.calibration.file import CalibrationFile, read_calibration
from tjscan.comparison.compare import Align, Comparison, check_tolerance, compare
from tjscan.comparison.shapes import Shape
from tjscan.comparison.sidecar import ShapeOptions
from tjscan.core.errors import ComparisonRefused, ConfigurationError
from tjscan.core.frames import Array
from tjscan.groove.measured import MeasuredSection
from tjscan.job import JobFile, read_job
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.report.stations import station_folders
from tjscan.result.directory import CALIBRATION, JOB, JOINT, SECTIONS, SUMMARY
from tjscan.result.shapes import read_run_shape, read_shape
from tjscan.result.stitching import StitchingReport, read_stitching
from tjscan.result.summary import Summary, check_recorded, read_summary
from tjscan.result.table import read_sections
from tjscan.scanning.reader import read_scan
from tjscan.scanning.recorded import RecordedScan

RECORDING: Final = "scan.mcap"


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A place that was scanned from.

    Parameters
    ----------
    name : str
        What sections call it.
    directory : Path
        Its run directory.
    job : JobFile
        What it was asked.
    calibration : CalibrationFile or None
        What it was made with; None where the job itself holds the sensor's pose.
    log : RecordedScan
        What happened.
    summary : Summary
        What came out.
    """

    name: str
    directory: Path
    job: JobFile
    calibration: CalibrationFile | None
    log: RecordedScan
    summary: Summary


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """What a report is made of.

    Parameters
    ----------
    directory : Path
        The run directory.
    summary : Summary
        What came out, in a few numbers.
    sections : tuple of MeasuredSection
        In the frame that the summary names, in the order along the groove.
    shape : Shape
        Cloud and corners.
    places : tuple of Place
        Where it was scanned from, as far as their recordings are there.
    joint : JointDefinition or None
        The joint as designed, where the run names one and stands in its frame.
    comparison : Comparison or None
        With the joint as designed, or with another reference.
    stitching : StitchingReport or None
        How its stations were stitched; None for a scan from one place.
    caveats : tuple of str
        What could not be done.
    """

    directory: Path
    summary: Summary
    sections: tuple[MeasuredSection, ...]
    shape: Shape
    places: tuple[Place, ...]
    joint: JointDefinition | None
    comparison: Comparison | None
    stitching: StitchingReport | None
    caveats: tuple[str, ...]

    @property
    def name(self) -> str:
        """What the run is called."""
        return self.directory.resolve().name

    @property
    def azimuths(self) -> Array | None:
        """Azimuths of the sections in degrees, without a jump; None where they are not known."""
        azimuths = np.array([section.azimuth for section in self.sections])
        if np.isnan(azimuths).any():
            return None
        unbroken = np.degrees(np.unwrap(azimuths))
        return np.asarray(unbroken - 360 * np.floor((unbroken.mean() + 180) / 360))

    def place_of(self, section: MeasuredSection) -> Place | None:
        """Where a section was scanned from, the first where it was several; None if not there."""
        first = section.station.split("+")[0]  # which the section's number is of
        return next((place for place in self.places if place.name == first), None)


def gather(
    directory: Path,
    reference: Path | None = None,
    tolerance: float | None = None,
    options: ShapeOptions | None = None,
) -> Material:
    """Read a finished run.

    Parameters
    ----------
    directory : Path
        The run directory.
    reference : Path, optional
        What to compare it with, in place of the joint that it names.
    tolerance : float, optional
        Of the comparison, metres.
    options : ShapeOptions, optional
        Unit and frame of a reference that does not state them.

    Raises
    ------
    ConfigurationError
        If there is no finished run, or the reference can't be read.
    """
    check_tolerance(tolerance)
    shape = read_run_shape(directory)  # which holds a section or more
    summary = read_summary(directory / SUMMARY)
    sections = read_sections(directory / SECTIONS)
    stitching = read_stitching(directory)
    folders = station_folders(directory, stitching) or {sections[0].station: directory}
    file = _joint_file(directory, folders.values()) if summary.frame == "j" else None
    other = None if reference is None else read_shape(reference, options)
    comparison, caveats = _compared(shape, file, other, tolerance)
    return Material(
        directory,
        summary,
        sections,
        shape,
        tuple(
            _place(name, folder)
            for name, folder in folders.items()
            if (folder / RECORDING).is_file() and (folder / SUMMARY).is_file()
        ),
        None if file is None else read_joint(file),
        comparison,
        stitching,
        caveats,
    )


def _joint_file(directory: Path, folders: Iterable[Path]) -> Path | None:
    """The joint that the run, or one of its stations, names."""
    files = (folder / JOINT for folder in (directory, *folders))
    return next((file for file in files if file.is_file()), None)


def _compared(
    shape: Shape, joint: Path | None, other: Shape | None, tolerance: float | None
) -> tuple[Comparison | None, tuple[str, ...]]:
    """The comparison, or why there is none."""
    if other is not None:
        same = shape.stated.frame == other.stated.frame and not shape.in_own_joint
        return compare(shape, other, "none" if same else "joint", tolerance), ()
    if joint is None and tolerance is not None:
        raise ConfigurationError(
            "there is nothing to compare with: name a --reference", key="tolerance-mm"
        )
    if joint is None:
        return None, ()
    # A stitched run's frame j is made of its own tubes: which way x points may be left to choose.
    align: Align = "joint" if shape.in_own_joint else "none"
    try:
        return compare(shape, read_shape(joint), align, tolerance), ()
    except (ComparisonRefused, ConfigurationError) as error:
        return None, (f"It was not compared with the joint that the job names: {error}",)


def _place(name: str, directory: Path) -> Place:
    file = directory / CALIBRATION
    calibration = read_calibration(file) if file.is_file() else None
    job = read_job(directory / JOB)
    log, summary = read_scan(directory), read_summary(directory / SUMMARY)
    check_recorded(directory, summary, len(log.sections))
    return Place(name, directory, job, calibration, log, summary)
