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

from tjscan.calibration.solve.refine import RefinedEstimate
from tjscan.calibration.solve.snooping import blame_prices
from tjscan.calibration.solve.solution import CalibrationProblem, SensorSolution, inverse_poses
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


def check_pose_convention(problem: CalibrationProblem, solution: SensorSolution) -> None:
    """Refuse poses that fit far better when read by another convention.

    Parameters
    ----------
    problem : CalibrationProblem
        The profiles.
    solution : SensorSolution
        With the poses as they were read.

    Raises
    ------
    CalibrationRefused
        With how they fit better.
    """
    if solution.whole.is_plausible:
        return
    fits = {
        name: _fit_with_poses(problem, problem.in_sensor_sense(T))
        for name, T in other_readings(problem.in_sensor_sense(problem.T_b_f)).items()
    }
    name = min(fits, key=lambda one: _likelihood_cost(fits[one]))
    gain = _best_cost(solution) - _likelihood_cost(fits[name])
    # If neither fits, the cause is another one.
    if gain > _likelihood_limit(len(fits)) and fits[name].variance_scale < MAX_WIDENED:
        raise CalibrationRefused(
            "poses that were read in another way than they were meant",
            f"the profiles fit e^{gain / 2:.0f} times better to the same poses {name}; check which "
            "convention the file's angles have, and that they are poses of the flange in the base",
        )


def check_pairing(problem: CalibrationProblem, solution: SensorSolution) -> None:
    """Refuse profiles that fit their own poses no better than one another's.

    Parameters
    ----------
    problem : CalibrationProblem
        The profiles.
    solution : SensorSolution
        With each profile's own pose.

    Raises
    ------
    CalibrationRefused
        If some other pairing is as good.
    """
    count = min(len(one.names) for one in problem.targets)
    if count <= 2 or (solution.whole.is_plausible and solution.estimate.used.all()):
        return
    costs = {}
    for shift in map(int, np.unique(np.linspace(1, count - 1, SHIFTS_TRIED).astype(int))):
        moved = np.concatenate([np.roll(one.T_b_f, shift, axis=0) for one in problem.targets])
        costs[shift] = _likelihood_cost(_fit_with_poses(problem, moved))
    best = min(costs, key=lambda one: costs[one])
    if costs[best] - _best_cost(solution) < _likelihood_limit(len(costs)):
        raise CalibrationRefused(
            "profiles that do not belong to their poses",
            f"they fit the poses {best} places further on about as well as their own; check that "
            "both lists begin with the same profile, that none is missing, and that the target "
            "stayed where it was",
        )


def swapped_pairs(problem: CalibrationProblem, solution: SensorSolution) -> tuple[str, ...]:
    """Name the rejected profiles that have each other's poses.

    Parameters
    ----------
    problem : CalibrationProblem
        The profiles.
    solution : SensorSolution
        Without the profiles that contradict the others.
    """
    pairs = list(combinations(np.flatnonzero(~solution.estimate.used), 2))[:MAX_PAIRS_TRIED]
    notes, T, names = [], problem.T_b_f, problem.names
    for i, j in pairs:
        swapped = T.copy()
        swapped[[i, j]] = T[[j, i]]
        _, estimate = problem.with_poses(swapped).fit([solution.estimate.T_f_s], 1)
        gain = _likelihood_cost(solution.whole) - _likelihood_cost(estimate)
        if gain > _likelihood_limit(len(pairs)):
            notes.append(
                f"{names[i]} and {names[j]} fit with each other's poses: they were swapped"
            )
    return tuple(notes)


def _fit_with_poses(problem: CalibrationProblem, T_b_f: Array) -> RefinedEstimate:
    """The fit to other poses, from the nearest of the starts that these give."""
    other = problem.with_poses(T_b_f)
    return other.fit(other.starts, MAX_REFINED_STARTS)[1]


def _best_cost(solution: SensorSolution) -> float:
    """Cost of the stated poses, if profiles may be left out at a price."""
    estimate = solution.estimate
    price = float(blame_prices(estimate)[~estimate.used].sum())
    return min(_likelihood_cost(solution.whole), _likelihood_cost(estimate) + price)


def _likelihood_cost(estimate: RefinedEstimate) -> float:
    """Minus twice the log-likelihood, all errors being as much larger than stated as fits best."""
    widened = estimate.variance_scale
    return float(estimate.chi2 / widened + estimate.dof * np.log(widened))


def _likelihood_limit(count: int) -> float:
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
