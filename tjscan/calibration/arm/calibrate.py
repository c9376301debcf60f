"""An arm and the sensor on it calibrated together: the arm's most probable deviations, checked.

They are found from the maker's tolerance and from profiles of targets; others check them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri

from tjscan.calibration.checks import scaled_condition
from tjscan.calibration.file import FILE_UNITS_PER_SI, ArmKinematicsEntry, rows_in_file_units
from tjscan.calibration.result import HandEyeCalibration, SampleResidual
from tjscan.calibration.solve import refine
from tjscan.calibration.solve.refine import StackedResiduals, stack_residuals
from tjscan.calibration.targets.target import TargetModel
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import (
    Array,
    Mask,
    array_dataclass,
    inverse_pose,
    readonly_copy,
)
from tjscan.core.pose_vector import boxplus
from tjscan.robot.deviations import deviate_joint_frames, deviation_jacobian
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

GEOMETRY_SAMPLE_POSTURES: Final = 100
"""Drawn postures over which an arm's geometry error has the size that is stated."""


@array_dataclass
class TargetInPostures:
    """A target and the profiles of it, with the arm's postures.

    Parameters
    ----------
    model : TargetModel
        Of n profiles.
    q : ndarray, shape (n, joints)
        Joint angles at each, radians.
    T_b_f : ndarray, shape (n, 4, 4)
        Flange pose at each, as the arm read it.
    start : ndarray, shape (m,)
        Approximate parameters of the target.
    """

    model: TargetModel
    q: Array
    T_b_f: Array
    start: Array


@dataclass(frozen=True, eq=False)
class ArmModel:
    """Residuals of profiles that an arm took, by its deviations, T_f_s and targets.

    The true flange pose is the one that the arm reads, and a motion further: from the model's
    flange pose at these joint angles to the model's with deviations. So a controller may
    read poses with a calibration of its own.

    Parameters
    ----------
    kinematics : Kinematics
        The arm without deviations.
    targets : tuple of SeenTarget
        What was seen.
    """

    kinematics: Kinematics
    targets: tuple[TargetInPostures, ...]

    @property
    def joint_count(self) -> int:
        """Number of joints."""
        return len(self.kinematics.lower)

    @cached_property
    def profile_count(self) -> int:
        """Number of profiles."""
        return sum(len(seen.q) for seen in self.targets)

    @cached_property
    def target_start(self) -> Array:
        """Parameters of all targets to start from, shape (m,)."""
        return np.concatenate([seen.start for seen in self.targets])

    @cached_property
    def _flange_motions(self) -> list[tuple[Array, Array]]:
        """Motions of the flange beside the model's, for each target of n profiles.

        From the model's flange pose to the one that the arm reads, frame b, shape (n, 4, 4); and
        by the deviations, in the axes of f, shape (n, 6, 6 joints).
        """
        forward = self.kinematics.forward
        return [
            (
                np.array([T @ inverse_pose(forward(q)) for q, T in zip(s.q, s.T_b_f, strict=True)]),
                np.array([deviation_jacobian(self.kinematics, q).reshape(6, -1) for q in s.q]),
            )
            for s in self.targets
        ]

    def linearise(self, T_f_s: Array, deviations: Array, target: Array) -> StackedResiduals:
        """Residuals at a guess, with derivatives and covariance.

        The derivative is by a step of T_f_s, by the deviations, and by the targets' parameters.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        deviations : ndarray, shape (joints, 6)
            See `deviate_joint_frames`.
        target : ndarray, shape (m,)
            The targets' parameters, one after the other.

        Notes
        -----
        The derivative by deviations is that without any: deviations are some 1e-4, and so is its
        relative error.
        """
        arm = deviate_joint_frames(self.kinematics, deviations)
        own_targets = np.split(target, np.cumsum([len(s.start) for s in self.targets])[:-1])
        parts = []
        for seen, own, (E, J) in zip(self.targets, own_targets, self._flange_motions, strict=True):
            T_b_f = E @ np.array([arm.forward(q) for q in seen.q])
            found = seen.model.at_other_poses(T_b_f).linearise(T_f_s, own)
            R = T_b_f[:, :3, :3]  # from the axes of b to those of f, which deviations count in
            by_flange = np.concatenate([half @ R for half in np.split(found.by_arm, 2, 2)], axis=2)
            by_pose = np.concatenate((found.by_pose, by_flange @ J), axis=2)
            parts.append(replace(found, by_pose=by_pose))
        return stack_residuals(parts)


