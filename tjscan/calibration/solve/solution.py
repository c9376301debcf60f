"""Several targets of one sensor solved together, from many starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.arm_error import geometry_correlation
from tjscan.calibration.models.combined import CombinedModel
from tjscan.calibration.models.fixed_sensor import FixedSensorModel, inverse_pose_errors
from tjscan.calibration.models.linearised import TargetModel
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.solve.refine import (
    ROUGH_EVALUATIONS,
    RefinedEstimate,
    refine_by_least_squares,
    settle_targets,
)
from tjscan.calibration.solve.seen import SeenBall, SeenBoard, SeenRoof, SeenTarget, TargetStart
from tjscan.calibration.solve.snooping import reject_outlying_profiles
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose

MIN_LINES: Final = 5
"""Eq. (20) needs five lines in general position."""
CONFIRMED: Final = 2
"""Starts that lead to the same best place before no more are tried."""
SAME_CHI2: Final = 0.01
"""Sums of squares nearer than this belong to the same place."""

AnySeen = SeenBoard | SeenBall | SeenRoof
"""Any kind of target."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Estimate of one sensor and several targets.

    Parameters
    ----------
    whole : RefinedEstimate
        With all profiles in use.
    estimate : RefinedEstimate
        Without those that contradict the others.
    settled : RefinedEstimate
        The same, the targets where the arm sees them; see `settle_targets`.
    models : tuple of TargetModel
        Of each target.
    """

    whole: RefinedEstimate
    estimate: RefinedEstimate
    settled: RefinedEstimate
    models: tuple[TargetModel, ...]

    def part(self, k: int) -> slice:
        """Where the parameters of target k stand behind the six of the sensor."""
        return part_of(self.models, k)


def part_of(models: Sequence[TargetModel], k: int) -> slice:
    """Where the parameters of model k stand behind the six of the sensor."""
    ends = np.cumsum([0] + [len(model.prior_information) for model in models])
    return slice(int(ends[k]), int(ends[k + 1]))


def stack_poses(targets: Sequence[SeenTarget]) -> Array:
    """Flange poses of all profiles, shape (n, 4, 4).

    Parameters
    ----------
    targets : sequence of SeenTarget
        The targets.

    Raises
    ------
    CalibrationRefused
        If there are too few.
    """
    count = sum(len(one.names) for one in targets)
    if count < MIN_LINES:
        raise CalibrationRefused(
            "too few lines",
            f"{count} were taken, at least {MIN_LINES} are needed and twelve are good; take "
            "more, each with another tilt of the sensor",
        )
    return np.concatenate([one.T_b_f for one in targets if one.names])


def with_poses(targets: Sequence[AnySeen], T_b_f: Array) -> list[AnySeen]:
    """The same profiles from other flange poses.

    Parameters
    ----------
    targets : sequence of SeenBoard, SeenBall or SeenRoof
        The profiles.
    T_b_f : ndarray, shape (n, 4, 4)
        Of all of them.
    """
    ends = np.cumsum([len(one.names) for one in targets])[:-1]
    return [one.with_poses(part) for one, part in zip(targets, np.split(T_b_f, ends), strict=True)]


def solve_targets(
    targets: Sequence[SeenTarget],
    noise: NoiseModel,
    begin: Sequence[Array],
    sensor_is_fixed: bool,
    most: int | None = None,
) -> Solution:
    """Solve for one sensor and all targets, without the profiles that contradict the others.

    Parameters
    ----------
    targets : sequence of SeenTarget
        Poses are those of the inverse where the sensor is fixed.
    noise : NoiseModel
        What they err by.
    begin : sequence of ndarray, shape (4, 4)
        Where the sensor may sit.
    sensor_is_fixed : bool
        Whether it stands fixed in the room.
    most : int, optional
        Starts to refine at most, and only roughly: to compare, not to keep.
    """
    combined, models, whole = fit_targets(targets, noise, begin, sensor_is_fixed, most)
    final = reject_outlying_profiles(combined, whole, noise.geometry)
    return Solution(whole, final, settle_targets(combined, final), models)


def fit_targets(
    targets: Sequence[SeenTarget],
    noise: NoiseModel,
    begin: Sequence[Array],
    sensor_is_fixed: bool,
    most: int | None = None,
) -> tuple[CombinedModel, tuple[TargetModel, ...], RefinedEstimate]:
    """The best fit with all profiles in use; see `solve_targets`."""
    T_b_f = stack_poses(targets)
    true_poses = np.stack([inverse_pose(T) for T in T_b_f]) if sensor_is_fixed else T_b_f
    correlation = geometry_correlation(true_poses)
    errors = None
    if sensor_is_fixed:
        ends = np.cumsum([len(one.names) for one in targets])[:-1]
        errors = np.split(inverse_pose_errors(true_poses), ends)
    starts = []
    for T_f_s in begin:
        begun = [one.start_at(T_f_s) for one in targets]
        models: list[TargetModel] = [start.model for start in begun]
        if errors is not None:
            models = [FixedSensorModel(m, e) for m, e in zip(models, errors, strict=True)]
        combined = CombinedModel(tuple(models), correlation, noise.geometry)
        target = np.concatenate([start.target for start in begun])
        starts.append((combined.misfit(T_f_s, target), T_f_s, target, begun, combined))
    starts.sort(key=lambda start: start[0])
    every = np.ones(len(T_b_f), dtype=bool)
    found: list[tuple[bool, float, CombinedModel, list[TargetStart], RefinedEstimate]] = []
    for _, T_f_s, target, begun, combined in starts[:most]:
        estimate = refine_by_least_squares(
            combined, T_f_s, target, every, rounds=1, evaluations=ROUGH_EVALUATIONS
        )
        plain = [start.model for start in begun]
        behind = not sensor_is_fixed and any(
            one.is_behind(start, estimate.T_f_s, estimate.target[part_of(plain, k)])
            for k, (one, start) in enumerate(zip(targets, begun, strict=True))
        )
        found.append((behind, estimate.chi2, combined, begun, estimate))
        lowest = min(found, key=lambda one: one[:2])
        same = [one[0] == lowest[0] and one[1] < lowest[1] + SAME_CHI2 for one in found]
        if sum(same) == CONFIRMED:
            break
    _, _, combined, begun, estimate = min(found, key=lambda one: one[:2])
    if most is None:
        estimate = refine_by_least_squares(combined, estimate.T_f_s, estimate.target, every)
    return combined, tuple(start.model for start in begun), estimate
