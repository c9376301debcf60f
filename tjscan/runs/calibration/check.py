"""Check a calibration before it is made: whether the arm gets to its lines, and what they show."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.calibration.result import HandEyeUncertainty
from tjscan.calibration.targets.target import PosedProfile
from tjscan.calibration.targets.touched import fit_plane
from tjscan.calibration.wizard.advice import BoardRectangle
from tjscan.calibration.wizard.logbook import LaserLineTaken, MeasurementsSoFar
from tjscan.calibration.wizard.session import CalibrationPlan
from tjscan.calibration.wizard.wizard import reaches_and_returns
from tjscan.core.errors import CalibrationRefused, PoseUnreachable
from tjscan.core.frames import Array
from tjscan.job.arm import sensor_mount_of_job
from tjscan.job.files import CalibrationJob
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm
from tjscan.runs.calibration.run import calibration_plan_of_job, make_calibration_cell

NOT_TAKEN: Final = Profile(np.empty(0), np.empty(0))
"""Of a line that is planned only."""


def check_calibration_job(job: CalibrationJob, job_file: Path) -> HandEyeUncertainty:
    """Plan all lines of a calibration on the board as the job places it; move nothing.

    Parameters
    ----------
    job : CalibrationJob
        The job; its devices are connected.
    job_file : Path
        Where it was read from.

    Returns
    -------
    HandEyeUncertainty
        That is to be expected of the calibration.

    Raises
    ------
    ConfigurationError
        If the job, or a file that it names, is wrong.
    CalibrationRefused
        If the arm can't get over the board, or too few poses that it reaches see it.
    """
    T_f_s = sensor_mount_of_job(job, job_file).T_f_s
    task = calibration_plan_of_job(job, T_f_s)
    cell, _ = make_calibration_cell(job, T_f_s)
    with cell:
        return _plan_lines(task, cell.arm, _start_pose(task, cell.arm))


def _start_pose(task: CalibrationPlan, arm: Arm) -> Array:
    """Flange pose square over the board that the arm gets to."""
    reason = ""
    for T_b_f in task.start_poses(arm.state().T_b_f):
        try:
            arm.check_moves(T_b_f)
        except PoseUnreachable as error:
            reason = str(error)
        else:
            return T_b_f
    raise CalibrationRefused("the arm can't get square over the board", reason)


def _plan_lines(task: CalibrationPlan, arm: Arm, ready: Array) -> HandEyeUncertainty:
    """Plan lines one after the other, as the wizard would if each were as expected."""
    touched, outside = task.touch_points, task.T_b_board[:3, 3] + task.T_b_board[:3, 2]
    target = fit_plane(touched, task.noise.touch, outside, geometry=task.noise.geometry)
    board = BoardRectangle.through_touched_points(touched, target)
    measured = MeasurementsSoFar(datetime.now(UTC), {})
    expected = task.predict_from(task.T_f_s, target).uncertainty(np.empty((0, 4, 4)))
    for number in range(1, task.lines + 1):
        there = task.suggest_line_pose(
            measured, target, board, None, partial(reaches_and_returns, arm, ready)
        )
        shot = PosedProfile(f"line {number}", there.T_b_f, NOT_TAKEN)
        measured, expected = measured.with_entry(LaserLineTaken(shot, False)), there.after
    return expected
