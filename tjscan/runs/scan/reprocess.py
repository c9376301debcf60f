"""Read every section of a recording again, with other settings, beside what was found before."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.calibration.file import read_calibration
from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, GrooveNotFound, RecordingError
from tjscan.core.files import refuse_links_outside, write_files_atomically
from tjscan.core.frames import Array
from tjscan.core.manifest import check_files_unaltered
from tjscan.job.cell import SensorMount
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import RecordingDamage
from tjscan.result.directory import CALIBRATION_FILE, JOB_FILE, dated_sibling_directory
from tjscan.result.summary import ScanSummary
from tjscan.runs import run
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job, write_scan_results
from tjscan.runs.stations.stitch import StitchedRun, stitch_run_directories
from tjscan.scanning.journal import RecordedScan, ScanResult, StopReason
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ScannedSection
from tjscan.scanning.sections_before import read_section

UNCERTAINTY_KEY_PREFIXES: Final = ("arm.uncertainty.", "laser.uncertainty.")
REPROCESSABLE_KEY_PREFIXES: Final = ("groove.", "calibration.", "joint.", *UNCERTAINTY_KEY_PREFIXES)
"""Keys of how recorded profiles are read and reported, not of how they were taken."""

FEWEST_RESULT_SECTIONS: Final = 2
"""Sections that make a result: fewer have no step between them."""

LARGEST_SECTION_SHIFT_STEPS: Final = 0.3
"""Steps between a section now and then; one that is found further away is not the same."""


@dataclass(frozen=True, slots=True, eq=False)
class ReprocessedStation:
    """One station's run whose profiles were read again.

    Parameters
    ----------
    directory : Path
        Where it was written.
    summary : ScanSummary
        The new one.
    lost : dict of int to GrooveNotFound
        Sections that these settings don't find, and why.
    damages : tuple of RecordingDamage
        What is missing from the recording.
    """

    directory: Path
    summary: ScanSummary
    lost: dict[int, GrooveNotFound]
    damages: tuple[RecordingDamage, ...] = ()

    @property
    def is_whole(self) -> bool:
        """Whether every section that was scanned is there again."""
        return not self.lost and not self.damages


@dataclass(frozen=True, slots=True, eq=False)
class ReprocessedRun:
    """All stations of a run, read again.

    Parameters
    ----------
    directory : Path
        The new directory.
    stations : tuple of ReprocessedStation
        One for each station; one without stations.
    stitched : StitchedRun or None
        The whole groove; None if there is one station, or one is missing or has lost a section.
    """

    directory: Path
    stations: tuple[ReprocessedStation, ...]
    stitched: StitchedRun | None = None


def reprocess_run(
    directory: Path,
    overrides: dict[str, Any],
    out: Path | None = None,
    finished: run.WhenFinished = run.do_nothing,
) -> ReprocessedRun:
    """Read a run's recorded sections again with other settings, and write a new directory.

    The profiles are those recorded; with another calibration, they are where it puts
    them. A run that was cut short or resumed counts as far as it goes. The new directory is a
    whole one, its recording included. Of a damaged recording the sections that are left are read.

    Parameters
    ----------
    directory : Path
        The run directory, which stays as it is; or one that holds the runs of several stations.
    overrides : dict
        Dotted keys and values, from `REPROCESSABLE_KEY_PREFIXES` only.
    out : Path, optional
        The directory to make, outside of the run's; beside it if left out.
    finished : callable
        Is called with every directory whose results are written.

    Raises
    ------
    ConfigurationError
        If there is no run, or a key is about how its profiles were taken.
    GrooveNotFound
        If less than two sections are found with these settings.
    RecordingError
        If the recording is damaged, or the new directory can't be written.
    StitchingRefused
        If the stations can't be stitched any more.
    """
    job_file = directory / JOB_FILE
    refuse_links_outside(directory, *run.RUN_INPUT_FILES)
    check_files_unaltered(*(directory / name for name in run.RUN_INPUT_FILES))
    why = "is about how the profiles were taken, and they are taken"
    run.refuse_fixed_keys(overrides, REPROCESSABLE_KEY_PREFIXES, why, job_file)
    out = out or dated_sibling_directory(directory)
    run.refuse_directory_inside(out, directory)
    job = read_scan_job(job_file, overrides)
    context = ScanContext(job, job_file, finished=finished)
    if len(job.station) < 2:
        return ReprocessedRun(out, (_reprocess_station(context, out),))
    refuse_links_outside(directory, *job.station_names)
    context.make_run_directory(out)
    stations = []
    for name in job.station_names:
        if (file := directory / name / JOB_FILE).is_file():
            there = ScanContext(read_scan_job(file, overrides), file, finished=finished)
            stations.append(_reprocess_station(there, out / name))
    whole = len(stations) == len(job.station) and all(one.is_whole for one in stations)
    stitched = stitch_run_directories([out], out, finished=finished) if whole else None
    return ReprocessedRun(out, tuple(stations), stitched)


def _reprocess_station(context: ScanContext, out: Path) -> ReprocessedStation:
    """The same for a single run."""
    context, directory = context.at_station(), context.job_file.parent
    refuse_links_outside(directory, *run.RUN_INPUT_FILES)
    check_files_unaltered(*(directory / name for name in run.RUN_INPUT_FILES))
    with add_file_to_errors(context.job_file):
        mount = context.sensor_mount
        _refuse_other_kinematics(mount, directory)
        T_f_s = mount.T_f_s
    damages: list[RecordingDamage] = []
    recorded = read_recorded_scan(directory, damages.append)
    lost: dict[int, GrooveNotFound] = {}
    sections = tuple(_read_sections_again(context.job, recorded, T_f_s, lost))
    if len(sections) < FEWEST_RESULT_SECTIONS:
        few = f"{directory}: holds less than {FEWEST_RESULT_SECTIONS} finished sections"
        raise next(iter(lost.values()), RecordingError(few))
    context.make_run_directory(out)
    with write_files_atomically(out) as draft:
        for file in recording_files(directory):
            shutil.copyfile(file, draft / file.name)
    views = tuple(replace(view, T_b_s=view.T_b_f @ T_f_s) for view in recorded.views)
    detail = _words_of_another_reading(recorded, len(sections), len(damages))
    result = ScanResult(sections, views, recorded.stop, detail, recorded.retry_counts)
    summary = write_scan_results(context, out, result)
    return ReprocessedStation(out, summary, lost, tuple(damages))


def _refuse_other_kinematics(mount: SensorMount, directory: Path) -> None:
    """Recorded flange poses hold for the arm's kinematics as they were then."""
    file = directory / CALIBRATION_FILE
    then = read_calibration(file).kinematics if file.is_file() else None
    before = np.zeros(0) if then is None else then.deviations_si
    if not np.array_equal(before, np.zeros(0) if mount.deviations is None else mount.deviations):
        raise ConfigurationError(
            "holds other kinematics of the arm than the scan was made with, and its flange poses "
            "were recorded with those: scan again, or give a calibration of the sensor alone",
            file=mount.file,
            key="calibration.file",
        )


