"""Tests of evidence: whether poses were read as they were meant, and belong to their profiles.

Each compares likelihoods of the same profiles under two accounts of their poses that have equally
many unknowns. Where the stated account is true, another one is more likely by a factor of more
than 1/p with a probability of less than p (Royall 1997, Statistical Evidence, 1.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np

from tjscan.calibration.checks.readings import other_readings
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.solve.refine import RefinedEstimate
from tjscan.calibration.solve.seen import SeenBall, SeenBoard, SeenRoof
from tjscan.calibration.solve.snooping import blame_prices, chi2_is_plausible
from tjscan.calibration.solve.solution import Solution, fit_targets, stack_poses, with_poses
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose

FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to refuse poses that were read as they were meant."""
STARTS_REFINED: Final = 2
"""The nearest ones, for each other account of the poses."""
MAX_WIDENED: Final = 9.0
"""An account of the poses fits if no variance must be larger than stated by more than this."""
MOST_PAIRS: Final = 15
SHIFTS: Final = 5
"""Ways to give profiles one another's poses."""

Targets = Sequence[SeenBoard | SeenBall | SeenRoof]


def check_pose_convention(
    targets: Targets, noise: NoiseModel, solution: Solution, sensor_is_fixed: bool
) -> None:
    """Refuse poses that fit far better when read by another convention.

    Parameters
    ----------
    targets : sequence of SeenBoard, SeenBall or SeenRoof
        Poses are those of the inverse where the sensor is fixed.
    noise : NoiseModel
        What they err by.
    solution : Solution
        With the poses as they were read.
    sensor_is_fixed : bool
        Whether the sensor stands fixed in the room.

    Raises
    ------
    CalibrationRefused
        With how they fit better.
    """
    if chi2_is_plausible(solution.whole):
        return
    T = stack_poses(targets)
    readings = other_readings(_inverted(T) if sensor_is_fixed else T)
    turned = {k: _inverted(T) if sensor_is_fixed else T for k, T in readings.items()}
    fits = {k: _fit_with(targets, noise, T, sensor_is_fixed) for k, T in turned.items()}
    name = min(fits, key=lambda one: _cost(fits[one]))
    gain = _best_cost(solution) - _cost(fits[name])
    # Where neither fits, what is wrong is something else.
    if gain > _limit(len(fits)) and _widened(fits[name]) < MAX_WIDENED:
        raise CalibrationRefused(
            "poses that were read in another way than they were meant",
            f"the profiles fit e^{gain / 2:.0f} times better to the same poses {name}; check which "
            "convention the file's angles have, and that they are poses of the flange in the base",
        )


def check_pairing(
    targets: Targets, noise: NoiseModel, solution: Solution, sensor_is_fixed: bool
) -> None:
    """Refuse profiles that fit their own poses no better than one another's.

    Parameters
    ----------
    targets : sequence of SeenBoard, SeenBall or SeenRoof
        Poses are those of the inverse where the sensor is fixed.
    noise : NoiseModel
        What they err by.
    solution : Solution
        With each profile's own pose.
    sensor_is_fixed : bool
        Whether the sensor stands fixed in the room.

    Raises
    ------
    CalibrationRefused
        If some other pairing is as good.
    """
    if chi2_is_plausible(solution.whole) and solution.estimate.used.all():
        return
    costs = {}
    for shift in _shifts(min(len(one.names) for one in targets)):
        moved = np.concatenate([np.roll(one.T_b_f, shift, axis=0) for one in targets])
        costs[shift] = _cost(_fit_with(targets, noise, moved, sensor_is_fixed))
    if not costs:
        return
    best = min(costs, key=lambda one: costs[one])
    if costs[best] - _best_cost(solution) < _limit(len(costs)):
        raise CalibrationRefused(
            "profiles that do not belong to their poses",
            f"they fit the poses {best} places further on about as well as their own; check that "
            "both lists begin with the same profile, that none is missing, and that the target "
            "stayed where it was",
        )


def swapped_pairs(
    targets: Targets, noise: NoiseModel, solution: Solution, sensor_is_fixed: bool
) -> tuple[str, ...]:
    """Say which of the profiles left out have each other's poses.

    Parameters
    ----------
    targets : sequence of SeenBoard, SeenBall or SeenRoof
        Poses are those of the inverse where the sensor is fixed.
    noise : NoiseModel
        What they err by.
    solution : Solution
        Without the profiles that contradict the others.
    sensor_is_fixed : bool
        Whether the sensor stands fixed in the room.
    """
    names = [name for one in targets for name in one.names]
    pairs = list(combinations(np.flatnonzero(~solution.estimate.used), 2))[:MOST_PAIRS]
    said, T = [], stack_poses(targets)
    begin = [solution.estimate.T_f_s]
    for i, j in pairs:
        swapped = T.copy()
        swapped[[i, j]] = T[[j, i]]
        changed = with_poses(targets, swapped)
        cost = _cost(fit_targets(changed, noise, begin, sensor_is_fixed, 1)[2])
        if _cost(solution.whole) - cost > _limit(len(pairs)):
            said.append(f"{names[i]} and {names[j]} fit with each other's poses: they were swapped")
    return tuple(said)


def _fit_with(
    targets: Targets, noise: NoiseModel, T_b_f: Array, sensor_is_fixed: bool
) -> RefinedEstimate:
    """The fit to other poses, from the nearest of the starts that these give."""
    other = with_poses(targets, T_b_f)
    begin = [T for one in other for T in one.starts()]
    return fit_targets(other, noise, begin, sensor_is_fixed, STARTS_REFINED)[2]


def _best_cost(solution: Solution) -> float:
    """That of the stated account, where profiles may be left out at a price."""
    left_out = ~solution.estimate.used
    prices = blame_prices(solution.estimate)
    return min(_cost(solution.whole), _cost(solution.estimate) + float(prices[left_out].sum()))


def _cost(estimate: RefinedEstimate) -> float:
    """Minus twice the log-likelihood, all errors being as much larger than stated as fits best."""
    widened = _widened(estimate)
    return float(estimate.chi2 / widened + estimate.dof * np.log(widened))


def _widened(estimate: RefinedEstimate) -> float:
    """By how much the variances are larger than stated."""
    return max(1.0, estimate.chi2 / max(estimate.dof, 1))


def _limit(count: int) -> float:
    """Of twice the logarithm of likelihoods, where the best of so many is looked at."""
    return float(2 * np.log(count / FALSE_ALARM_PROBABILITY))


def _shifts(count: int) -> list[int]:
    return sorted({int(k) for k in np.linspace(1, count - 1, SHIFTS)} - {0}) if count > 2 else []


def _inverted(T: Array) -> Array:
    return np.stack([inverse_pose(one) for one in T])
