"""Several targets of one sensor solved together, from many starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tjscan.calibration.arm_error import geometry_correlation
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.solve.combined import CombinedModel
from tjscan.calibration.solve.refine import (
    RefinedEstimate,
    refine_by_least_squares,
    settle_targets,
)
from tjscan.calibration.solve.snooping import reject_outlying_profiles
from tjscan.calibration.targets.fixed_sensor import inverse_pose_errors, inverse_poses
from tjscan.calibration.targets.target import SeenTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array

MIN_LINES: Final = 5
"""Eq. (20) needs five lines in general position."""
CONFIRMING_STARTS: Final = 2
"""Starts that lead to the same best place before no more are tried."""
SAME_PLACE_CHI2: Final = 0.01
"""Sums of squares nearer than this belong to the same place."""

Targets = Sequence[SeenTarget[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Estimate of one sensor and several targets.

    Parameters
    ----------
    whole : RefinedEstimate
        With all profiles in use.
    estimate : RefinedEstimate
        Without the profiles that contradict the others.
    settled : RefinedEstimate
        The same, the targets where the arm sees them; see `settle_targets`.
    model : CombinedModel
        Of all targets.
    """

    whole: RefinedEstimate
    estimate: RefinedEstimate
    settled: RefinedEstimate
    model: CombinedModel


def stack_poses(targets: Targets) -> Array:
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


def with_poses(targets: Targets, T_b_f: Array) -> list[SeenTarget[Any]]:
    """The same profiles from other flange poses.

    Parameters
    ----------
    targets : sequence of SeenTarget
        The profiles.
    T_b_f : ndarray, shape (n, 4, 4)
        Of all of them.
    """
    ends = np.cumsum([len(one.names) for one in targets])[:-1]
    return [one.with_poses(part) for one, part in zip(targets, np.split(T_b_f, ends), strict=True)]


def solve_targets(
    targets: Targets,
    noise: NoiseModel,
    begin: Sequence[Array],
    sensor_is_fixed: bool,
) -> Solution:
    """Solve for one sensor and all targets, without the profiles that contradict the others.

    Parameters
    ----------
    targets : sequence of SeenTarget
        Poses are inverted if the sensor is fixed.
    noise : NoiseModel
        Errors of profiles and poses.
    begin : sequence of ndarray, shape (4, 4)
        Possible poses of the sensor.
    sensor_is_fixed : bool
        Whether it is fixed in the room.
    """
    model, whole = fit_targets(targets, noise, begin, sensor_is_fixed)
    final = reject_outlying_profiles(model, whole, noise.geometry)
    return Solution(whole, final, settle_targets(model, final), model)


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """Pose of the sensor, the targets' model and parameters to begin with, and their misfit."""

    T_f_s: Array
    model: CombinedModel
    target: Array
    misfit: float


def fit_targets(
    targets: Targets,
    noise: NoiseModel,
    begin: Sequence[Array],
    sensor_is_fixed: bool,
    most: int | None = None,
) -> tuple[CombinedModel, RefinedEstimate]:
    """The best fit with all profiles in use.

    Parameters
    ----------
    targets, noise, begin, sensor_is_fixed
        As of `solve_targets`.
    most : int, optional
        Starts to refine at most, and only roughly: to compare, not to keep.
    """
    T_b_f = stack_poses(targets)
    every = np.ones(len(T_b_f), dtype=bool)
    starts = _starts(targets, noise, begin, inverse_poses(T_b_f) if sensor_is_fixed else None)
    found: list[tuple[bool, float, _Start, RefinedEstimate]] = []
    for start in starts[:most]:
        estimate = refine_by_least_squares(
            start.model, start.T_f_s, start.target, every, rough=True
        )
        behind = not sensor_is_fixed and any(
            model.is_behind(estimate.T_f_s, estimate.target[start.model.part(k)])
            for k, model in enumerate(start.model.models)
        )
        found.append((behind, estimate.chi2, start, estimate))
        least_behind, least_chi2 = min(one[:2] for one in found)
        same = [one[0] == least_behind and one[1] < least_chi2 + SAME_PLACE_CHI2 for one in found]
        if sum(same) == CONFIRMING_STARTS:
            break
    _, _, start, estimate = min(found, key=lambda one: one[:2])
    if most is None:
        estimate = refine_by_least_squares(start.model, estimate.T_f_s, estimate.target, every)
    return start.model, estimate


def _starts(
    targets: Targets, noise: NoiseModel, begin: Sequence[Array], true_poses: Array | None
) -> list[_Start]:
    """Starts by their misfit, the nearest first; a fixed sensor has `true_poses` of the flange."""
    correlation = geometry_correlation(stack_poses(targets) if true_poses is None else true_poses)
    starts, by_true_pose = [], None
    if true_poses is not None:
        ends = np.cumsum([len(one.names) for one in targets])[:-1]
        by_true_pose = tuple(np.split(inverse_pose_errors(true_poses), ends))
    for T_f_s in begin:
        begun = [one.start_at(T_f_s) for one in targets]
        models = tuple(start.model for start in begun)
        model = CombinedModel(models, correlation, noise.geometry, by_true_pose)
        target = np.concatenate([start.target for start in begun])
        starts.append(_Start(T_f_s, model, target, model.misfit(T_f_s, target)))
    return sorted(starts, key=lambda start: start.misfit)
