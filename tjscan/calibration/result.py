"""The result of a hand-eye calibration: pose, covariance, residuals, and what to be wary of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.solve.closed_form import ClosedFormSolution
from tjscan.calibration.solve.design import HandEyeUncertainty
from tjscan.calibration.targets import PlaneTarget, RoofTarget
from tjscan.core.frames import Array, frozen_arrays

TARGET_SIGMA_POSITION: Final = 0.5e-3
TARGET_SIGMA_ROTATION: Final = float(np.radians(0.1))
"""Metres and radians RMS; what a weld groove is to be measured to."""
MAX_RADIUS_SIGMA: Final = 0.15e-3
"""Metres; a radius measured with less certainty does not check the one that is stated."""


@dataclass(frozen=True, slots=True)
class MeasuredRadius:
    """A ball's radius as the arcs show it, whatever was stated. Metres.

    Parameters
    ----------
    radius : float
        As measured.
    sigma : float
        Its standard deviation.
    stated : float or None
        What was stated, if anything.
    """

    radius: float
    sigma: float
    stated: float | None


@dataclass(frozen=True, slots=True)
class SampleResidual:
    """How far one line is off the result, and how much the result would change without it.

    Parameters
    ----------
    name : str
        Of the sample.
    used : bool
        False for a bad pose: the result does without it.
    offset : float
        Distance of the line's centroid from the plane, in metres; of a roof's two lines, that
        of the one further off; of an arc, the distance of the ball's centre from where it
        should be, in the laser plane.
    tilt : float or None
        Angle of the line out of the plane, in radians; none for an arc.
    misfit : float
        Both together, against what the noise model lets one expect, in standard deviations
        (RMS per residual); about one for a good line.
    shift : float
        Metres by which the sensor's position would move without this line.
    turn : float
        Radians by which its rotation would.
    """

    name: str
    used: bool
    offset: float
    tilt: float | None
    misfit: float
    shift: float
    turn: float


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class HandEyeCalibration:
    """Result of a calibration: the sensor's pose on the flange, its covariance and residuals.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange.
    joint_covariance : ndarray, shape (6 + m, 6 + m)
        Of its translation (metres), a small rotation on top of it (radians), both in the axes of
        f, and the target's parameters; widened by `sigma_scale` squared.
    method : str
        What it rests on: ``plane touched``, ``plane unknown``, ``sphere of known radius``,
        ``sphere of unknown radius`` or ``roof edge``; several joined by `` and ``.
    residuals : tuple of SampleResidual
        One per sample, in their order.
    condition : float
        Of eq. (21), first over fifth singular value; for other targets than one plane, of the
        scaled normal equations.
    chi2, dof : float, int
        Weighted sum of squares that is left, and its expectation under the noise model.
    sigma_scale : float
        By how much residuals are larger than stated, where that is significant; else one.
    board : PlaneTarget or None
        The board, frame b, as it came out; none without one.
    centre_b : ndarray, shape (3,), or None
        The ball's centre; none without one.
    radius : float or None
        The ball's radius that it was found with; none without a ball.
    roof : RoofTarget or None
        The roof edge as it came out; none without one.
    measured_radius : MeasuredRadius or None
        What the arcs say of the ball's radius; none without a ball.
    geometry : float
        Standard deviation of the arm's geometry error that it allows for, metres.
    sensor_is_fixed : bool
        Whether the sensor stands fixed in the room and the arm carries the target: then
        `T_f_s` is T_b_s, and what stands in frame b above stands in f.
    closed_form : ClosedFormSolution or None
        What eq. (20)-(25) gave, with all lines; none but for a touched plane alone.
    notes : tuple of str
        What the checks found that is no reason to refuse.
    by_laser : ndarray, shape (6 + m, draws), or None
        By how much `T_f_s` and the other numbers of `joint_covariance`, which holds it, are off
        with draws of the laser's deviation; none where nothing was stated of that.
    """

    T_f_s: Array
    joint_covariance: Array
    method: str
    residuals: tuple[SampleResidual, ...]
    condition: float
    chi2: float
    dof: int
    sigma_scale: float
    board: PlaneTarget | None = None
    centre_b: Array | None = None
    radius: float | None = None
    roof: RoofTarget | None = None
    measured_radius: MeasuredRadius | None = None
    geometry: float = 0.0
    sensor_is_fixed: bool = False
    closed_form: ClosedFormSolution | None = None
    notes: tuple[str, ...] = ()
    by_laser: Array | None = None

    @property
    def covariance(self) -> Array:
        """Covariance of T_f_s, shape (6, 6): translation and small rotation in the axes of f."""
        return self.joint_covariance[:6, :6]

    @property
    def uncertainty(self) -> HandEyeUncertainty:
        """How far T_f_s is expected to be off, position and rotation."""
        return HandEyeUncertainty(self.covariance)

    @property
    def rejected_sample_names(self) -> tuple[str, ...]:
        """Names of the samples that contradict the others; the result does without them."""
        return tuple(r.name for r in self.residuals if not r.used)

    @property
    def caveats(self) -> tuple[str, ...]:
        """Warnings to a user before relying on the calibration; empty for a good one."""
        said = []
        if self.rejected_sample_names:
            said.append(
                f"left out as contradicting the others: {', '.join(self.rejected_sample_names)}"
            )
        said.extend(self.notes)
        if self.geometry > 0:
            said.append(
                f"residuals of poses that are alike are alike, as where an arm's geometry is "
                f"{1e3 * self.geometry:.2f} mm off; the uncertainty allows for that"
            )
        measured = self.measured_radius
        if measured and measured.stated and measured.sigma > MAX_RADIUS_SIGMA:
            said.append(
                f"the arcs show the ball's radius to {1e3 * measured.sigma:.2f} mm only, too "
                "little to check the stated one; take arcs on both sides of its middle"
            )
        if self.sigma_scale > 1:
            said.append(
                f"residuals are {self.sigma_scale:.1f} times larger than stated; the uncertainty "
                "has been widened by as much"
            )
        sure = self.uncertainty
        if sure.position > TARGET_SIGMA_POSITION or sure.rotation > TARGET_SIGMA_ROTATION:
            said.append(
                f"the sensor's place is certain to {1e3 * sure.position:.2f} mm and "
                f"{np.degrees(sure.rotation):.2f}° only; add lines that are tilted further"
            )
        return tuple(said)