def _read_sections_again(
    job: ScanJob, recorded: RecordedScan, T_f_s: Array, lost: dict[int, GrooveNotFound]
) -> Iterator[ScannedSection]:
    """The sections that are found again; of the others, why not."""
    read, far = groove_reader_of_job(job), LARGEST_SECTION_SHIFT_STEPS * job.scan.step
    found: list[ScannedSection] = []
    for one in recorded.sections.values():
        try:
            section = read_section(read, one.view, one.T_s_t, found)
            moved = float(np.linalg.norm(section.T_b_g[:3, 3] - one.T_b_g[:3, 3]))
            if moved > far:
                was_read = f"what is read now is {1e3 * moved:.1f} mm from what was read then"
                raise GrooveNotFound("implausible", was_read)
        except GrooveNotFound as error:
            lost[one.view.index] = error
        else:
            found.append(section)
            yield replace(section, view=replace(one.view, T_b_s=one.view.T_b_f @ T_f_s))


def _words_of_another_reading(recorded: RecordedScan, found: int, damages: int) -> str:
    """Why the scan ended, and that this is another reading of it."""
    again = f"{found} of {len(recorded.sections)} sections read again"
    if damages:
        again += f"; its recording is damaged in {damages} place{'s' if damages > 1 else ''}"
    return f"{recorded.stop_detail or StopReason.CUT.value}; {again}"
