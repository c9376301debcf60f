"""What makes the sections of a job's scan err, as far as the job or its calibration says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tjscan.job import CellJob
from tjscan.job.cell import SensorMount, kinematics_of_job, laser_model_of_job
from tjscan.job.uncertainty import ASSUMED, STATED
from tjscan.robot.deviations import deviation_jacobian, with_deviations
from tjscan.robot.tolerance import PlacementTolerance
from tjscan.scanning.section import ScannedSection
from tjscan.uncertainty.causes import (
    ViewCause,
    arm_geometry_cause,
    calibrated_arm_cause,
    hand_eye_cause,
    reading_cause,
    repeatability_cause,
)
from tjscan.uncertainty.laser_causes import linearity_cause, range_bias_cause

UNKNOWN_MOUNT = (
    "where the laser sits on the hand: the job states it without its uncertainty "
    "(sigma_position_mm and sigma_rotation_deg in [calibration], or a calibration's file)"
)
CALIBRATED = "calibrated"
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
    laser = job.laser.uncertainty
    repeats, of_repeats = job.arm.uncertainty.repeats
    causes = [
        reading_cause(sections),
        repeatability_cause(sections, repeats, of_repeats),
        *_causes_of_arm(job, mount, sections),
    ]
    left_out = [UNKNOWN_MOUNT] if mount.covariance is None else []
    linearity, of_linearity = laser.linear
    if linearity > 0:
        model = laser_model_of_job(job)
        causes.append(linearity_cause(sections, linearity, model, of_linearity))
    bias, of_bias = laser.bias
    if bias > 0:
        causes.append(range_bias_cause(sections, bias, of_bias))
    if job.joint is not None and not job.station:
        left_out.append(STATED_JOINT)
    return StatedCauses(tuple(causes), tuple(left_out))


def _causes_of_arm(
    job: CellJob, mount: SensorMount, sections: Sequence[ScannedSection]
) -> Iterator[ViewCause]:
    """Where the laser sits on the hand, and how the arm's geometry may be off."""
    absolute = job.arm.uncertainty.absolute
    arm_alone = mount.deviations is None
    if mount.covariance is not None and arm_alone:
        evidence = STATED if mount.file is None else CALIBRATED
        yield hand_eye_cause(sections, mount.T_f_s, mount.covariance, evidence)
    if arm_alone and absolute == 0:
        return
    kinematics = kinematics_of_job(job)
    if mount.deviations is not None:
        kinematics = with_deviations(kinematics, mount.deviations)
    by_deviations = np.array([deviation_jacobian(kinematics, s.view.q) for s in sections])
    if mount.deviations is not None and mount.covariance is not None:
        yield calibrated_arm_cause(
            sections, mount.T_f_s, by_deviations, mount.covariance, CALIBRATED
        )
    else:
        evidence = ASSUMED if absolute is None else STATED
        sigmas = PlacementTolerance().sigmas
        yield arm_geometry_cause(sections, by_deviations, sigmas, evidence, absolute)
