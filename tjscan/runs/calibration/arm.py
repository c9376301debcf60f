"""The arm's part of a calibration: from its job to the plan, the wizard and a simulated ball."""

from __future__ import annotations

from typing import Final

import numpy as np
import trimesh

from tjscan.calibration.arm.design import BallPlan, plan_views
from tjscan.calibration.arm.kept import as_hand_eye_calibration, kinematics_entry
from tjscan.calibration.arm.wizard import ArmWizard
from tjscan.calibration.file import CalibrationFile, to_calibration_file
from tjscan.calibration.measuring_range import MeasuringRange
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.wizard.logbook import Logbook
from tjscan.calibration.wizard.operator import Operator
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.job import CalibrationJob
from tjscan.job.arm import kinematics_of_job
from tjscan.job.cell import Cell
from tjscan.laser.deviation import LaserDeviation
from tjscan.runs.calibration.basis import basis_of_postures

BALL_SUBDIVISIONS: Final = 6
"""Of an icosahedron: its faces are then within 2 µm of a ball of 40 mm."""


def calibrate_arm_in_cell(
    job: CalibrationJob,
    cell: Cell,
    operator: Operator,
    logbook: Logbook,
    T_f_s: Array,
    window: MeasuringRange,
    laser: LaserDeviation | None,
) -> tuple[HandEyeCalibration, CalibrationFile]:
    """Look at the ball of a job from many postures, and calibrate arm and sensor together.

    Parameters
    ----------
    job : CalibrationJob
        With a [ball].
    cell : Cell
        Connected.
    operator : Operator
        Is asked before every move.
    logbook : Logbook
        Gets every profile.
    T_f_s : ndarray, shape (4, 4)
        How the sensor sits, as lines on the board have it.
    window : MeasuringRange
        What the sensor sees.
    laser : LaserDeviation or None
        By what it may deviate.

    Raises
    ------
    TjscanError
        As `ArmWizard.run` does.
    """
    ball = job.ball
    if ball is None:
        raise ConfigurationError("--arm looks at a ball: the job needs a table [ball]", key="ball")
    kinematics = kinematics_of_job(job)
    plan = BallPlan(
        np.array(ball.position),
        ball.radius,
        T_f_s,
        window,
        ball.noise,
        ball.tolerance,
        ball.poses,
        ball.held_out,
        laser,
    )
    views = plan_views(plan, kinematics)
    wizard = ArmWizard(
        plan, views, kinematics, cell.arm, cell.laser, operator, logbook, cell.arm.state().q
    )
    found, arcs = wizard.run()
    result = as_hand_eye_calibration(found, [arc.name for arc in arcs])
    return result, to_calibration_file(
        result,
        ball.noise,
        arm=job.arm.device_id,
        laser=job.laser.device_id,
        date=logbook.measured.started_at,
        kinematics=kinematics_entry(found, kinematics.name),
        linearity=0.0 if laser is None else laser.largest,
        basis=basis_of_postures(logbook.measured, result, 1e3 * ball.radius),
    )


def ball_mesh(centre_b: Array, radius: float) -> trimesh.Trimesh:
    """A ball that a simulated laser can look at, frame b, metres."""
    ball = trimesh.creation.icosphere(subdivisions=BALL_SUBDIVISIONS, radius=radius)
    ball.apply_translation(centre_b)
    return ball
