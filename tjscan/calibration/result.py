"""The result of a hand-eye calibration: pose, covariance, residuals, and warnings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.closed_form import ClosedFormSolution
from tjscan.calibration.file import ArmKinematicsEntry
from tjscan.calibration.targets.plane import PlaneTarget
from tjscan.calibration.targets.roof import RoofTarget
from tjscan.core.frames import Array, array_dataclass

WANTED_SIGMA_POSITION: Final = 0.5e-3
WANTED_SIGMA_ROTATION: Final = float(np.radians(0.1))
"""Metres and radians RMS; what a weld groove is to be measured to."""
MAX_RADIUS_SIGMA: Final = 0.15e-3
"""Metres; a radius measured with less certainty does not check the one that is stated."""


@array_dataclass
class HandEyeUncertainty:
    """Expected error of T_f_s, in position and rotation.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
        Of translation (metres) and small rotation (radians), both in the axes of f.
    """

    covariance: Array

    @property
    def position(self) -> float:
        """RMS length of the translation error, in metres."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3])))

    @property
    def rotation(self) -> float:
        """RMS angle of the rotation error, in radians."""
        return float(np.sqrt(np.trace(self.covariance[3:, 3:])))


@dataclass(frozen=True, slots=True)
class MeasuredRadius:
    """A ball's radius as the arcs show it, apart from the stated one. Metres.

    Parameters
    ----------
    radius : float
        By the arcs.
    sigma : float
        Its standard deviation.
    stated : float or None
        As stated; None if it was not.
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
        of the one further off; of an arc, the distance of the ball's centre from its expected
        place, in the laser plane.
    tilt : float or None
        Angle of the line out of the plane, in radians; none for an arc.
    misfit : float
        Both together, over the errors that the noise model states, in standard deviations
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

    @classmethod
    def from_changes(
        cls, name: str, used: bool, off: tuple[float, float | None], misfit: float, step: Array
    ) -> SampleResidual:
        """Make it from offset and tilt, and how T_f_s would move without it, shape (6,)."""
        shift, turn = (float(np.linalg.norm(half)) for half in (step[:3], step[3:]))
        return cls(name, bool(used), *off, float(misfit), shift, turn)


@array_dataclass
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
        The targets: ``plane touched``, ``plane unknown``, ``sphere of known radius``,
        ``sphere of unknown radius`` or ``roof edge``; several joined by `` and ``.
    residuals : tuple of SampleResidual
        One per sample, in their order.
    condition : float
        Of eq. (21), first over fifth singular value; for other targets than one plane, of the
        scaled normal equations.
    chi2, dof : float, int
        Weighted sum of squared residuals, and its expectation under the noise model.
    sigma_scale : float
        By how much residuals are larger than stated, if that is significant; else one.
    board : PlaneTarget or None
        The board as estimated, frame b; None without one.
    centre_b : ndarray, shape (3,), or None
        The ball's centre; None without one.
    radius : float or None
        The ball's estimated radius; None without a ball.
    roof : RoofTarget or None
        The roof edge as estimated; None without one.
    measured_radius : MeasuredRadius or None
        The ball's radius by the arcs alone; None without a ball.
    geometry : float
        Standard deviation of the arm's geometry error that it allows for, metres.
    sensor_is_fixed : bool
        Whether the sensor is fixed in the room and the arm carries the target: then `T_f_s` is
        T_b_s, and f takes the place of b above.
    closed_form : ClosedFormSolution or None
        Solution of eq. (20)-(25), with all lines; of a touched plane alone.
    notes : tuple of str
        Findings of the checks that are no reason to refuse.
    by_laser : ndarray, shape (6 + m, draws), or None
        By how much `T_f_s` and the other numbers of `joint_covariance`, which holds it, are off
        with draws of the laser's deviation; None if no deviation is stated.
    kinematics : ArmKinematicsEntry or None
        Deviations of the arm that were found with it.
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
    kinematics: ArmKinematicsEntry | None = None

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
        found = []
        if self.rejected_sample_names:
            found.append(
                f"left out as contradicting the others: {', '.join(self.rejected_sample_names)}"
            )
        found.extend(self.notes)
        if self.geometry > 0:
            found.append(
                f"residuals of poses that are alike are alike, as where an arm's geometry is "
                f"{1e3 * self.geometry:.2f} mm off; the uncertainty allows for that"
            )
        ball = self.measured_radius
        if ball and ball.stated and ball.sigma > MAX_RADIUS_SIGMA:
            found.append(
                f"the arcs show the ball's radius to {1e3 * ball.sigma:.2f} mm only, too "
                "little to check the stated one; take arcs on both sides of its middle"
            )
        if self.sigma_scale > 1:
            found.append(
                f"residuals are {self.sigma_scale:.1f} times larger than stated; the uncertainty "
                "has been widened by as much"
            )
        sure = self.uncertainty
        unsure = sure.position > WANTED_SIGMA_POSITION or sure.rotation > WANTED_SIGMA_ROTATION
        if unsure and not (self.sensor_is_fixed and self.kinematics):  # points have no sensor
            found.append(
                f"the sensor's place is certain to {1e3 * sure.position:.2f} mm and "
                f"{np.degrees(sure.rotation):.2f}° only; add lines that are tilted further"
            )
        return tuple(found)
