"""Targets of one sensor solved together, from many starts, without contradicting profiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb
from operator import itemgetter
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tjscan.calibration.noise import NoiseModel, geometry_error_correlation
from tjscan.calibration.solve import refine
from tjscan.calibration.solve.refine import CombinedModel, LeastSquaresEstimate
from tjscan.calibration.targets.target import SeenTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, Mask, inverse_pose, skew_matrix

MIN_PROFILES_KEPT: Final = 5
"""Profiles that are never left out."""
MAX_REJECTED_SHARE: Final = 1 / 3
"""If a larger share were bad, the others could not show which."""
MIN_DOF_SHARE_KEPT: Final = 0.5
"""Share of the degrees of freedom that must remain: with few left, any lines agree."""
MAX_REJECTION_SETS_TRIED: Final = 3000
"""Sets of one size that are tried; of larger choices, the last set and one more."""
SINGULAR_SET_RIDGE: Final = 1e-6
"""Keeps sets solvable that nothing could be found without; they leave no residual anyway."""
GEOMETRY_ERROR_GRID: Final = (2e-5, 2e-3, 25)
"""Metres from and to, and steps: from less than an arm repeats to more than any arm is off."""
PARAMETER_RIDGE: Final = 1e-12
"""Share of a parameter's information: far less than any measurement gives."""
MIN_COST_DROP_FOR_LARGER_ERROR: Final = float(chdtri(1, 2 * refine.FALSE_ALARM_PROBABILITY))
"""Fall of the cost that a larger geometry error must bring: twice a logarithm of likelihoods,
chi-square with one degree of freedom, and half the time no larger error fits better by chance."""


