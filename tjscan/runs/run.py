"""What every run shares: its directory, what may change in it, its recording and its results.

The directory is made before anything moves, with the resolved job in it.
"""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Final, Generic, TypeVar

import tomli_w

from tjscan.core.config import table_to_dict
from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.files import (
    DRAFT_PREFIX,
    lock_and_clean_directory,
    read_small_file,
    refuse_links_outside,
    write_files_atomically,
)
from tjscan.core.locks import lock_directory
from tjscan.core.manifest import MANIFEST_FILE, check_files_unaltered, files_altered_since_written
from tjscan.core.provenance import Provenance
from tjscan.job.crawl.job import CrawlJob
from tjscan.job.devices import CalibrationSettings
from tjscan.job.files import CellJob
from tjscan.job.tow.job import TowJob
from tjscan.job.weld import WeldJob
from tjscan.recording.header import JobSnapshot, job_snapshot_changes
from tjscan.recording.journal import CombinedJournal, Journal, RunEvent
from tjscan.recording.parts import next_recording_file, recording_files
from tjscan.result.directory import (
    CALIBRATION_FILE,
    JOB_FILE,
    JOINT_FILE,
    URDF_FILE,
    job_label,
    job_label_of_run,
)

RUN_INPUT_FILES: Final = (JOB_FILE, JOINT_FILE, CALIBRATION_FILE, URDF_FILE)
"""What a run directory is made with."""

MOST_RESULT_BYTES: Final = 50_000_000
"""A larger file is no result of a run: passes of an hour's welding take a tenth of it."""

NO_FILES_TO_COPY: Final[Mapping[str, Path | None]] = MappingProxyType({})

WPS_FILE: Final = "wps.toml"

REPLAYABLE_TASKS: Final = ("crawl", "tow")
"""What is replayed into another run directory, as its recordings are named."""


WhenFinished = Callable[[Path], object]
"""What is called with a run directory once its results are written."""

T = TypeVar("T")
V = TypeVar("V", CrawlJob, TowJob, WeldJob)


def do_nothing(directory: Path) -> None:
    """Do nothing with a run directory whose results are written."""


def nobody_objects(question: str) -> bool:
    """Whether a person agrees, in a simulation: always."""
    return True


@dataclass(frozen=True, eq=False)
class JobContext(Generic[T]):
    """A job with its file, and where its run reports progress, events and results.

    Parameters
    ----------
    job : CellJob, CrawlJob or TowJob
        The job.
    job_file : Path
        The file that it was read from; the files that it names are sought from there.
    journal : Journal
        Receives everything, once it is on disk.
    finished : callable
        Is called with every directory whose results are written, for instance `write_run_report`.
    """

    job: T
    job_file: Path
    journal: Journal = field(default_factory=CombinedJournal)
    finished: WhenFinished = do_nothing

    @property
    def calibration_file(self) -> Path | None:
        """The calibration file that the job names, if it names one."""
        return None

    @property
    def wps_file(self) -> Path | None:
        """The welding procedure specification that the job names, if it names one."""
        return None


def make_run_directory(
    directory: Path,
    job: CellJob,
    job_file: Path,
    copies: Mapping[str, Path | None] = NO_FILES_TO_COPY,
) -> None:
    """Make a run directory that holds the resolved job, and the files that it names.

    The job in it names these copies, so the directory can be moved and run again.

    Parameters
    ----------
    directory : Path
        To make, or an empty one.
    job : CellJob
        The resolved job.
    job_file : Path
        The file that it was read from, whose name every file of the run states.
    copies : mapping of str to Path or None, optional
        Files that the job names, by the names of their copies; None for one that it does not.

    Raises
    ------
    ConfigurationError
        If the directory holds something already.
    RecordingError
        If it can't be made, or a file that the job names is in a run directory and is not as
        it was written.
    """
    named = {name: file for name, file in copies.items() if file is not None}
    check_files_unaltered(*named.values())
    if (model := Path(job.arm.model)).suffix == ".urdf":
        named[URDF_FILE] = model
    with make_empty_run_directory(directory) as draft:
        for name, file in named.items():
            shutil.copyfile(file, draft / name)
        write_job_copy(draft, _job_naming_copies(job, draft), job_file, "w" if job.station else "b")


def make_vehicle_run_directory(directory: Path, context: JobContext[V]) -> None:
    """Make the run directory of a crawl or a tow; see `make_run_directory`."""
    job: CrawlJob | TowJob | WeldJob = context.job
    with make_empty_run_directory(directory) as draft:
        if context.calibration_file is not None:
            shutil.copyfile(context.calibration_file, draft / CALIBRATION_FILE)
            job = job.model_copy(update={"calibration": CALIBRATION_FILE})
        if context.wps_file is not None and isinstance(job, CrawlJob):
            shutil.copyfile(context.wps_file, draft / WPS_FILE)
            job = job.model_copy(update={"weld": replace(job.weld, wps=WPS_FILE)})
        write_job_copy(draft, tomli_w.dumps(table_to_dict(job)), context.job_file, "w")


