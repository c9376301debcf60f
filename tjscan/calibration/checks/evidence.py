"""Tests of evidence: whether poses were read as they were meant, and belong to their profiles.

Each compares likelihoods of the same profiles under two hypotheses about their poses that have
equally many unknowns. If the stated one is true, another is more likely by a factor of more
than 1/p with a probability of less than p (Royall 1997, Statistical Evidence, 1.4).
"""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.solve.refine import RefinedEstimate
from tjscan.calibration.solve.snooping import blame_prices
from tjscan.calibration.solve.solution import (
    Solution,
    Targets,
    fit_targets,
    stack_poses,
    with_poses,
)
from tjscan.calibration.targets.fixed_sensor import inverse_poses
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array

FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to refuse poses that were read as they were meant."""
MAX_REFINED_STARTS: Final = 2
"""The nearest ones, for each other hypothesis about the poses."""
MAX_WIDENED: Final = 9.0
"""A hypothesis fits if no variance must be larger than stated by more than this."""
MAX_PAIRS_TRIED: Final = 15
"""Pairs of rejected profiles whose poses are exchanged."""
SHIFTS_TRIED: Final = 5
"""Ways to give profiles one another's poses."""


def check_pose_convention(
    targets: Targets, noise: NoiseModel, solution: Solution, sensor_is_fixed: bool
) -> None:
    """Refuse poses that fit far better when read by another convention.

    Parameters
    ----------
    targets : sequence of SeenTarget
        Poses are inverted if the sensor is fixed.
    noise : NoiseModel
        Errors of profiles and poses.
    solution : Solution
        With the poses as they were read.
    sensor_is_fixed : bool
        Whether the sensor is fixed in the room.

    Raises
    ------
    CalibrationRefused
        With how they fit better.
    """
    if solution.whole.is_plausible:
        return
    T = stack_poses(targets)
    readings = other_readings(inverse_poses(T) if sensor_is_fixed else T)
    turned = {k: inverse_poses(T) if sensor_is_fixed else T for k, T in readings.items()}
    fits = {k: _fit_with(targets, noise, T, sensor_is_fixed) for k, T in turned.items()}
    name = min(fits, key=lambda one: _cost(fits[one]))
    gain = _best_cost(solution) - _cost(fits[name])
    # If neither fits, the cause is another one.
    if gain > _limit(len(fits)) and fits[name].variance_scale < MAX_WIDENED:
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
    targets : sequence of SeenTarget
        Poses are inverted if the sensor is fixed.
    noise : NoiseModel
        Errors of profiles and poses.
    solution : Solution
        With each profile's own pose.
    sensor_is_fixed : bool
        Whether the sensor is fixed in the room.

    Raises
    ------
    CalibrationRefused
        If some other pairing is as good.
    """
    if solution.whole.is_plausible and solution.estimate.used.all():
        return
    costs, count = {}, min(len(one.names) for one in targets)
    shifts = {int(k) for k in np.linspace(1, count - 1, SHIFTS_TRIED)} - {0} if count > 2 else set()
    for shift in sorted(shifts):
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
    """Name the rejected profiles that have each other's poses.

    Parameters
    ----------
    targets : sequence of SeenTarget
        Poses are inverted if the sensor is fixed.
    noise : NoiseModel
        Errors of profiles and poses.
    solution : Solution
        Without the profiles that contradict the others.
    sensor_is_fixed : bool
        Whether the sensor is fixed in the room.
    """
    names = [name for one in targets for name in one.names]
    pairs = list(combinations(np.flatnonzero(~solution.estimate.used), 2))[:MAX_PAIRS_TRIED]
    notes, T = [], stack_poses(targets)
    begin = [solution.estimate.T_f_s]
    for i, j in pairs:
        swapped = T.copy()
        swapped[[i, j]] = T[[j, i]]
        changed = with_poses(targets, swapped)
        cost = _cost(fit_targets(changed, noise, begin, sensor_is_fixed, 1)[1])
        if _cost(solution.whole) - cost > _limit(len(pairs)):
            notes.append(
                f"{names[i]} and {names[j]} fit with each other's poses: they were swapped"
            )
    return tuple(notes)


def _fit_with(
    targets: Targets, noise: NoiseModel, T_b_f: Array, sensor_is_fixed: bool
) -> RefinedEstimate:
    """The fit to other poses, from the nearest of the starts that these give."""
    other = with_poses(targets, T_b_f)
    begin = [T for one in other for T in one.starts()]
    return fit_targets(other, noise, begin, sensor_is_fixed, MAX_REFINED_STARTS)[1]


def _best_cost(solution: Solution) -> float:
    """Cost of the stated poses, if profiles may be left out at a price."""
    left_out = ~solution.estimate.used
    prices = blame_prices(solution.estimate)
    return min(_cost(solution.whole), _cost(solution.estimate) + float(prices[left_out].sum()))


def _cost(estimate: RefinedEstimate) -> float:
    """Minus twice the log-likelihood, all errors being as much larger than stated as fits best."""
    widened = estimate.variance_scale
    return float(estimate.chi2 / widened + estimate.dof * np.log(widened))


def _limit(count: int) -> float:
    """Limit of twice the logarithm of likelihoods for the best of so many."""
    return float(2 * np.log(count / FALSE_ALARM_PROBABILITY))


def other_readings(T_b_f: Array) -> dict[str, Array]:
    """Poses that the same numbers mean under other conventions, by the words for these.

    They are the mistakes that are made when arms' files are converted.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses as they were read.
    """
    R = Rotation.from_matrix(T_b_f[:, :3, :3])
    zyx = R.as_euler("ZYX")
    quaternion = R.as_quat()
    turned = {
        "with the angles in the opposite order": Rotation.from_euler("ZYX", zyx[:, ::-1]),
        "with angles about fixed in place of moving axes": Rotation.from_euler("zyx", zyx),
        "with angles about moving x, y, z axes": Rotation.from_euler("XYZ", zyx),
        "with a rotation vector in place of angles about z, y, x": Rotation.from_rotvec(
            zyx[:, ::-1]
        ),
        "with angles about z, y, x in place of a rotation vector": Rotation.from_euler(
            "ZYX", R.as_rotvec()[:, ::-1]
        ),
        "with the quaternion's scalar first in place of last": Rotation.from_quat(
            np.roll(quaternion, -1, axis=1)
        ),
        "with the quaternion's scalar last in place of first": Rotation.from_quat(
            np.roll(quaternion, 1, axis=1)
        ),
        "with every rotation inverted": R.inv(),
    }
    readings = {"inverted: of the base in the flange's frame": inverse_poses(T_b_f)}
    for name, rotation in turned.items():
        T = T_b_f.copy()
        T[:, :3, :3] = rotation.as_matrix()
        readings[name] = T
    return readings
