"""What ``tjscan calibrate`` does once its options are checked, whom it asks and what it prints."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tjscan.calibration.file import ResidualEntry, SavedCalibration, read_calibration
from tjscan.calibration.recorded import check_on_recorded_sets
from tjscan.calibration.recorded_settings import SolveSettings
from tjscan.calibration.wizard.operator import DefaultAnswerOperator, Operator, Question
from tjscan.cli.interrupt import ctrl_c_presser
from tjscan.cli.options.shared import CalibrationMode, LiveOptions
from tjscan.cli.output.console import print_figures_table, print_message
from tjscan.core.errors import ConfigurationError
from tjscan.job.files import CalibrationJob, RecordedJob
from tjscan.report.write import write_run_report
from tjscan.result.directory import CALIBRATION_PICTURE, default_run_directory
from tjscan.runs.calibration import run

if TYPE_CHECKING:
    from tjscan.calibration.wizard.session import CalibrationProgress


class PrintOnlyOperator(DefaultAnswerOperator):
    """Operator without a person: prints what happens, and answers with each question's default."""

    def report(self, message: str) -> None:
        """Print a message about what happened."""
        print_message(message)

    def show_uncertainty(self, progress: CalibrationProgress) -> None:
        """Print the uncertainty of the calibration so far."""
        sure, lines = progress.uncertainty, len(progress.samples)
        how = f"standard uncertainty {1e3 * sure.position:.3f} mm, {np.degrees(sure.rotation):.4f}°"
        if progress.result is None:
            print_message(f"{lines} of {progress.wanted} lines; expected {how}")
            return
        names = ", ".join(progress.result.rejected_sample_names)
        bad = f"; contradicting: {names}" if names else ""
        print_message(
            f"{lines} of {progress.wanted} lines; {how}, "
            f"condition number {progress.result.condition:.1f}{bad}"
        )


@contextmanager
def choose_operator(
    job: CalibrationJob, job_file: Path, page: LiveOptions, *, unattended: bool
) -> Iterator[Operator]:
    """Yield the operator of a calibration, on the page, at the terminal or none.

    Raises
    ------
    ConfigurationError
        If there is no terminal to ask at.
    PageUnavailable
        If there is no page to ask on.
    """
    if page.live:
        from tjscan.runs.live.calibration import operator_on_page

        with operator_on_page(
            job, job_file, page.page_address, print_message, ctrl_c_presser()
        ) as operator:
            yield operator
    else:
        yield PrintOnlyOperator() if unattended else TerminalOperator()


class TerminalOperator(PrintOnlyOperator):
    """Operator who is asked at the terminal.

    Parameters
    ----------
    otherwise : str
        What to do without a terminal.

    Raises
    ------
    ConfigurationError
        If there is no terminal to ask at.
    """

    present = True

    def __init__(self, otherwise: str = "a simulated cell needs none with --unattended") -> None:
        if not sys.stdin.isatty():
            raise ConfigurationError(f"there is no terminal to ask at; {otherwise}")
        self._trusted = False

    def confirm(self, question: Question) -> bool:
        """Ask yes or no at the terminal; for moves there is also a yes to all that follow.

        Raises
        ------
        KeyboardInterrupt
            If the person leaves.
        """
        import questionary

        if not question.moves:
            return bool(questionary.confirm(question.text, default=question.default).unsafe_ask())
        if self._trusted:
            return True
        answers = ["move", "move, and don't ask again", "pass over"]
        answer = questionary.select(question.text, choices=answers).unsafe_ask()
        self._trusted = answer == answers[1]
        return bool(answer != answers[2])


def print_job_check(job: CalibrationJob, file: Path) -> None:
    """Check the job of a calibration, plan its lines, and print how sure they would make it."""
    found = run.check_calibration_job(job, file)
    print_message(
        f"{file}: the job is sound, and the arm gets to all {job.board.lines} lines; their noise "
        f"would leave the sensor's pose uncertain to {1e3 * found.position:.2f} mm and "
        f"{np.degrees(found.rotation):.3f}°"
    )


def print_calibration_check(calibration: Path, job: RecordedJob, folder: Path) -> None:
    """Check a calibration on recorded profiles, print how they agree, and exit with 1 if not."""
    old = read_calibration(calibration)
    if old.kinematics is not None or old.T_b_s_mm is not None or job.solve != SolveSettings():
        raise ConfigurationError(
            "a sensor that is fixed in the room, or was calibrated with its arm, can't be checked "
            "so: calibrate again and compare",
            file=calibration,
        )
    found = check_on_recorded_sets(
        old.T_f_s, old.covariance_si, job.recorded, job.noise, folder, print_message
    )
    shift, turn = (float(np.linalg.norm(half)) for half in np.split(found.moved, 2))
    position, rotation = 1e3 * found.sigma.position, np.degrees(found.sigma.rotation)
    print_message(
        f"{calibration}: by the new profiles the sensor is {1e3 * shift:.2f} mm and "
        f"{np.degrees(turn):.3f}° from there, standard uncertainty {position:.2f} mm and "
        f"{rotation:.3f}°: {found.misfit:.2f} standard deviations (RMS of six), the limit is "
        f"{found.limit:.2f}"
    )
    print_message("it holds" if found.holds else "it does not hold: calibrate again")
    if not found.holds:
        raise SystemExit(1)


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
        with choose_operator(job, file, page, unattended=mode.unattended) as operator:
            if resume:
                done = run.resume_calibration(file.parent, operator)
            else:
                done = run.start_calibration(job, file, directory, operator, arm=mode.arm)
    _print_finished_calibration(done, json=json)
    carried = done.calibration.T_f_s_mm is not None
    if isinstance(job, RecordedJob) and carried and None in (job.arm.id, job.laser.id):
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
    for row in found.sensor_pose_rows:
        print_message("  ".join(f"{value:10.4f}" for value in row))
    print_message(
        f"standard uncertainty {found.sigma_position_mm:.3f} mm and "
        f"{found.sigma_rotation_deg:.4f}° (RMS), from {found.lines} lines, "
        f"{found.method}, condition number {found.condition:.1f}"
    )
    if found.T_b_s_mm is not None:
        print_message(
            "the sensor is fixed in the room: this is its pose in the arm's base"
            if found.kinematics is None
            else "this is the pose, in the arm's base, of the frame that the points count in; a "
            "scan takes the arm's deviations from a file of its sensor: calibrate both together"
        )
    if (ball := found.ball) is not None:
        stated = ball.stated_radius_mm
        agreement = "" if stated is None else f"; stated {stated:.3f} mm, which agrees"
        print_message(
            f"radius of the ball as the arcs show it {ball.measured_radius_mm:.3f} mm "
            f"± {ball.sigma_radius_mm:.3f} mm{agreement}"
        )
    for caveat in done.caveats:
        print_message(f"warning: {caveat}")
    print_message(f"written to {done.file}; on a page: {page.name}, {CALIBRATION_PICTURE}")
    if json:
        print(found.model_dump_json(indent=2))


def _residual_cells(residual: ResidualEntry) -> tuple[str, ...]:
    return (
        residual.name,
        "yes" if residual.used else "BAD",
        f"{residual.offset_mm:+.3f}",
        "" if residual.tilt_deg is None else f"{residual.tilt_deg:+.3f}",
        f"{residual.misfit:.1f}",
        f"{residual.shift_mm:.3f}",
    )
