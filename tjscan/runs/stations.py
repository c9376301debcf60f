"""Run a job from all of its stations, one after the other, and stitch what they saw."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Protocol

from tjscan.calibration.operator import Question
from tjscan.core.config import naming
from tjscan.core.errors import ConfigurationError, RecordingError, StitchingRefused, TjscanError
from tjscan.core.files import check_inside, sole_writer
from tjscan.job import JobFile, read_job
from tjscan.job.cell import mount_of
from tjscan.recording.reader import read_progress
from tjscan.result.directory import JOB, SUMMARY
from tjscan.result.summary import Summary, read_summary
from tjscan.runs.directory import COPIES, is_untouched, make_directory
from tjscan.runs.scan import (
    cell_of,
    check_resumable,
    joint_of,
    plan_of,
    reader_of,
    resume_job,
    run_job,
)
from tjscan.runs.stitch import StitchedRun, stitch_runs
from tjscan.scanning.journal import Journal
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.stopping import StopRequest

Watch = Callable[[str, ScanPlan], AbstractContextManager[Journal]]
"""Gives a journal that shows the scan of a station while it runs."""


class Attendant(Protocol):
    """Moves the arm from station to station, and says when it stands there."""

    def confirm(self, question: Question) -> bool:
        """Say yes or no."""
        ...


@dataclass(frozen=True, slots=True)
class StationScan:
    """What became of one station.

    Parameters
    ----------
    name : str
        Which.
    directory : Path
        Its own run directory.
    summary : Summary or None
        Its scan in a few numbers; None where it is still to be scanned.
    """

    name: str
    directory: Path
    summary: Summary | None

    @property
    def done(self) -> bool:
        """Whether it did what was asked."""
        return self.summary is not None and self.summary.complete


def run_stations(
    job: JobFile,
    job_file: Path,
    directory: Path,
    attendant: Attendant,
    watch: Watch,
    stop: StopRequest | None = None,
) -> tuple[StationScan, ...]:
    """Scan from one station after the other; each leaves a run directory of its own in `directory`.

    Nothing moves before the jobs of all stations are found sound.

    Parameters
    ----------
    job : JobFile
        The job, with several stations.
    job_file : Path
        Where it was read from; the files it names are sought from there.
    directory : Path
        The directory to make.
    attendant : Attendant
        Is asked before the arm moves at another station than the first.
    watch : callable
        Gives a journal for each scan.
    stop : StopRequest, optional
        Asks for an end before the job is done.

    Returns
    -------
    tuple of StationScan
        In the job's order, those also that are still to be scanned.

    Raises
    ------
    TjscanError
        As `run_job` does; the stations that were scanned before are whole.
    """
    _check(job, job_file)
    with naming(job_file):
        joint = joint_of(job, job_file)
        mount = mount_of(job, job_file)
        make_directory(directory, job, job_file, joint=joint and joint[0], calibration=mount.file)
    return resume_stations(directory, {}, attendant, watch, stop=stop)


def resume_stations(
    directory: Path,
    overrides: dict[str, Any],
    attendant: Attendant,
    watch: Watch,
    only: str | None = None,
    stop: StopRequest | None = None,
) -> tuple[StationScan, ...]:
    """Scan what is missing: stations that were cut short, and those that were not begun.

    Parameters
    ----------
    directory : Path
        What `run_stations` made.
    overrides : dict
        Dotted keys and values that may change while a scan goes on.
    attendant, watch, stop
        As of `run_stations`.
    only : str, optional
        The one station to scan; all where left out.

    Returns
    -------
    tuple of StationScan
        Of all stations, in the job's order.

    Raises
    ------
    TjscanError
        As `resume_job` does.
    """
    job_file = directory / JOB
    check_inside(directory, *COPIES)
    check_resumable(overrides, job_file)
    job = read_job(job_file, overrides)
    check_inside(directory, *job.stations)
    _check(job, job_file)
    if only is not None:
        with naming(job_file):
            job.at(only)
    stop = stop or StopRequest()
    with sole_writer(directory):
        for name in job.stations if only is None else (only,):
            found = _found(directory, name)
            if found.done:
                continue
            if stop.wanted or not _stands(job, found, attendant):
                break
            with (
                _telling_what_to_do(directory, name),
                watch(name, plan_of(job.at(name))) as journal,
            ):
                _scan(job, found, overrides, journal, stop)
    return tuple(_found(directory, name) for name in job.stations)


def stitch_stations(directory: Path) -> StitchedRun:
    """Make one groove of what all stations saw, and write it beside their directories.

    Raises
    ------
    StitchingRefused
        If they can't be stitched; what each of them scanned is whole.
    """
    with sole_writer(directory):
        try:
            return stitch_runs([directory], directory)
        except StitchingRefused as error:
            error.add_note(
                "What each station scanned is whole. Where an overlap is too small, scan further: "
                f"tjscan scan --resume {directory}/STATION --scan.length-mm LENGTH; then "
                f"tjscan scan --resume {directory}"
            )
            raise


def _check(job: JobFile, job_file: Path) -> None:
    """See that a cell can be made at every station; connect none."""
    if job.laser.is_replay:
        raise ConfigurationError(
            "a recording is of one station: replay them one by one, with --station",
            file=job_file,
            key="laser.driver",
        )
    for name in job.stations:
        cell_of(job.at(name), job_file)


def _found(directory: Path, name: str) -> StationScan:
    folder = directory / name
    file = folder / SUMMARY
    return StationScan(name, folder, read_summary(file) if file.is_file() else None)


def _stands(job: JobFile, station: StationScan, attendant: Attendant) -> bool:
    """Whether the arm stands there: it does at the first station, and at one that was cut short."""
    i = job.stations.index(station.name)
    if i == 0 or (station.directory / JOB).is_file():
        return True
    before = _found(station.directory.parent, job.stations[i - 1])
    told = (
        f"Station {before.name} is not scanned."
        if before.summary is None
        else f"Station {before.name}: {before.summary.sections} sections, {before.summary.detail}."
    )
    return attendant.confirm(
        Question(
            f"{told} Move the arm to station {station.name}. Does it stand there, firmly, and is "
            "the way to its start poses free?",
            default=True,
        )
    )


def _scan(
    job: JobFile,
    station: StationScan,
    overrides: dict[str, Any],
    journal: Journal,
    stop: StopRequest,
) -> None:
    single = job.at(station.name)
    if (station.directory / JOB).is_file():
        begun = not is_untouched(station.directory)
        if begun and len(read_progress(station.directory, reader_of(single)).sections) >= 2:
            resume_job(station.directory, overrides, journal, stop)
            return
        # Nothing to go on from: its start poses may have been taught anew since.
        _put_aside(station.directory)
    run_job(single, station.directory.parent / JOB, station.directory, journal, stop)


def _put_aside(directory: Path) -> None:
    """Rename a folder to one that can be no station's."""
    aside = (directory.with_name(f"{directory.name}.{i}") for i in count(1))
    try:
        directory.rename(next(folder for folder in aside if not folder.exists()))
    except OSError as error:
        raise RecordingError(f"{directory}: can't be renamed: {error.strerror}") from error


@contextmanager
def _telling_what_to_do(directory: Path, name: str) -> Iterator[None]:
    try:
        yield
    except TjscanError as error:
        error.add_note(
            f"Station {name} is not finished; what other stations scanned is whole. When this is "
            f"put right: tjscan scan --resume {directory}"
        )
        raise