@dataclass(frozen=True, eq=False)
class ArmGeometryDeviation:
    """Geometry error of an arm whose model is known: its joints deviate from the model.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    tolerance : PlacementTolerance
        How the deviations of a joint compare with each other; their size counts for nothing here.
    """

    kinematics: Kinematics
    tolerance: PlacementTolerance = field(default_factory=PlacementTolerance)

    @cached_property
    def _rms_error(self) -> float:
        """RMS of the flange's position over all postures, each axis, metres."""
        rng = np.random.default_rng(0)
        drawn = rng.uniform(-np.pi, np.pi, (GEOMETRY_SAMPLE_POSTURES, len(self.kinematics.lower)))
        moved = np.array([self._flange_motion_by_draws(q)[:3] for q in drawn])
        return float(np.sqrt(np.mean(np.sum(moved**2, axis=2))))

    def flange_motion(self, q: Array) -> Array:
        """How the flange moves with m independent standard normal draws, shape (6, m).

        Translation, metres, and rotation about the flange's origin, radians, in the axes of b; of
        an arm whose flange is off by one metre in each axis, root mean square over all postures.

        Parameters
        ----------
        q : ndarray, shape (joints,)
            Joint angles, radians.
        """
        R_b_f = self.kinematics.forward(q)[:3, :3]
        return np.asarray(
            block_diag(R_b_f, R_b_f) @ self._flange_motion_by_draws(q) / self._rms_error
        )

    def _flange_motion_by_draws(self, q: Array) -> Array:
        by_deviations = deviation_jacobian(self.kinematics, q) * self.tolerance.sigmas
        return by_deviations.reshape(6, -1)


MAX_REJECTED_PROFILE_SHARE: Final = 0.1
"""Of the profiles; with more, it is not single ones that are bad."""

ARM_REWEIGHTING_ROUNDS: Final = 2
"""Weights depend on the geometry only weakly."""

MIN_UNDETERMINED_SHARE: Final = 0.8
"""A deviation counts as undetermined if so much of it is in directions that the profiles show less
well than the prior does."""

JOINT_DEVIATION_KINDS: Final = ("length x", "length y", "length z", "twist x", "twist y", "offset")
"""Of a joint's deviations, in their order."""


def estimate_deviations(
    model: ArmModel, sigmas: Array, T_f_s: Array, held_out: Mask | None = None
) -> refine.LeastSquaresEstimate:
    """Estimate deviations, sensor and targets, without the profiles that contradict the others.

    Parameters
    ----------
    model : ArmModel
        The profiles.
    sigmas : ndarray, shape (joints, 6)
        Standard deviations of the joints' deviations about zero, as the maker leaves them; all
        zero for an arm without deviations.
    T_f_s : ndarray, shape (4, 4)
        About how the sensor sits.
    held_out : ndarray of bool, shape (n,), optional
        Profiles that take no part.
    """
    used = np.ones(model.profile_count, dtype=bool) if held_out is None else ~held_out
    offered = int(used.sum())
    estimate = _solve_for_deviations(model, sigmas, T_f_s, model.target_start, used)
    while used.sum() > (1 - MAX_REJECTED_PROFILE_SHARE) * offered:
        falls, _ = leave_one_profile_out(estimate)
        worst = int(falls.argmax())
        count = int(estimate.residuals_per_profile[worst])
        limit = chdtri(count, refine.FALSE_ALARM_PROBABILITY / offered)
        if falls[worst] <= estimate.variance_scale * limit:
            return estimate
        used = used & (np.arange(len(used)) != worst)
        estimate = _solve_for_deviations(model, sigmas, estimate.T_f_s, estimate.target, used)
    return estimate