def reject_outlying_profiles(
    model: CombinedModel, estimate: LeastSquaresEstimate, stated: float = 0.0
) -> LeastSquaresEstimate:
    """Solve again without the profiles that contradict the others.

    Bad profiles hide one another and put the blame on good ones, so sets of them are left out
    whole. The set is taken that explains the profiles best: a profile costs as much as it must
    differ by to be blamed alone. Two other explanations compete: that all profiles are rougher
    than stated, and that the arm's geometry is off.

    Parameters
    ----------
    model : CombinedModel
        The profiles.
    estimate : LeastSquaresEstimate
        With all of them in use.
    stated : float
        Geometry error to allow for at least, metres.
    """
    prices = blame_thresholds(estimate)
    geometry, cost = most_likely_geometry_error(estimate, stated)
    best, last = estimate, estimate
    if not (estimate.is_plausible and (refine.leave_one_out_changes(estimate)[0] <= prices).all()):
        n, k = len(estimate.used), int(estimate.residuals_per_profile.max())
        spare = int((1 - MIN_DOF_SHARE_KEPT) * estimate.dof)
        most = min(int(MAX_REJECTED_SHARE * n), n - MIN_PROFILES_KEPT, spare // k)
        for size in range(1, most + 1):
            left_out = _find_worst_set(estimate, last, size)
            last = refine.refine_by_least_squares(
                model, last.T_f_s, last.target, ~left_out, rough=True
            )
            found, its_cost = most_likely_geometry_error(last, stated)
            its_cost += float(prices[left_out].sum())
            if its_cost < cost:
                best, geometry, cost = last, found, its_cost
    if best is estimate and geometry == best.geometry:
        return best
    model = replace(model, geometry=geometry)
    return refine.refine_by_least_squares(model, best.T_f_s, best.target, best.used)


def blame_thresholds(estimate: LeastSquaresEstimate) -> Array:
    """By how much each profile must differ to be blamed alone, shape (n,): a chi-squared."""
    sizes = estimate.residuals_per_profile
    return np.asarray(chdtri(sizes, refine.FALSE_ALARM_PROBABILITY / len(sizes)))


def _find_worst_set(estimate: LeastSquaresEstimate, last: LeastSquaresEstimate, size: int) -> Mask:
    """The set whose absence lowers the weighted sum of squares most, shape (n,)."""
    n = len(estimate.used)
    if comb(n, size) > MAX_REJECTION_SETS_TRIED:
        worst = np.where(last.used, refine.leave_one_out_changes(last)[0], -1.0)
        return np.asarray(~last.used | (np.arange(n) == np.argmax(worst)))
    sets = np.array(list(combinations(range(n), size)))
    return np.isin(np.arange(n), sets[int(np.argmax(_chi2_drops(estimate, sets)))])


def _chi2_drops(estimate: LeastSquaresEstimate, sets: NDArray[np.intp]) -> Array:
    """By how much leaving out each set, rows of indices, lowers the sum of squares, first order."""
    M, weighted = refine.residual_weights_and_sums(estimate)
    scale = np.sqrt(np.diag(estimate.stacked.covariance))
    sizes = estimate.residuals_per_profile
    n, k = len(sizes), int(sizes.max())
    # As many rows for every profile; rows that some lack have no effect.
    row = estimate.stacked.profile * k + np.concatenate([np.arange(size) for size in sizes])
    left, r = np.eye(n * k), np.zeros(n * k)
    left[np.ix_(row, row)] = M * np.outer(scale, scale)
    r[row] = weighted * scale
    blocks = left.reshape(n, k, n, k).transpose(0, 2, 1, 3)[sets[:, :, None], sets[:, None, :]]
    rows = sets.shape[1] * k
    inner = blocks.transpose(0, 1, 3, 2, 4).reshape(-1, rows, rows) + SINGULAR_SET_RIDGE * np.eye(
        rows
    )
    r_set = r.reshape(n, k)[sets].reshape(-1, rows, 1)
    return np.asarray((r_set * np.linalg.solve(inner, r_set)).sum(axis=(1, 2)))


def most_likely_geometry_error(
    estimate: LeastSquaresEstimate, stated: float
) -> tuple[float, float]:
    """Find the size of the arm's geometry error that explains the residuals best.

    Parameters
    ----------
    estimate : LeastSquaresEstimate
        Of the profiles that count.
    stated : float
        Metres; the size is not taken for less.

    Returns
    -------
    geometry : float
        Metres; `stated` if a larger one explains no more than chance does.
    cost : float
        Minus twice its restricted log-likelihood, and `MIN_COST_DROP_FOR_LARGER_ERROR` for the one
        more unknown.
    """
    tried = np.concatenate(([stated], np.geomspace(*GEOMETRY_ERROR_GRID)))
    tried = tried[tried >= stated]
    costs = _geometry_error_costs(estimate, tried)
    best = int(np.argmin(costs))
    if costs[best] + MIN_COST_DROP_FOR_LARGER_ERROR < costs[0]:
        return float(tried[best]), float(costs[best] + MIN_COST_DROP_FOR_LARGER_ERROR)
    return stated, float(costs[0])


def _geometry_error_costs(estimate: LeastSquaresEstimate, tried: Array) -> Array:
    """Minus twice the restricted log-likelihood of each size, up to a constant.

    All errors may be larger than stated by a factor, which is profiled out; never smaller
    (Patterson and Thompson 1971, doi:10.1093/biomet/58.3.545).
    """
    stacked = estimate.residuals_in_use
    G = stacked.geometry
    L = np.linalg.cholesky(stacked.covariance - estimate.geometry**2 * G)
    # In the axes in which both covariances are diagonal, every size costs next to nothing.
    shares, axes = np.linalg.eigh(np.linalg.solve(L, np.linalg.solve(L, G).T))
    J = axes.T @ np.linalg.solve(L, stacked.jacobian)
    r = axes.T @ np.linalg.solve(L, stacked.residuals)
    prior = np.pad(estimate.prior_information, ((6, 0), (6, 0)))
    pull = prior[:, 6:] @ estimate.target
    at_rest = float(estimate.target @ estimate.prior_information @ estimate.target)
    variances = 1 + tried[:, None] ** 2 * np.maximum(shares, 0.0)
    A = np.einsum("ni,kn,nj->kij", J, 1 / variances, J) + prior
    # Each parameter in units of its own, and a little held: profiles that contradict each other
    # may leave it open altogether.
    known = np.sqrt(np.einsum("kii->ki", A))
    units = np.where(known > 0, known, 1.0)
    A = A / (units[:, :, None] * units[:, None]) + PARAMETER_RIDGE * np.eye(A.shape[1])
    gradient = ((r / variances) @ J + pull) / units
    away = np.linalg.solve(A, gradient[..., None])[..., 0]
    chi2 = (r**2 / variances).sum(axis=1) + at_rest - np.einsum("ki,ki->k", gradient, away)
    widened = np.maximum(1.0, chi2 / max(estimate.dof, 1))
    volume = np.log(variances).sum(axis=1) + np.linalg.slogdet(A)[1] + 2 * np.log(units).sum(axis=1)
    return np.asarray(chi2 / widened + estimate.dof * np.log(widened) + volume)


MIN_HAND_EYE_PROFILES: Final = 5
"""Eq. (20) needs five lines in general position."""
CONFIRMING_STARTS: Final = 2
"""Starts that lead to the same best place before no more are tried."""
SAME_OPTIMUM_CHI2: Final = 0.01
"""Sums of squares nearer than this belong to the same place."""

Targets = Sequence[SeenTarget[Any]]


def inverse_poses(T: Array) -> Array:
    """Inverse of each pose, shape (n, 4, 4)."""
    return np.stack([inverse_pose(one) for one in T])


def inverse_pose_errors(T_b_f: Array) -> Array:
    """Effect of a small error of each pose on its inverse.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.

    Returns
    -------
    ndarray, shape (n, 6, 6)
        From translation and rotation about the flange's origin in the axes of b, to translation
        and rotation of T_f_b about the base's origin in the axes of f.
    """
    R_f_b = T_b_f[:, :3, :3].transpose(0, 2, 1)
    errors = np.zeros((len(T_b_f), 6, 6))
    errors[:, :3, :3] = errors[:, 3:, 3:] = -R_f_b
    errors[:, :3, 3:] = -R_f_b @ skew_matrix(T_b_f[:, :3, 3])
    return errors


@dataclass(frozen=True, slots=True, eq=False)
class SensorSolution:
    """Estimate of one sensor and several targets.

    Parameters
    ----------
    whole : LeastSquaresEstimate
        With all profiles in use.
    estimate : LeastSquaresEstimate
        Without the profiles that contradict the others.
    settled : LeastSquaresEstimate
        The same, the targets at the places where the arm sees them; see `refit_targets`.
    model : CombinedModel
        Of all targets.
    """

    whole: LeastSquaresEstimate
    estimate: LeastSquaresEstimate
    settled: LeastSquaresEstimate
    model: CombinedModel


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationProblem:
    """Profiles of one or several targets, from which to find one sensor and all targets.

    Parameters
    ----------
    targets : sequence of SeenTarget
        The profiles of each target; their poses are inverted if the sensor is fixed.
    noise : NoiseModel
        Errors of profiles and poses.
    sensor_is_fixed : bool
        Whether the sensor is fixed in the room, and the arm carries the targets.

    Notes
    -----
    Seen from the flange, a fixed sensor moves, on the base as if that were its flange. T_b_f of a
    target's model is then the base in the flange's frame, T_f_s is the sensor in the base's, and
    the target's parameters count in the flange's.
    """

    targets: Targets
    noise: NoiseModel
    sensor_is_fixed: bool = False

    @property
    def names(self) -> list[str]:
        """Names of all profiles."""
        return [name for one in self.targets for name in one.names]

    @property
    def T_b_f(self) -> Array:
        """Flange poses of all profiles, shape (n, 4, 4).

        Raises
        ------
        CalibrationRefused
            If there are too few.
        """
        if len(self.names) < MIN_HAND_EYE_PROFILES:
            raise CalibrationRefused(
                "too few lines",
                f"{len(self.names)} were taken, at least {MIN_HAND_EYE_PROFILES} are needed and "
                "twelve are good; take more, each with another tilt of the sensor",
            )
        return np.concatenate([one.T_b_f for one in self.targets if one.names])

    @property
    def starts(self) -> list[Array]:
        """Possible poses of the sensor, shape (4, 4) each, by any target alone."""
        return [T for one in self.targets for T in one.starts()]

    def invert_if_fixed(self, T: Array) -> Array:
        """Poses, shape (n, 4, 4), inverted if the sensor is fixed; of inverted ones, the poses."""
        return inverse_poses(T) if self.sensor_is_fixed else T

    def with_poses(self, T_b_f: Array) -> Self:
        """Return the same profiles from other flange poses, shape (n, 4, 4)."""
        parts = zip(self.targets, self._split_by_target(T_b_f), strict=True)
        return replace(self, targets=[one.with_poses(part) for one, part in parts])

    def solve(self, begin: Sequence[Array]) -> SensorSolution:
        """Solve without the profiles that contradict the others.

        Parameters
        ----------
        begin : sequence of ndarray, shape (4, 4)
            Possible poses of the sensor.
        """
        model, whole = self.fit(begin)
        final = reject_outlying_profiles(model, whole, self.noise.geometry)
        return SensorSolution(whole, final, refine.refit_targets(model, final), model)

    def fit(
        self, begin: Sequence[Array], most: int | None = None
    ) -> tuple[CombinedModel, LeastSquaresEstimate]:
        """Fit sensor and targets with all profiles in use.

        Parameters
        ----------
        begin : sequence of ndarray, shape (4, 4)
            Possible poses of the sensor.
        most : int, optional
            Starts to refine at most, and only roughly: to compare, not to keep.
        """
        every = np.ones(len(self.names), dtype=bool)
        found: list[tuple[bool, float, CombinedModel, LeastSquaresEstimate]] = []
        for _, T_f_s, model, target in self._nearest_starts(begin)[:most]:
            estimate = refine.refine_by_least_squares(model, T_f_s, target, every, rough=True)
            behind = not self.sensor_is_fixed and any(
                one.is_behind(estimate.T_f_s, estimate.target[model.target_slice(k)])
                for k, one in enumerate(model.models)
            )
            found.append((behind, estimate.chi2, model, estimate))
            least_behind, least_chi2 = min(one[:2] for one in found)
            same = [
                one[0] == least_behind and one[1] < least_chi2 + SAME_OPTIMUM_CHI2 for one in found
            ]
            if sum(same) == CONFIRMING_STARTS:
                break
        _, _, model, estimate = min(found, key=lambda one: one[:2])
        if most is None:
            estimate = refine.refine_by_least_squares(model, estimate.T_f_s, estimate.target, every)
        return model, estimate

    def _nearest_starts(
        self, begin: Sequence[Array]
    ) -> list[tuple[float, Array, CombinedModel, Array]]:
        """Misfit, T_f_s, model and targets' parameters of each start, the nearest first."""
        true_poses = self.invert_if_fixed(self.T_b_f)
        correlation, by_true_pose = geometry_error_correlation(true_poses), None
        if self.sensor_is_fixed:
            by_true_pose = tuple(self._split_by_target(inverse_pose_errors(true_poses)))
        starts = []
        for T_f_s in begin:
            models, targets = zip(
                *(one.model_at_sensor_pose(T_f_s) for one in self.targets), strict=True
            )
            model = CombinedModel(models, correlation, self.noise.geometry, by_true_pose)
            target = np.concatenate(targets)
            starts.append((model.weighted_misfit(T_f_s, target), T_f_s, model, target))
        return sorted(starts, key=itemgetter(0))

    def _split_by_target(self, of_all: Array) -> list[Array]:
        """Values of all profiles, by target."""
        return np.split(of_all, np.cumsum([len(one.names) for one in self.targets])[:-1])
