"""What makes the sections of a job's scan err, as far as the job or its calibration states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isclose

import numpy as np

from tjscan.core.frames import Array
from tjscan.job.cell import SensorMount, kinematics_of_job
from tjscan.job.devices import EVIDENCE_ASSUMED, EVIDENCE_STATED
from tjscan.job.files import CellJob
from tjscan.robot.deviations import deviate_joint_frames, deviation_jacobian
from tjscan.robot.settings import PlacementTolerance
from tjscan.scanning.section import ScannedSection, Substep
from tjscan.uncertainty import causes as view_causes

UNKNOWN_MOUNT_TEXT = (
    "where the laser sits on the hand: the job states it without its uncertainty "
    "(sigma_position_mm and sigma_rotation_deg in [calibration], or a calibration's file)"
)
CALIBRATED_EVIDENCE = "calibrated"
UNKNOWN_JOINT_POSE_TEXT = "where the joint is: the job states it without its uncertainty"


@dataclass(frozen=True, slots=True, eq=False)
class ViewErrorCauses:
    """Causes of error in the views of a scan, and what is left out of them.

    Parameters
    ----------
    causes : tuple of ViewCause
        The reading of the profiles first.
    left_out : tuple of str
        What may err too, by an amount that is not stated.
    """

    causes: tuple[view_causes.ViewCause, ...]
    left_out: tuple[str, ...] = ()

    @property
    def shared(self) -> tuple[view_causes.ViewCause, ...]:
        """Those that err alike in all views."""
        return tuple(cause for cause in self.causes if cause.is_shared)


def causes_of_job(
    job: CellJob, mount: SensorMount, sections: Sequence[ScannedSection]
) -> ViewErrorCauses:
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
    repeats, of_repeats = job.arm.uncertainty.stated_repeatability
    linearity, of_linearity = laser.stated_linearity
    # The calibration answered to the same deviation of the same laser as the scan does.
    is_same = mount.by_laser is not None and isclose(linearity, mount.linearity)
    kinematics = kinematics_of_job(job)
    if mount.deviations is not None:
        kinematics = deviate_joint_frames(kinematics, mount.deviations)
    moved = np.array([deviation_jacobian(kinematics, one.view.q) for one in sections])
    absolute = job.arm.uncertainty.absolute
    found = [
        view_causes.reading_cause(sections),
        view_causes.repeatability_cause(sections, repeats, of_repeats),
        *_causes_of_arm(mount, sections, moved, absolute, without_laser=is_same),
    ]
    if any(one.view.substep is Substep.FUSED for one in sections):
        found.append(view_causes.clock_cause(sections))
    if any(one.view.sway is not None for one in sections):
        found.append(view_causes.sway_cause(sections))
    left_out = [UNKNOWN_MOUNT_TEXT] if mount.covariance is None else []
    if linearity > 0:
        cause = view_causes.linearity_cause(sections, linearity, job.laser_model, of_linearity)
        if is_same and mount.by_laser is not None:
            calibrated = None if mount.deviations is None else moved
            twists = view_causes.calibration_twists(
                sections, mount.T_f_s, calibrated, mount.by_laser
            )
            cause = cause.with_motions(sections, twists)
        found.append(cause)
    bias, of_bias = laser.stated_bias
    if bias > 0:
        found.append(view_causes.range_bias_cause(sections, bias, of_bias))
    if job.joint is not None and not job.station:
        left_out.append(UNKNOWN_JOINT_POSE_TEXT)
    return ViewErrorCauses(tuple(found), tuple(left_out))


def _causes_of_arm(
    mount: SensorMount,
    sections: Sequence[ScannedSection],
    moved: Array,
    absolute: float | None,
    *,
    without_laser: bool,
) -> Iterator[view_causes.ViewCause]:
    """Where the laser sits on the hand, and how the arm's geometry may be off.

    Parameters
    ----------
    moved : ndarray, shape (n, 6, k, 6)
        How the flange moves in each view with deviations of the joints.
    """
    covariance = mount.covariance
    if covariance is not None and without_laser and mount.by_laser is not None:
        covariance = covariance - mount.by_laser @ mount.by_laser.T
    calibrated = None if mount.deviations is None else moved
    if covariance is not None:
        evidence = EVIDENCE_STATED if mount.file is None else CALIBRATED_EVIDENCE
        yield view_causes.hand_eye_cause(sections, mount.T_f_s, covariance, evidence, calibrated)
        if calibrated is not None:
            return
    if absolute != 0:
        evidence = EVIDENCE_ASSUMED if absolute is None else EVIDENCE_STATED
        sigmas = PlacementTolerance().sigmas
        yield view_causes.arm_geometry_cause(sections, moved, sigmas, evidence, absolute)