def whitened_jacobian(estimate: refine.LeastSquaresEstimate, sigmas: Array) -> Array:
    """Derivatives of the used residuals over their errors, shape (N, 6 + 6 joints + m).

    By steps of T_f_s, by deviations over their `sigmas`, shape (joints, 6), and by targets.
    """
    stacked = estimate.residuals_in_use
    scale = _parameter_scales(sigmas, len(estimate.target))
    return refine.whiten_residuals(stacked.residual_covariance_cholesky, stacked.jacobian * scale)


@dataclass(frozen=True, slots=True, eq=False)
class _ScaledArm:
    """Residuals by deviations over their sigmas and by targets: the prior is a sum of squares."""

    model: ArmModel
    sigmas: Array

    def residuals_and_jacobian(self, T_f_s: Array, parameters: Array) -> tuple[Array, Array]:
        found = self.linearise(T_f_s, parameters)
        return found.residuals, found.jacobian

    def linearise(self, T_f_s: Array, parameters: Array) -> StackedResiduals:
        deviations, target = self.unscaled_parameters(parameters)
        found = self.model.linearise(T_f_s, deviations, target)
        scale = _parameter_scales(self.sigmas, len(target))
        return replace(found, jacobian=found.jacobian * scale)

    def unscaled_parameters(self, parameters: Array) -> tuple[Array, Array]:
        """Deviations, shape (joints, 6), and the targets' parameters."""
        n = self.sigmas.size
        deviations = (parameters[:n] * self.sigmas.ravel()).reshape(self.sigmas.shape)
        return deviations, parameters[n:]


def _solve_for_deviations(
    model: ArmModel, sigmas: Array, T_f_s: Array, target: Array, used: Mask
) -> refine.LeastSquaresEstimate:
    scaled, prior = _ScaledArm(model, sigmas), np.eye(sigmas.size, sigmas.size + len(target))
    start = np.concatenate((np.zeros(sigmas.size), target))
    found = refine.solve_reweighted(scaled, T_f_s, start, used, prior, ARM_REWEIGHTING_ROUNDS)
    scale = _parameter_scales(sigmas, len(target))
    deviations, target = scaled.unscaled_parameters(found.target)
    return replace(
        found,
        target=target,
        deviations=deviations,
        covariance=found.covariance * np.outer(scale, scale),
        stacked=model.linearise(found.T_f_s, deviations, target),
    )


def leave_one_profile_out(estimate: refine.LeastSquaresEstimate) -> tuple[Array, Array]:
    """By how much the sum of squares would fall without each profile, and T_f_s would move.

    Returns
    -------
    falls : ndarray, shape (n,)
        Chi-square with as many degrees of freedom as the profile has residuals, if it is as good
        as stated; zero for those that are not in use.
    steps : ndarray, shape (n, 6)
        Translation (metres) and rotation (radians) in the axes of f.
    """
    stacked = estimate.residuals_in_use
    L = stacked.residual_covariance_cholesky
    J, r = (
        refine.whiten_residuals(L, stacked.jacobian),
        refine.whiten_residuals(L, stacked.residuals),
    )
    gain = estimate.covariance @ J.T
    left = np.eye(len(J)) - J @ gain
    falls, steps = np.zeros(len(estimate.used)), np.zeros((len(estimate.used), 6))
    for i in np.flatnonzero(estimate.used):
        own = stacked.profile == i
        predicted = np.linalg.solve(left[np.ix_(own, own)], r[own])
        falls[i], steps[i] = r[own] @ predicted, gain[:6, own] @ predicted
    return falls, steps


def _parameter_scales(sigmas: Array, targets: int) -> Array:
    """What one of each parameter is: T_f_s, deviations over their sigmas, and targets."""
    return np.concatenate((np.ones(6), sigmas.ravel(), np.ones(targets)))


