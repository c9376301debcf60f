"""Run a calibration: from its job to a directory with all that was measured, and the result."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tjscan.calibration.file import Calibrated, pose_to_rows, to_file, write_calibration
from tjscan.calibration.logbook import Logbook
from tjscan.calibration.operator import Operator, Question
from tjscan.calibration.wizard import Wizard
from tjscan.core.errors import CalibrationRefused, ConfigurationError
from tjscan.core.files import sole_writer
from tjscan.job import CalibrationJob, CalibrationTable, read_calibration_job
from tjscan.job.cell import mount_of, open_board_cell, task_of
from tjscan.result.directory import CALIBRATION, JOB
from tjscan.runs.directory import make_directory

MEASURED: Final = "measured.jsonl"


def start_calibration(
    job: CalibrationJob, job_file: Path, directory: Path, operator: Operator
) -> Calibrated:
    """Calibrate as a job says, and leave a directory behind that can be resumed.

    Raises
    ------
    TjscanError
        If the job is wrong, a device fails or the result can't be trusted; what was measured
        until then is kept.
    """
    if (directory / MEASURED).exists():
        raise ConfigurationError(
            f"holds a calibration already; go on with it: --resume {directory}", file=directory
        )
    # The directory keeps the guess itself: the file it may come from is not its own result.
    guess = CalibrationTable(T_f_s_mm=pose_to_rows(mount_of(job, job_file).T_f_s))
    alone = job.model_copy(update={"calibration": guess, "joint": None, "scan": None})
    make_directory(directory, alone, job_file)
    return resume_calibration(directory, operator)


def resume_calibration(directory: Path, operator: Operator) -> Calibrated:
    """Go on with a calibration where it was left; raises as `start_calibration` does."""
    job = read_calibration_job(directory / JOB)
    file = directory / CALIBRATION
    if file.exists():
        raise ConfigurationError("is finished already; there is nothing to resume", file=directory)
    if not operator.present and {job.arm.driver, job.laser.driver} != {"simulated"}:
        raise ConfigurationError("a real arm moves only while somebody watches: not unattended")
    T_f_s = mount_of(job, directory / JOB).T_f_s
    cell, probe = open_board_cell(job, T_f_s)
    with sole_writer(directory), Logbook(directory / MEASURED) as logbook, cell:
        task = task_of(job, T_f_s)
        outcome = Wizard(task, cell.arm, cell.laser, probe, operator, logbook).run()
        begun = logbook.measured.begun
    if not operator.confirm(Question(f"Save it as {file}?", default=True)):
        raise CalibrationRefused("not saved", f"what was measured stays in {directory}")
    found = to_file(
        outcome.result,
        job.board.noise.model,
        arm=job.arm.device,
        laser=job.laser.device,
        date=begun,
        verification=outcome.verification,
    )
    write_calibration(file, found)
    return Calibrated(file, found, outcome.result.caveats)
