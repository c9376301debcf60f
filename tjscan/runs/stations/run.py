"""Scan from all stations of a job, one after the other, and stitch their scans."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from tjscan.calibration.wizard.operator import Question
from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, RecordingError, StitchingRefused, TjscanError
from tjscan.core.files import lock_and_clean_directory, refuse_links_outside
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.recording.journal import Journal
from tjscan.recording.reader import RecordingDamage
from tjscan.result.directory import JOB_FILE, SUMMARY_FILE
from tjscan.result.summary import ScanSummary, read_summary
from tjscan.runs import run
from tjscan.runs.scan.run import ScanContext, check_keys_replaceable, resume_scan, run_scan
from tjscan.runs.stations.carriage import carriage_of_job
from tjscan.runs.stations.stitch import StitchedRun, stitch_run_directories
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.recording import read_recorded_scan

Watch = Callable[[str, ScanPlan], AbstractContextManager[Journal]]
"""Gives a journal that shows the scan of a station while it runs."""


class StationOperator(Protocol):
    """The person who moves the arm from station to station, and confirms that it is there."""

    def confirm(self, question: Question) -> bool:
        """Answer a yes-or-no question, such as whether the arm is at a station."""


@dataclass(frozen=True, slots=True)
class StationScan:
    """The scan from one station: its run directory, and its summary once it is scanned.

    Parameters
    ----------
    name : str
        The station's name.
    directory : Path
        Its own run directory.
    summary : ScanSummary or None
        Its scan in a few numbers; None if it is still to be scanned.
    """

    name: str
    directory: Path
    summary: ScanSummary | None

    @property
    def is_complete(self) -> bool:
        """Whether the station's scan did what was asked."""
        return self.summary is not None and self.summary.complete


def run_stations(
    context: ScanContext, directory: Path, operator: StationOperator, watch: Watch
) -> tuple[StationScan, ...]:
    """Scan from one station after the other; each leaves a run directory of its own in `directory`.

    Nothing moves before the jobs of all stations are found sound.

    Parameters
    ----------
    context : ScanContext
        The job, with several stations; its journal is not used.
    directory : Path
        The directory to make.
    operator : StationOperator
        Is asked before the arm moves at another station than the first.
    watch : callable
        Gives a journal for each scan.

    Returns
    -------
    tuple of StationScan
        In the job's order, those also that are still to be scanned.

    Raises
    ------
    TjscanError
        As `run_scan` does; the stations that were scanned before are whole.
    """
    _check_cells_at_stations(context)
    context.make_run_directory(directory)
    made = replace(context, job=read_scan_job(directory / JOB_FILE), job_file=directory / JOB_FILE)
    return resume_stations(made, {}, operator, watch)


def resume_stations(
    context: ScanContext,
    overrides: dict[str, Any],
    operator: StationOperator,
    watch: Watch,
    only: str | None = None,
) -> tuple[StationScan, ...]:
    """Resume a scan from several stations: those cut short, and those not begun.

    Parameters
    ----------
    context : ScanContext
        The job as the directory that `run_stations` made holds it, with keys replaced or not.
    overrides : dict
        The dotted keys that were replaced, and their values.
    operator, watch
        As of `run_stations`.
    only : str, optional
        The one station to scan; all if left out.

    Returns
    -------
    tuple of StationScan
        Of all stations, in the job's order.

    Raises
    ------
    TjscanError
        As `resume_scan` does.
    """
    job, job_file = context.job, context.job_file
    directory = job_file.parent
    refuse_links_outside(directory, *run.RUN_INPUT_FILES)
    check_keys_replaceable(overrides, job_file)
    refuse_links_outside(directory, *job.station_names)
    _check_cells_at_stations(context)
    if only is not None:
        with add_file_to_errors(job_file):
            job.job_at_station(only)
    with (
        lock_and_clean_directory(directory),
        carriage_of_job(context, directory, partial(_is_confirmed, operator)) as carriage,
    ):
        for name in job.station_names if only is None else (only,):
            found = _read_station_scan(directory, name)
            if found.is_complete:
                continue
            if context.stop.ends_after_section or not (
                carriage or _is_arm_at_station(job, found, operator)
            ):
                break
            try:
                there = carriage.bring_to(name) if carriage else context.at_station(name)
                if context.stop.ends_after_section:
                    break
                with watch(name, there.job.scan) as journal:
                    run.accept_edited_copies(directory, journal)
                    _scan_from_station(replace(there, journal=journal), found, overrides)
            except TjscanError as error:
                error.add_note(
                    f"Station {name} is not finished; what other stations scanned is whole. When "
                    f"this is put right: tjscan scan --resume {directory}"
                )
                raise
    return tuple(_read_station_scan(directory, name) for name in job.station_names)