def job_snapshot_of_file(file: Path) -> JobSnapshot:
    """Snapshot of the job of a crawl or a tow, as its run directory holds it."""
    return JobSnapshot(file.read_text(encoding="utf-8"))


@contextmanager
def record_vehicle_run(
    context: JobContext[V],
    directory: Path,
    recording: str,
    record: Callable[[Path, JobSnapshot], AbstractContextManager[Journal]],
    write_results: Callable[[Path], object] | None = None,
) -> Iterator[Journal]:
    """Record into a run directory while it is locked, and write results however the block ends.

    Parameters
    ----------
    context : JobContext
        Its journal receives everything too.
    directory : Path
        Which holds the job already.
    recording : str
        Name of its recordings.
    record : callable
        Opens the recording of a file and the job's snapshot; gives its journal.
    write_results : callable, optional
        Is called with the directory when the recording is closed, before `context.finished`.
    """
    file = next_recording_file(directory, recording)
    with lock_and_clean_directory(directory):
        try:
            with record(file, job_snapshot_of_file(directory / JOB_FILE)) as journal:
                yield CombinedJournal(journal, context.journal)
        finally:
            if write_results is not None:
                write_results(directory)
                context.finished(directory)


def check_replay(
    directory: Path, out: Path, keys: Iterable[str], replayable: tuple[str, ...], task: str
) -> None:
    """Check that a recorded run may be replayed into a directory with some keys replaced.

    Parameters
    ----------
    directory : Path
        Of the run; it stays as it is.
    out : Path
        The directory to make.
    keys : iterable of str
        Dotted keys that are replaced.
    replayable : tuple of str
        Beginnings of those that may be.
    task : str
        What was run, as its recording is named: crawl or tow.

    Raises
    ------
    ConfigurationError
        If there is no such run, a key is about how it was done, or the directory is inside.
    RecordingError
        If its job or calibration is not as it was written.
    """
    refuse_links_outside(directory, JOB_FILE, CALIBRATION_FILE)
    check_files_unaltered(directory / JOB_FILE, directory / CALIBRATION_FILE)
    names = REPLAYABLE_TASKS if (directory / JOB_FILE).is_file() else ()
    held = [name for name in names if recording_files(directory, name)[0].is_file()]
    if task not in held:
        advice = [f"it holds a {other}: tjscan {other} replay takes it" for other in held]
        what = ", ".join(advice) or "give the run directory of one"
        raise ConfigurationError(f"holds no {task}: {what}", file=directory)
    why = f"is about how the {task} was done, and it is done"
    refuse_fixed_keys(keys, replayable, why, directory / JOB_FILE)
    refuse_directory_inside(out, directory)


def refuse_fixed_keys(
    keys: Iterable[str], replaceable: tuple[str, ...], why: str, job_file: Path
) -> None:
    """Refuse to replace keys of a run's job that follow from what is recorded.

    Parameters
    ----------
    keys : iterable of str
        Dotted keys that are replaced.
    replaceable : tuple of str
        Beginnings of those that may be.
    why : str
        Why another may not.
    job_file : Path
        Of the run.

    Raises
    ------
    ConfigurationError
        Naming the first key.
    """
    for key in keys:
        if not key.startswith(replaceable):
            may = ", ".join(name.rstrip(".") for name in replaceable)
            raise ConfigurationError(f"{why}. What may change: {may}", file=job_file, key=key)


def refuse_directory_inside(out: Path, directory: Path) -> None:
    """Refuse to make a run directory inside of the one that it is made from.

    Raises
    ------
    ConfigurationError
        If it would be inside.
    """
    if out.resolve().is_relative_to(directory.resolve()):
        raise ConfigurationError("is inside the run directory, which stays as it is", file=out)


def check_job_changes(
    before: JobSnapshot, now: JobSnapshot, resumable: tuple[str, ...], advice: str, file: Path
) -> list[tuple[str, str]]:
    """Keys of a job that changed since it was recorded, and what changed.

    Parameters
    ----------
    before, now : JobSnapshot
        The job that was recorded, and as it is.
    resumable : tuple of str
        Beginnings of keys that may change.
    advice : str
        Why others may not, and what to do.
    file : Path
        That the error names.

    Raises
    ------
    ConfigurationError
        Naming the first other key.
    """
    changed = list(job_snapshot_changes(before, now))
    for key, what in changed:
        if not key.startswith(resumable):
            raise ConfigurationError(f"{what}. {advice}", file=file, key=key)
    return changed


