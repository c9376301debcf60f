"""The run directory: made before anything moves, with the resolved job in it."""

from __future__ import annotations

import shutil
from datetime import datetime
from pathlib import Path

import tomli_w

from tjscan.errors import ConfigurationError, RecordingError
from tjscan.files import drafted
from tjscan.job import JobFile


def default_directory(job_file: Path) -> Path:
    """``runs/JOB-DATE`` below the working directory."""
    return Path("runs") / f"{job_file.stem}-{datetime.now():%Y%m%d-%H%M%S}"


def make_directory(directory: Path, job: JobFile, joint_file: Path | None) -> None:
    """Make a run directory that holds the resolved job, and the joint if there is one.

    The job in it names its own copy of the joint, so the directory can be moved and run again.

    Raises
    ------
    ConfigurationError
        If the directory holds something already.
    RecordingError
        If it can't be made.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.iterdir()):
            raise ConfigurationError(
                "is not empty; a scan never overwrites another. Choose another --out",
                file=directory,
            )
    except OSError as error:
        raise RecordingError(f"{directory}: can't be made: {error.strerror}") from error
    with drafted(directory) as draft:
        if job.joint is not None and joint_file is not None:
            shutil.copyfile(joint_file, draft / "joint.toml")
            joint = job.joint.model_copy(update={"file": "joint.toml"})
            job = job.model_copy(update={"joint": joint})
        text = tomli_w.dumps(job.model_dump(mode="json", exclude_none=True))
        (draft / "job.toml").write_text(text, encoding="utf-8")
