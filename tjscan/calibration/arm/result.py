"""Result of calibrating an arm and the sensor on it together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.arm.estimate import (
    ArmEstimate,
    estimate_deviations,
    undetermined_deviations,
    whitened_jacobian,
    without_each_profile,
)
from tjscan.calibration.arm.model import ArmModel
from tjscan.calibration.entries import ArmKinematicsEntry
from tjscan.calibration.result import HandEyeCalibration, SampleResidual
from tjscan.calibration.solve.refine import Mask, estimate_by_laser
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays, readonly_copy
from tjscan.robot.settings import PlacementTolerance

ARM_METHOD: Final = "ball, with the arm's kinematics"
"""`HandEyeCalibration.method` of a calibration of the arm."""

MIN_PROFILES: Final = 20
"""Fewer determine less than the maker states; forty are good."""

MIN_HELD_OUT: Final = 3
"""Fewer check nothing."""

MAX_SIGMA_SCALE: Final = 5.0
"""Residuals so much larger than stated are not caused by the arm's lengths and zeros."""

MAX_WORSENING_RATIO: Final = 1.3
"""Times that poses which took no part may be further off than before: of an arm without deviations,
the RMS of twelve arcs differs by so much now and then."""


@dataclass(frozen=True, slots=True)
class CrossCheck:
    """Error of the arm's prediction of profiles that took no part, without and with deviations.

    Parameters
    ----------
    count : int
        Profiles.
    before, after : float
        RMS distance of the target from its place by the arm's model, and by the calibrated arm,
        in metres; without deviations, the sensor's pose was found from the same profiles.
    """

    count: int
    before: float
    after: float


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class ArmCalibration:
    """An arm's deviations and the sensor's pose on its flange, found together.

    Parameters
    ----------
    estimate : ArmEstimate
        Deviations, sensor and targets.
    tolerance : PlacementTolerance
        Of the deviations, as known before.
    undetermined : tuple of str
        Sentences on deviations that are known no better than before.
    cross_check : CrossCheck
        With the profiles that took no part.
    held_out : ndarray of bool, shape (n,)
        The profiles that took no part.
    """

    estimate: ArmEstimate
    tolerance: PlacementTolerance
    undetermined: tuple[str, ...]
    cross_check: CrossCheck
    held_out: Mask

    @property
    def covariance(self) -> Array:
        """Of T_f_s and the deviations, shape (6 + 6 joints,) squared, widened by `sigma_scale`."""
        n = 6 + self.estimate.deviations.size
        return readonly_copy(self.estimate.sigma_scale**2 * self.estimate.covariance[:n, :n])

    @property
    def by_laser(self) -> Array | None:
        """By how much T_f_s and the deviations are off with draws of the laser's deviation.

        Shape (6 + 6 joints, m); None if no deviation is stated.
        """
        estimate = self.estimate
        found = estimate_by_laser(estimate)
        return None if found is None else readonly_copy(found[: 6 + estimate.deviations.size])

    def lines(self, checks: str, target: str) -> list[str]:
        """Sentences on the check with held-out `checks`, and on undetermined deviations."""
        check = self.cross_check
        return [
            f"{check.count} {checks} that took no part: the {target} {1e3 * check.before:.3f} mm "
            f"off (RMS) as the arm's model has it, {1e3 * check.after:.3f} mm with what was found",
            *self.undetermined,
        ]

    @property
    def T_f_s(self) -> Array:
        """The sensor on the flange, shape (4, 4)."""
        return self.estimate.T_f_s

    @property
    def deviations(self) -> Array:
        """Of the joints, shape (joints, 6), metres and radians; see `with_deviations`."""
        return self.estimate.deviations


