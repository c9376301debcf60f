"""What ``tjscan calibrate`` does once its options are checked, and what it prints."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tjscan.calibration.file import BallEntry, ResidualEntry, SavedCalibration
from tjscan.cli.operators import chosen_operator
from tjscan.cli.options.page import LiveOptions
from tjscan.cli.output.console import print_figures_table, print_message
from tjscan.job.files import CalibrationJob, RecordedJob
from tjscan.report.write import write_run_report
from tjscan.result.directory import CALIBRATION_PICTURE
from tjscan.runs.calibration import run
from tjscan.runs.run import default_run_directory

if TYPE_CHECKING:
    from tjscan.cli.calibrate import CalibrationMode


def print_job_check(job: CalibrationJob, file: Path) -> None:
    """Check the job of a calibration, plan its lines, and print how sure they would make it."""
    found = run.check_calibration_job(job, file)
    print_message(
        f"{file}: the job is sound, and the arm gets to all {job.board.lines} lines; their noise "
        f"would leave the sensor's pose uncertain to {1e3 * found.position:.2f} mm and "
        f"{np.degrees(found.rotation):.3f}°"
    )


def calibrate_and_print(
    job: CalibrationJob | RecordedJob,
    file: Path,
    out: Path | None,
    page: LiveOptions,
    mode: CalibrationMode,
    *,
    resume: bool,
    json: bool,
) -> None:
    """Calibrate the cell of a job, or from recorded profiles, and print what was found."""
    directory = out or default_run_directory(file)
    if isinstance(job, RecordedJob):
        done = run.calibrate_recorded_job(job, file, directory, print_message)
    else:
        with chosen_operator(job, file, page, unattended=mode.unattended) as operator:
            if resume:
                done = run.resume_calibration(file.parent, operator)
            else:
                done = run.start_calibration(job, file, directory, operator, arm=mode.arm)
    _print_finished_calibration(done, json=json)
    if isinstance(job, RecordedJob) and (job.arm.id is None or job.laser.id is None):
        print_message(
            "name the devices with the keys arm.id and laser.id, or a scan will refuse that file"
        )


def _print_finished_calibration(done: SavedCalibration, *, json: bool) -> None:
    """Write page and picture of a calibration, and print it on stderr, as JSON on stdout if asked.

    Raises
    ------
    RecordingError
        If page and picture can't be written.
    """
    page = write_run_report(done.file.parent)
    found = done.calibration
    head = ("", "used", "offset mm", "tilt °", "residual σ", "shifts the sensor by mm")
    print_figures_table(head, map(_residual_cells, found.residuals))
    print_message("")
    for row in found.sensor_rows:
        print_message("  ".join(f"{value:10.4f}" for value in row))
    print_message(
        f"standard uncertainty {found.sigma_position_mm:.3f} mm and "
        f"{found.sigma_rotation_deg:.4f}° (RMS), from {found.lines} lines, "
        f"{found.method}, condition number {found.condition:.1f}"
    )
    if found.T_b_s_mm is not None:
        print_message("the sensor is fixed in the room: this is its pose in the arm's base")
    if found.ball is not None:
        print_message(_ball_in_words(found.ball))
    for caveat in done.caveats:
        print_message(f"warning: {caveat}")
    print_message(f"written to {done.file}; on a page: {page.name}, {CALIBRATION_PICTURE}")
    if json:
        print(found.model_dump_json(indent=2))


def _ball_in_words(ball: BallEntry) -> str:
    stated = ball.stated_radius_mm
    return (
        f"radius of the ball as the arcs show it {ball.measured_radius_mm:.3f} mm "
        f"± {ball.sigma_radius_mm:.3f} mm"
        + ("" if stated is None else f"; stated {stated:.3f} mm, which agrees")
    )


def _residual_cells(residual: ResidualEntry) -> tuple[str, ...]:
    return (
        residual.name,
        "yes" if residual.used else "BAD",
        f"{residual.offset_mm:+.3f}",
        "" if residual.tilt_deg is None else f"{residual.tilt_deg:+.3f}",
        f"{residual.misfit:.1f}",
        f"{residual.shift_mm:.3f}",
    )
