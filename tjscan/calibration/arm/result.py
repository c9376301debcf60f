"""Result of calibrating an arm and the sensor on it together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.arm.estimate import (
    ArmEstimate,
    Mask,
    estimate_deviations,
    whitened_jacobian,
)
from tjscan.calibration.arm.model import ArmModel
from tjscan.calibration.arm.undetermined import UndeterminedDeviation, undetermined_deviations
from tjscan.calibration.fits.laser_error import estimate_by_laser
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays, readonly_copy
from tjscan.robot.settings import PlacementTolerance

MIN_PROFILES: Final = 20
"""Fewer say less than the maker does; forty are good."""

MIN_HELD_OUT: Final = 3
"""Fewer check nothing."""

MAX_SIGMA_SCALE: Final = 5.0
"""Residuals so much larger than stated are no matter of the arm's lengths and zeros."""


MAX_WORSE: Final = 1.3
"""Times that poses which took no part may be further off than before: of an arm that was as its
model has it, the RMS of twelve arcs differs by so much now and then."""


@dataclass(frozen=True, slots=True)
class CrossCheck:
    """Profiles that took no part, against what the arm predicts of them without and with.

    Parameters
    ----------
    count : int
        Profiles.
    before, after : float
        RMS distance of the target from where the arm's model has it, and the calibrated arm, in
        metres; of an arm as its model has it, the sensor's pose was found from the same profiles.
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
        All that was found.
    tolerance : PlacementTolerance
        What was known of the deviations before.
    undetermined : tuple of UndeterminedDeviation
        What is still known no better.
    cross_check : CrossCheck
        What profiles that took no part say.
    held_out : ndarray of bool, shape (n,)
        Which these are.
    """

    estimate: ArmEstimate
    tolerance: PlacementTolerance
    undetermined: tuple[UndeterminedDeviation, ...]
    cross_check: CrossCheck
    held_out: Mask

    @property
    def covariance(self) -> Array:
        """Of T_f_s and the deviations, shape (6 + 6 joints,) squared, widened where need be."""
        n = 6 + self.estimate.deviations.size
        return readonly_copy(self.estimate.sigma_scale**2 * self.estimate.covariance[:n, :n])

    @property
    def by_laser(self) -> Array | None:
        """By how much T_f_s and the deviations are off with draws of the laser's deviation.

        Shape (6 + 6 joints, m); none where nothing was stated of it.
        """
        estimate, stacked = self.estimate, self.estimate.stacked
        if stacked.by_laser is None:
            return None
        rows = estimate.used[stacked.profile]
        found = estimate_by_laser(
            estimate.covariance,
            stacked.jacobian[rows],
            stacked.covariance[np.ix_(rows, rows)],
            stacked.by_laser[rows],
        )
        return readonly_copy(found[: 6 + estimate.deviations.size])

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
        Profiles from 40 poses or more, the joints' postures as different as can be.
    held_out : ndarray of bool, shape (n,)
        Which of them take no part, and check the result.
    tolerance : PlacementTolerance
        What the maker leaves of deviations.
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
    if check.after > MAX_WORSE * check.before:
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


def list_undetermined(undetermined: Sequence[UndeterminedDeviation]) -> list[str]:
    """Sentences on what stays as the maker states it, a line for each joint and cause."""
    groups: dict[tuple[int, str], list[str]] = {}
    for one in undetermined:
        groups.setdefault((one.joint, one.like), []).append(one.kind)
    return [
        f"joint {joint}: {', '.join(kinds)} can't be told from {like}: left as the maker states"
        for (joint, like), kinds in groups.items()
    ]


def _off(estimate: ArmEstimate, held_out: Mask) -> float:
    """RMS distance of the target in held-out profiles, in metres."""
    stacked = estimate.stacked
    lengths = stacked.residuals[stacked.is_length & held_out[stacked.profile]]
    return float(np.sqrt(lengths @ lengths / held_out.sum()))