@contextmanager
def make_empty_run_directory(directory: Path) -> Iterator[Path]:
    """Make a run directory; what the block writes into its draft appears there at once.

    Raises
    ------
    ConfigurationError
        If the directory holds something already.
    RecordingError
        If it can't be made.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{directory}: can't be made: {error.strerror}") from error
    with (
        lock_directory(directory),
        write_files_atomically(directory, last=JOB_FILE, listed=True) as draft,
    ):
        names = {file.name for file in directory.iterdir()} - {draft.name}
        files = {name for name in names if not name.startswith(DRAFT_PREFIX)}
        half_made = files < names and files <= {*RUN_INPUT_FILES, MANIFEST_FILE} - {JOB_FILE}
        if files and not half_made:  # of one killed in the making
            full = "is not empty; a run never overwrites another. Choose another --out"
            raise ConfigurationError(full, file=directory)
        yield draft


def accept_edited_copies(directory: Path, journal: Journal) -> None:
    """Take what a run directory is made with as it now is, and report what was edited in it."""
    edited = files_altered_since_written(*(directory / name for name in RUN_INPUT_FILES))
    if edited:
        with write_files_atomically(directory) as draft:
            for file in edited:
                shutil.copyfile(file, draft / file.name)
    for file in edited:
        journal.record(RunEvent("changed", f"{file.name} was edited since it was written"))


def write_job_copy(draft: Path, text: str, job_file: Path, frame: str) -> None:
    """Write a job's text into a run directory's draft, under a head that states its origin.

    Parameters
    ----------
    draft : Path
        As `make_empty_run_directory` gives it.
    text : str
        TOML.
    job_file : Path
        The file that the job was read from.
    frame : str
        Of the run's coordinates.
    """
    copied = job_label_of_run(job_file.parent) if job_file.name == JOB_FILE else ""
    first_name = copied.rpartition(", SHA-256 ")[0] or job_file.name
    name = job_label(first_name, text.encode())
    head = Provenance.for_file_written_now(name, frame).comment_lines("#")
    (draft / JOB_FILE).write_text(head + text, encoding="utf-8")


def write_result_table(
    file: Path, directory: Path, columns: Mapping[str, Callable[[T], object]], rows: Iterable[T]
) -> None:
    """Write a table of a run's results as CSV, and beside it where it comes from.

    Parameters
    ----------
    file : Path
        To write.
    directory : Path
        Of the run.
    columns : mapping
        Name of each column, and its cell of a row.
    rows : iterable
        Of the table.
    """
    stream, job = io.StringIO(), job_label_of_run(directory)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([cell(row) for cell in columns.values()] for row in rows)
    Provenance.for_file_written_now(job, "w").write_table(file, stream.getvalue())


def read_result_file(file: Path, what: str, parse: Callable[[str], T]) -> T:
    """Read a file of a run's results, as it was written.

    Parameters
    ----------
    file : Path
        In a run directory.
    what : str
        What such a file holds, for messages: ``the passes of a crawl``.
    parse : callable
        Reads its text.

    Raises
    ------
    ConfigurationError
        If it can't be read.
    """
    check_files_unaltered(file)
    try:
        return parse(read_small_file(file, MOST_RESULT_BYTES, what).decode())
    except (OSError, ValueError, TypeError, KeyError, RecursionError, csv.Error) as error:
        reason = f"can't be read: {error}. A run directory holds {what} there"
        raise ConfigurationError(reason, file=file) from None


def nothing_recorded_yet(directory: Path) -> bool:
    """Whether a run directory was made and nothing was recorded in it yet."""
    return all(
        file.name in (*RUN_INPUT_FILES, MANIFEST_FILE) or file.name.startswith(DRAFT_PREFIX)
        for file in directory.iterdir()
    )


def take_job_snapshot(directory: Path, job: CellJob) -> JobSnapshot:
    """Snapshot of a job as it now is and the files it names, for a run directory's recording.

    Raises
    ------
    RecordingError
        If a file there can't be read.
    """
    try:
        joint, calibration = (
            file.read_text(encoding="utf-8") if file.is_file() else ""
            for file in (directory / JOINT_FILE, directory / CALIBRATION_FILE)
        )
        urdf = directory / URDF_FILE
        arm = sha256(urdf.read_bytes()).hexdigest() if urdf.is_file() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{directory}: can't be read: {error}") from error
    return JobSnapshot(_job_naming_copies(job, directory), joint, calibration, arm)


def _job_naming_copies(job: CellJob, directory: Path) -> str:
    """A job as TOML that names the copies in a directory."""
    named: dict[str, object] = {}
    if job.joint is not None and (directory / JOINT_FILE).is_file():
        named["joint"] = replace(job.joint, file=JOINT_FILE)
    if (directory / CALIBRATION_FILE).is_file():
        named["calibration"] = CalibrationSettings(file=CALIBRATION_FILE)
    if (directory / URDF_FILE).is_file():
        named["arm"] = replace(job.arm, model=URDF_FILE)
    job = job.model_copy(update=named)
    return tomli_w.dumps(table_to_dict(job))
