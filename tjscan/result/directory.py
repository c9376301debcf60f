"""The run directory: made before anything moves, with the resolved job in it."""

from __future__ import annotations

import shutil
from datetime import datetime
from pathlib import Path
from typing import Final

import tomli_w

from tjscan.errors import ConfigurationError, RecordingError
from tjscan.files import drafted
from tjscan.job import CalibrationTable, CellFile

JOB: Final = "job.toml"
JOINT: Final = "joint.toml"
CALIBRATION: Final = "calibration.toml"
URDF: Final = "arm.urdf"


def default_directory(job_file: Path) -> Path:
    """``runs/JOB-DATE`` below the working directory."""
    return Path("runs") / f"{job_file.stem}-{datetime.now():%Y%m%d-%H%M%S}"


def make_directory(
    directory: Path, job: CellFile, *, joint: Path | None = None, calibration: Path | None = None
) -> None:
    """Make a run directory that holds the resolved job, and the files that it names.

    The job in it names these copies, so the directory can be moved and run again.

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
                "is not empty; a run never overwrites another. Choose another --out",
                file=directory,
            )
    except OSError as error:
        raise RecordingError(f"{directory}: can't be made: {error.strerror}") from error
    with drafted(directory) as draft:
        if job.joint is not None and joint is not None:
            shutil.copyfile(joint, draft / JOINT)
            table = job.joint.model_copy(update={"file": JOINT})
            job = job.model_copy(update={"joint": table})
        if calibration is not None:
            shutil.copyfile(calibration, draft / CALIBRATION)
            job = job.model_copy(update={"calibration": CalibrationTable(file=CALIBRATION)})
        if Path(job.arm.model).suffix == ".urdf":
            shutil.copyfile(job.arm.model, draft / URDF)
            job = job.model_copy(update={"arm": job.arm.model_copy(update={"model": URDF})})
        text = tomli_w.dumps(job.model_dump(mode="json", exclude_none=True))
        (draft / JOB).write_text(text, encoding="utf-8")
