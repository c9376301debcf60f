"""The run directory: made before anything moves, with the resolved job in it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Final

import tomli_w

from tjscan.core.config import table_to_dict
from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.files import DRAFT_PREFIX, write_files_atomically
from tjscan.core.locks import lock_directory
from tjscan.core.manifest import MANIFEST_FILE, changed_since_written, check_as_written
from tjscan.core.provenance import Provenance
from tjscan.job import CalibrationSettings, CellJob
from tjscan.recording.header import JobSnapshot, file_sha256
from tjscan.recording.parts import recording_files
from tjscan.result.directory import (
    CALIBRATION_FILE,
    JOB_FILE,
    JOINT_FILE,
    URDF_FILE,
    job_label_of_run,
    job_name_and_hash,
)

COPIED_FILES: Final = (JOB_FILE, JOINT_FILE, CALIBRATION_FILE, URDF_FILE)
"""What a run directory is made with."""

REPLAYED_TASKS: Final = ("crawl", "tow")
"""What is replayed into another run directory, as its recordings are named."""


def default_run_directory(job_file: Path, station: str | None = None) -> Path:
    """``runs/JOB-DATE``, or ``runs/JOB-STATION-DATE``, below the working directory."""
    words = (job_file.stem, *(() if station is None else (station,)))
    return Path("runs") / f"{'-'.join(words)}-{datetime.now():%Y%m%d-%H%M%S}"


def make_run_directory(
    directory: Path,
    job: CellJob,
    job_file: Path,
    *,
    joint: Path | None = None,
    calibration: Path | None = None,
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
    joint, calibration : Path, optional
        The files that the job names.

    Raises
    ------
    ConfigurationError
        If the directory holds something already.
    RecordingError
        If it can't be made, or a file that the job names lies in a run directory and is not as
        it was written.
    """
    check_as_written(*(file for file in (joint, calibration) if file is not None))
    with empty_run_directory(directory) as draft:
        if joint is not None:
            shutil.copyfile(joint, draft / JOINT_FILE)
        if calibration is not None:
            shutil.copyfile(calibration, draft / CALIBRATION_FILE)
        if Path(job.arm.model).suffix == ".urdf":
            shutil.copyfile(job.arm.model, draft / URDF_FILE)
        write_job_copy(draft, _text(job, draft), job_file, "w" if job.station else "b")


def check_replay(
    directory: Path, out: Path, keys: Iterable[str], replayable: tuple[str, ...], what: str
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
        What those that may be begin with.
    what : str
        What was run, as its recording is named: crawl or tow.

    Raises
    ------
    ConfigurationError
        If there is no such run, a key says how it was done, or the new directory would lie in its
        own.
    """
    if not _holds(directory, what):
        others = [other for other in REPLAYED_TASKS if other != what and _holds(directory, other)]
        advice = [f"it holds a {other}: tjscan {other} replay takes it" for other in others]
        raise ConfigurationError(
            f"holds no {what}: {', '.join(advice) or 'give the run directory of one'}",
            file=directory,
        )
    for key in keys:
        if not key.startswith(replayable):
            raise ConfigurationError(
                f"says how the {what} was done, and it is done. What may change: "
                f"{', '.join(name.rstrip('.') for name in replayable)}",
                file=directory / JOB_FILE,
                key=key,
            )
    if out.resolve().is_relative_to(directory.resolve()):
        raise ConfigurationError("lies in the run directory, which stays as it is", file=out)


def _holds(directory: Path, what: str) -> bool:
    """Whether a directory is that of a run, with its job and a recording of that name."""
    return (directory / JOB_FILE).is_file() and recording_files(directory, what)[0].is_file()


@contextmanager
def empty_run_directory(directory: Path) -> Iterator[Path]:
    """Make a run directory; what the block writes into the draft it gets stands there at once.

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
        _check_empty(directory, draft)
        yield draft


def accept_edited_copies(directory: Path, record_event: Callable[[str, str], object]) -> None:
    """Take what a run directory is made with as it now is, and report what was edited in it."""
    edited = changed_since_written(*(directory / name for name in COPIED_FILES))
    if edited:
        with write_files_atomically(directory) as draft:
            for file in edited:
                shutil.copyfile(file, draft / file.name)
    for file in edited:
        record_event("changed", f"{file.name} was edited since it was written")


def write_job_copy(draft: Path, text: str, job_file: Path, frame: str) -> None:
    """Write a job's text into a run directory's draft, under a head that says where it is from.

    Parameters
    ----------
    draft : Path
        As `empty_run_directory` gives it.
    text : str
        TOML.
    job_file : Path
        The file that the job was read from.
    frame : str
        Of the run's coordinates.
    """
    name = job_name_and_hash(_first_name(job_file), text.encode())
    head = Provenance.for_file_written_now(name, frame).comment_lines("#")
    (draft / JOB_FILE).write_text(head + text, encoding="utf-8")


def _first_name(job_file: Path) -> str:
    """Name of the file that a job was first read from, be it from a copy in a run directory."""
    copied = (
        job_label_of_run(job_file.parent).rpartition(", SHA-256 ")[0]
        if job_file.name == JOB_FILE
        else ""
    )
    return copied or job_file.name


def _check_empty(directory: Path, draft: Path) -> None:
    """Refuse a directory that holds anything but what one killed in the making of it left."""
    names = {file.name for file in directory.iterdir()} - {draft.name}
    files = {name for name in names if not name.startswith(DRAFT_PREFIX)}
    half_made = files < names and files <= {*COPIED_FILES, MANIFEST_FILE} - {JOB_FILE}
    if files and not half_made:
        raise ConfigurationError(
            "is not empty; a run never overwrites another. Choose another --out", file=directory
        )


def nothing_recorded_yet(directory: Path) -> bool:
    """Whether a run directory was made and nothing was recorded in it yet."""
    return all(
        file.name in (*COPIED_FILES, MANIFEST_FILE) or file.name.startswith(DRAFT_PREFIX)
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
        texts = {
            name: file.read_text(encoding="utf-8") if file.is_file() else ""
            for name, file in (
                ("joint", directory / JOINT_FILE),
                ("calibration", directory / CALIBRATION_FILE),
            )
        }
        urdf = directory / URDF_FILE
        arm = file_sha256(urdf) if urdf.is_file() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{directory}: can't be read: {error}") from error
    return JobSnapshot(_text(job, directory), **texts, arm=arm)


def _text(job: CellJob, directory: Path) -> str:
    """A job as TOML that names the copies which stand in a directory."""
    if job.joint is not None and (directory / JOINT_FILE).is_file():
        job = job.model_copy(update={"joint": replace(job.joint, file=JOINT_FILE)})
    if (directory / CALIBRATION_FILE).is_file():
        job = job.model_copy(update={"calibration": CalibrationSettings(file=CALIBRATION_FILE)})
    if (directory / URDF_FILE).is_file():
        job = job.model_copy(update={"arm": replace(job.arm, model=URDF_FILE)})
    return tomli_w.dumps(table_to_dict(job))
