"""What makes the sections of a job's scan err, as far as the job or its calibration says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tjscan.job import CellJob
from tjscan.job.cell import SensorMount
from tjscan.robot.kinematics import Kinematics
from tjscan.scanning.section import ScannedSection
from tjscan.uncertainty.causes import (
    ViewCause,
    arm_geometry_cause,
    hand_eye_cause,
    reading_cause,
    repeatability_cause,
)
from tjscan.uncertainty.laser_causes import linearity_cause, range_bias_cause

UNKNOWN_MOUNT = (
    "where the laser sits on the hand: the job states it without its uncertainty "
    "(sigma_position_mm and sigma_rotation_deg in [calibration], or a calibration's file)"
)
STATED_JOINT = "where the joint stands: the job states it without its uncertainty"


@dataclass(frozen=True, slots=True, eq=False)
class StatedCauses:
    """Causes of error in the views of a scan, and what is left out of them.

    Parameters
    ----------
    causes : tuple of ViewCause
        The reading of the profiles first.
    left_out : tuple of str
        What may err too, by an amount that nobody states.
    """

    causes: tuple[ViewCause, ...]
    left_out: tuple[str, ...] = ()

    @property
    def shared(self) -> tuple[ViewCause, ...]:
        """Those that err alike in all views."""
        return tuple(cause for cause in self.causes if cause.is_shared)


def causes_of_job(
    job: CellJob, mount: SensorMount, sections: Sequence[ScannedSection]
) -> StatedCauses:
    """Causes of error in the views of a job's scan.

    Parameters
    ----------
    job : CellJob
        The job, of one station if it has any.
    mount : SensorMount
        Where the laser sits on the hand.
    sections : sequence of ScannedSection
        What was read in the views.

    Raises
    ------
    ConfigurationError
        If the arm's model is unknown.
    """
    arm, laser = job.arm.uncertainty, job.laser.uncertainty
    repeats, of_repeats = arm.repeats
    absolute, of_geometry = arm.geometry
    causes = [reading_cause(sections), repeatability_cause(sections, repeats, of_repeats)]
    left_out = []
    if mount.covariance is None:
        left_out.append(UNKNOWN_MOUNT)
    else:
        evidence = "stated" if mount.file is None else "calibrated"
        causes.append(hand_eye_cause(sections, mount.T_f_s, mount.covariance, evidence))
    if absolute > 0:
        kinematics = Kinematics.load(job.arm.model)
        T_b_joints = np.array([kinematics.joint_poses(section.view.q) for section in sections])
        causes.append(arm_geometry_cause(sections, T_b_joints, absolute, of_geometry))
    linearity, of_linearity = laser.linear
    if linearity > 0:
        window = (job.laser.near, job.laser.far)
        causes.append(linearity_cause(sections, linearity, window, of_linearity))
    bias, of_bias = laser.bias
    if bias > 0:
        causes.append(range_bias_cause(sections, bias, of_bias))
    if job.joint is not None and not job.station:
        left_out.append(STATED_JOINT)
    return StatedCauses(tuple(causes), tuple(left_out))