def stitch_station_runs(
    directory: Path, finished: run.WhenFinished = run.do_nothing
) -> StitchedRun:
    """Stitch the scans of all stations, and write the result beside their directories.

    Parameters
    ----------
    directory : Path
        What `run_stations` made.
    finished : callable
        Is called with the directory once the results are written.

    Raises
    ------
    StitchingRefused
        If they can't be stitched; what each of them scanned is whole.
    """
    with lock_and_clean_directory(directory):
        try:
            return stitch_run_directories([directory], directory, finished=finished)
        except StitchingRefused as error:
            error.add_note(
                "What each station scanned is whole. If an overlap is too small, scan further: "
                f"tjscan scan --resume {directory}/STATION --scan.length-mm LENGTH; then "
                f"tjscan scan --resume {directory}"
            )
            raise


def _check_cells_at_stations(context: ScanContext) -> None:
    """Check that a cell can be made, and a carrier's postures held, at every station.

    None is connected.
    """
    if context.job.laser.driver_kind is DriverKind.REPLAYED:
        raise ConfigurationError(
            "a recording is of one station: replay them one by one, with --station",
            file=context.job_file,
            key="laser.driver",
        )
    for name in context.job.station_names:
        there = context.at_station(name)
        arm, carrier = there.make_cell().clearance.kinematics, there.job.carrier
        postures = {"station.posture_deg": there.job.station[0].posture}
        if carrier is not None:
            postures["carrier.home_deg"] = carrier.home
        for key, q in postures.items():
            if q is not None and (
                len(q) != len(arm.lower) or arm.joint_limit_excess(np.array(q)).max() > 0
            ):
                raise ConfigurationError(
                    f"names {len(arm.lower)} joint angles within the limits of the arm",
                    file=context.job_file,
                    key=key,
                )


def _read_station_scan(directory: Path, name: str) -> StationScan:
    file = directory / name / SUMMARY_FILE
    return StationScan(name, file.parent, read_summary(file) if file.is_file() else None)


def _is_arm_at_station(job: ScanJob, station: StationScan, operator: StationOperator) -> bool:
    """Whether the arm is there: it is at the first station, and at one that was cut short."""
    i = job.station_names.index(station.name)
    if i == 0 or (station.directory / JOB_FILE).is_file():
        return True
    before = _read_station_scan(station.directory.parent, job.station_names[i - 1])
    so_far = " is not scanned."
    if before.summary is not None:
        so_far = f": {before.summary.sections} sections, {before.summary.detail}."
    text = (
        f"Station {before.name}{so_far} Move the arm to station {station.name}. Is it there, "
        "firmly, and is the way to its start poses free?"
    )
    return _is_confirmed(operator, text)


def _is_confirmed(operator: StationOperator, text: str) -> bool:
    return operator.confirm(Question(text, default=True))


def _scan_from_station(
    context: ScanContext, station: StationScan, overrides: dict[str, Any]
) -> None:
    """Scan from one station, or go on with its scan if two sections of it are finished."""
    file = station.directory / JOB_FILE
    if file.is_file():
        begun = not run.nothing_recorded_yet(station.directory)
        damages: list[RecordingDamage] = []  # which the resume reports
        if begun and len(read_recorded_scan(station.directory, damages.append).sections) >= 2:
            refuse_links_outside(station.directory, JOB_FILE)
            job = read_scan_job(file, overrides)
            resume_scan(replace(context, job=job, job_file=file), overrides)
            return
        # Nothing to go on from: its start poses may have been taught again since.
        _rename_aside(station.directory)
    run_scan(context, station.directory)


def _rename_aside(directory: Path) -> None:
    """Rename a folder to one that can be no station's."""
    aside = (directory.with_name(f"{directory.name}.{i}") for i in count(1))
    try:
        directory.rename(next(folder for folder in aside if not folder.exists()))
    except OSError as error:
        raise RecordingError(f"{directory}: can't be renamed: {error.strerror}") from error
