"""Several targets of one sensor solved together, from many starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any, Final, Self

import numpy as np

from tjscan.calibration.noise import NoiseModel, geometry_correlation
from tjscan.calibration.solve.combined import CombinedModel
from tjscan.calibration.solve.refine import RefinedEstimate, refine_by_least_squares, settle_targets
from tjscan.calibration.solve.snooping import reject_outlying_profiles
from tjscan.calibration.targets.target import SeenTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose, skew_matrix

MIN_LINES: Final = 5
"""Eq. (20) needs five lines in general position."""
CONFIRMING_STARTS: Final = 2
"""Starts that lead to the same best place before no more are tried."""
SAME_PLACE_CHI2: Final = 0.01
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
    whole : RefinedEstimate
        With all profiles in use.
    estimate : RefinedEstimate
        Without the profiles that contradict the others.
    settled : RefinedEstimate
        The same, the targets at the places where the arm sees them; see `settle_targets`.
    model : CombinedModel
        Of all targets.
    """

    whole: RefinedEstimate
    estimate: RefinedEstimate
    settled: RefinedEstimate
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
        if len(self.names) < MIN_LINES:
            raise CalibrationRefused(
                "too few lines",
                f"{len(self.names)} were taken, at least {MIN_LINES} are needed and twelve are "
                "good; take more, each with another tilt of the sensor",
            )
        return np.concatenate([one.T_b_f for one in self.targets if one.names])

    @property
    def starts(self) -> list[Array]:
        """Possible poses of the sensor, shape (4, 4) each, by any target alone."""
        return [T for one in self.targets for T in one.starts()]

    def in_sensor_sense(self, T: Array) -> Array:
        """Poses, shape (n, 4, 4), inverted if the sensor is fixed; of inverted ones, the poses."""
        return inverse_poses(T) if self.sensor_is_fixed else T

    def with_poses(self, T_b_f: Array) -> Self:
        """Return the same profiles from other flange poses, shape (n, 4, 4)."""
        parts = zip(self.targets, self._split(T_b_f), strict=True)
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
        return SensorSolution(whole, final, settle_targets(model, final), model)

    def fit(
        self, begin: Sequence[Array], most: int | None = None
    ) -> tuple[CombinedModel, RefinedEstimate]:
        """Fit sensor and targets with all profiles in use.

        Parameters
        ----------
        begin : sequence of ndarray, shape (4, 4)
            Possible poses of the sensor.
        most : int, optional
            Starts to refine at most, and only roughly: to compare, not to keep.
        """
        every = np.ones(len(self.names), dtype=bool)
        found: list[tuple[bool, float, CombinedModel, RefinedEstimate]] = []
        for _, T_f_s, model, target in self._nearest_starts(begin)[:most]:
            estimate = refine_by_least_squares(model, T_f_s, target, every, rough=True)
            behind = not self.sensor_is_fixed and any(
                one.is_behind(estimate.T_f_s, estimate.target[model.part(k)])
                for k, one in enumerate(model.models)
            )
            found.append((behind, estimate.chi2, model, estimate))
            least_behind, least_chi2 = min(one[:2] for one in found)
            same = [
                one[0] == least_behind and one[1] < least_chi2 + SAME_PLACE_CHI2 for one in found
            ]
            if sum(same) == CONFIRMING_STARTS:
                break
        _, _, model, estimate = min(found, key=lambda one: one[:2])
        if most is None:
            estimate = refine_by_least_squares(model, estimate.T_f_s, estimate.target, every)
        return model, estimate

    def _nearest_starts(
        self, begin: Sequence[Array]
    ) -> list[tuple[float, Array, CombinedModel, Array]]:
        """Misfit, T_f_s, model and targets' parameters of each start, the nearest first."""
        true_poses = self.in_sensor_sense(self.T_b_f)
        correlation, by_true_pose = geometry_correlation(true_poses), None
        if self.sensor_is_fixed:
            by_true_pose = tuple(self._split(inverse_pose_errors(true_poses)))
        starts = []
        for T_f_s in begin:
            models, targets = zip(*(one.start_at(T_f_s) for one in self.targets), strict=True)
            model = CombinedModel(models, correlation, self.noise.geometry, by_true_pose)
            target = np.concatenate(targets)
            starts.append((model.misfit(T_f_s, target), T_f_s, model, target))
        return sorted(starts, key=itemgetter(0))

    def _split(self, of_all: Array) -> list[Array]:
        """Values of all profiles, by target."""
        return np.split(of_all, np.cumsum([len(one.names) for one in self.targets])[:-1])