def calibrate_arm(
    model: ArmModel, held_out: Mask, tolerance: PlacementTolerance, T_f_s: Array
) -> ArmCalibration:
    """Calibrate an arm's deviations and the sensor on it, and check them with other profiles.

    Parameters
    ----------
    model : ArmModel
        Profiles from 40 poses or more, of postures as different as possible.
    held_out : ndarray of bool, shape (n,)
        Which of them take no part, and check the result.
    tolerance : PlacementTolerance
        Deviations that the maker leaves.
    T_f_s : ndarray, shape (4, 4)
        About how the sensor sits.

    Raises
    ------
    CalibrationRefused
        If there are too few profiles, if residuals stay larger than the stated noise explains, or
        if the profiles that took no part fit worse than before.
    """
    count, checking = int((~held_out).sum()), int(held_out.sum())
    if count < MIN_PROFILES or checking < MIN_HELD_OUT:
        raise CalibrationRefused(
            "too few poses",
            f"{count} show the target, and {checking} to check with; at least {MIN_PROFILES} and "
            f"{MIN_HELD_OUT} are needed, and forty are good; take more, each in another posture "
            "of the arm",
        )
    prior = np.tile(tolerance.sigmas, (model.joints, 1))
    plain = estimate_deviations(model, np.zeros_like(prior), T_f_s, held_out)
    found = estimate_deviations(model, prior, plain.T_f_s, held_out)
    if found.sigma_scale > MAX_SIGMA_SCALE:
        raise CalibrationRefused(
            "residuals that no arm explains",
            f"they are {found.sigma_scale:.1f} times larger than stated noise allows, with "
            "deviations of the joints as the maker leaves them; see that target and sensor sit "
            "tight, that each profile belongs to its joint angles, and that the arm is of the "
            "model stated",
        )
    check = CrossCheck(checking, _off(plain, held_out), _off(found, held_out))
    if check.after > MAX_WORSENING_RATIO * check.before:
        raise CalibrationRefused(
            "poses that took no part fit worse",
            f"the target is {1e3 * check.before:.3f} mm RMS off as the arm's model has it, and "
            f"{1e3 * check.after:.3f} mm with the deviations found; take more poses, in other "
            "postures",
        )
    return ArmCalibration(
        found,
        tolerance,
        undetermined_deviations(whitened_jacobian(found, prior), model.joints),
        check,
        held_out.copy(),
    )


def _off(estimate: ArmEstimate, held_out: Mask) -> float:
    """RMS distance of the target in held-out profiles, in metres."""
    stacked = estimate.stacked
    lengths = stacked.residuals[stacked.is_length & held_out[stacked.profile]]
    return float(np.sqrt(lengths @ lengths / held_out.sum()))


def as_hand_eye_calibration(
    found: ArmCalibration, names: Sequence[str], arm_model: str
) -> HandEyeCalibration:
    """The result of a calibration of the arm on a ball.

    Parameters
    ----------
    found : ArmCalibration
        The arm and the sensor.
    names : sequence of str
        Of all profiles, those held out as well.
    arm_model : str
        Name of the arm's kinematics.
    """
    estimate, check = found.estimate, found.cross_check
    kinematics = ArmKinematicsEntry.from_si(
        arm_model,
        found.deviations,
        found.covariance,
        found.undetermined,
        (check.count, check.before, check.after),
    )
    return HandEyeCalibration(
        found.T_f_s,
        found.covariance,
        ARM_METHOD,
        _residuals(found, names),
        _condition(found.covariance[:6, :6]),
        estimate.chi2,
        estimate.dof,
        estimate.sigma_scale,
        centre_b=estimate.target[:3],
        radius=float(estimate.target[3]),
        by_laser=found.by_laser,
        kinematics=kinematics,
    )


def _residuals(found: ArmCalibration, names: Sequence[str]) -> tuple[SampleResidual, ...]:
    estimate, stacked = found.estimate, found.estimate.stacked
    falls, steps = without_each_profile(estimate)
    residuals = []
    for i, name in enumerate(names):
        if found.held_out[i]:
            continue
        own = stacked.profile == i
        lengths = stacked.residuals[own & stacked.is_length]
        off, misfit = float(np.linalg.norm(lengths)), np.sqrt(falls[i] / own.sum())
        used = estimate.used[i]
        residuals.append(SampleResidual.from_changes(name, used, (off, None), misfit, steps[i]))
    return tuple(residuals)


def _condition(covariance: Array) -> float:
    """Of the sensor's pose, each number of it in units of its own certainty."""
    sigma = np.sqrt(np.diag(covariance))
    return float(np.sqrt(np.linalg.cond(covariance / np.outer(sigma, sigma))))