def describe_undetermined(J: Array, joints: int) -> tuple[str, ...]:
    """Sentences on deviations that profiles leave as the prior has them, by joint and cause.

    Parameters
    ----------
    J : ndarray, shape (N, 6 + 6 joints + m)
        As `whitened_jacobian` gives it: in units in which the prior of each deviation is one.
    joints : int
        Number of joints.

    Notes
    -----
    Effects that T_f_s and targets can take over are projected out. Singular values of the rest
    below one belong to combinations of deviations that the profiles show less well than the prior.
    """
    n = 6 * joints
    free = np.hstack((J[:, :6], J[:, 6 + n :]))
    free = free[:, np.any(free, axis=0)]  # points show nothing of a sensor
    Q, _ = np.linalg.qr(free / np.linalg.norm(free, axis=0))
    own = J[:, 6 : 6 + n]
    _, singular, rows = np.linalg.svd(own - Q @ (Q.T @ own), full_matrices=True)
    blind = rows[np.concatenate((singular < 1, np.ones(len(rows) - len(singular), dtype=bool)))]
    share = (blind**2).sum(axis=0)
    groups: dict[tuple[int, str], list[str]] = {}
    for k in map(int, np.flatnonzero(share >= MIN_UNDETERMINED_SHARE)):
        cause = _most_similar_cause(J, k, joints)
        groups.setdefault((k // 6 + 1, cause), []).append(JOINT_DEVIATION_KINDS[k % 6])
    return tuple(
        f"joint {joint}: {', '.join(kinds)} not separable from {cause}: left as the maker states"
        for (joint, cause), kinds in groups.items()
    )


def _most_similar_cause(J: Array, k: int, joints: int) -> str:
    """Cause with most of the effect of deviation k."""
    n = 6 * joints
    others = np.delete(J, 6 + k, axis=1)
    # As few and small others as possible: the prior's weight, and next to none without a prior.
    weight = np.full(others.shape[1], 1e-6)
    weight[6 : 5 + n] = 1.0
    scaled = others / np.maximum(
        np.linalg.norm(others, axis=0) * (weight < 1) + (weight == 1), 1e-300
    )
    A = np.concatenate((scaled, np.diag(weight)))
    x = np.linalg.lstsq(A, np.concatenate((J[:, 6 + k], np.zeros(len(weight)))), rcond=None)[0]
    joint = np.delete(np.arange(n), k) // 6
    causes = {"how the sensor sits": slice(6), "where the target is": slice(5 + n, None)} | {
        f"those of joint {j + 1}": 6 + np.flatnonzero(joint == j) for j in range(joints)
    }
    return max(causes, key=lambda name: np.linalg.norm(scaled[:, causes[name]] @ x[causes[name]]))


MIN_ARM_CALIBRATION_PROFILES: Final = 20
"""Fewer determine less than the maker states; forty are good."""

MIN_HELD_OUT_PROFILES: Final = 3
"""Fewer check nothing."""

MAX_SIGMA_SCALE: Final = 5.0
"""Residuals so much larger than stated are not caused by the arm's lengths and zeros."""

MAX_HELD_OUT_WORSENING: Final = 1.3
"""Times that poses which took no part may be further off than before: of an arm without deviations,
the RMS of twelve arcs differs by so much now and then."""


@array_dataclass
class ArmCalibration:
    """An arm's deviations and the sensor's pose on its flange, found together.

    Parameters
    ----------
    estimate : refine.LeastSquaresEstimate
        Deviations, sensor and targets.
    undetermined : tuple of str
        Sentences on deviations that are known no better than before.
    held_out : ndarray of bool, shape (n,)
        The profiles that took no part.
    error_before, error_after : float
        RMS distance of the target in these from its place by the arm's model, and by the calibrated
        arm, in metres; without deviations, the sensor's pose was found from the same profiles.
    """

    estimate: refine.LeastSquaresEstimate
    undetermined: tuple[str, ...]
    held_out: Mask
    error_before: float
    error_after: float

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
        found = refine.laser_response_of_estimate(self.estimate)
        return None if found is None else readonly_copy(found[: 6 + self.estimate.deviations.size])

    def summary_sentences(self, checks: str, target: str) -> list[str]:
        """Sentences on the check with held-out `checks`, and on undetermined deviations."""
        before, after = 1e3 * self.error_before, 1e3 * self.error_after
        return [
            f"{self.held_out.sum()} {checks} that took no part: the {target} {before:.3f} mm "
            f"off (RMS) as the arm's model has it, {after:.3f} mm with what was found",
            *self.undetermined,
        ]


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
    if count < MIN_ARM_CALIBRATION_PROFILES or checking < MIN_HELD_OUT_PROFILES:
        raise CalibrationRefused(
            "too few poses",
            f"{count} show the target, and {checking} to check with; at least "
            f"{MIN_ARM_CALIBRATION_PROFILES} and {MIN_HELD_OUT_PROFILES} are needed, and forty are "
            "good; take more, each in another posture of the arm",
        )
    prior = np.tile(tolerance.sigmas, (model.joint_count, 1))
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
    before, after = (_held_out_rms(one, held_out) for one in (plain, found))
    if after > MAX_HELD_OUT_WORSENING * before:
        raise CalibrationRefused(
            "poses that took no part fit worse",
            f"the target is {1e3 * before:.3f} mm RMS off as the arm's model has it, and "
            f"{1e3 * after:.3f} mm with the deviations found; take more poses, in other "
            "postures",
        )
    undetermined = describe_undetermined(whitened_jacobian(found, prior), model.joint_count)
    return ArmCalibration(found, undetermined, held_out, before, after)


def _held_out_rms(estimate: refine.LeastSquaresEstimate, held_out: Mask) -> float:
    """RMS distance of the target in held-out profiles, in metres."""
    stacked = estimate.stacked
    lengths = stacked.residuals[stacked.is_length & held_out[stacked.profile]]
    return float(np.sqrt(lengths @ lengths / held_out.sum()))


def as_hand_eye_calibration(
    found: ArmCalibration, names: Sequence[str], arm_model: str, T_b_t: Array | None = None
) -> HandEyeCalibration:
    """The result of a calibration of the arm on a ball, or on points alone.

    Parameters
    ----------
    found : ArmCalibration
        The arm and the sensor.
    names : sequence of str
        Of all profiles, those held out as well.
    arm_model : str
        Name of the arm's kinematics.
    T_b_t : ndarray, shape (4, 4), optional
        Of points alone: where the frame that they count in was about. Its pose is found in place of
        a sensor's, as that of one that is fixed in the room.
    """
    estimate, covariance = found.estimate, found.covariance
    if T_b_t is not None:
        place = np.arange(len(covariance), len(covariance) + 6)
        kept = np.concatenate((place, np.arange(6, len(covariance))))
        covariance = estimate.sigma_scale**2 * estimate.covariance[np.ix_(kept, kept)]
    kinematics = ArmKinematicsEntry(
        model=arm_model,
        deviations=tuple(map(tuple, (estimate.deviations * FILE_UNITS_PER_SI).tolist())),
        covariance=rows_in_file_units(covariance, axes=2),
        left_as_stated=found.undetermined,
        held_out_poses=int(found.held_out.sum()),
        held_out_before_mm=1e3 * found.error_before,
        held_out_after_mm=1e3 * found.error_after,
    )
    return HandEyeCalibration(
        estimate.T_f_s if T_b_t is None else boxplus(T_b_t, np.array(estimate.target[:6])),
        covariance,
        f"{'ball' if T_b_t is None else 'points'}, with the arm's kinematics",
        _residuals_of_profiles(found, names),
        scaled_condition(covariance[:6, :6]),
        estimate.chi2,
        estimate.dof,
        estimate.sigma_scale,
        centre_b=None if T_b_t is not None else estimate.target[:3],
        radius=None if T_b_t is not None else float(estimate.target[3]),
        sensor_is_fixed=T_b_t is not None,
        by_laser=found.by_laser,
        kinematics=kinematics,
    )


def _residuals_of_profiles(
    found: ArmCalibration, names: Sequence[str]
) -> tuple[SampleResidual, ...]:
    stacked, used = found.estimate.stacked, found.estimate.used
    falls, steps = leave_one_profile_out(found.estimate)
    residuals = []
    for i in map(int, np.flatnonzero(~found.held_out)):
        own = stacked.profile == i
        off = float(np.linalg.norm(stacked.residuals[own & stacked.is_length]))
        misfit = np.sqrt(falls[i] / own.sum())
        residuals.append(
            SampleResidual.from_changes(names[i], used[i], (off, None), misfit, steps[i])
        )
    return tuple(residuals)
