"""Hand-eye calibration: where the laser sits on the flange, how sure that is, or a refusal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import ndtri

from tjscan.calibration.acceptance import (
    check_certainty,
    check_scaled_condition,
    residual_excess,
    sample_residuals,
)
from tjscan.calibration.arm_error import geometry_correlation
from tjscan.calibration.closed_form import rotation_equations, solve_closed_form, stack_lines
from tjscan.calibration.combined import CombinedModel
from tjscan.calibration.fixed_sensor import FixedSensorModel, inverse_pose_errors
from tjscan.calibration.model import TargetModel
from tjscan.calibration.motion import check_motion, check_rotation_condition, check_tilts_vary
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.plane_model import PlaneModel
from tjscan.calibration.refine import RefinedEstimate, refine_by_least_squares, settle_targets
from tjscan.calibration.result import HandEyeCalibration, MeasuredRadius
from tjscan.calibration.roof_model import RoofModel
from tjscan.calibration.samples import ArcSample, LineSample, RoofSample
from tjscan.calibration.seen import SeenBall, SeenBoard, SeenRoof, SeenTarget
from tjscan.calibration.snooping import reject_outlying_profiles
from tjscan.calibration.targets import PlaneTarget, RoofTarget, SphereTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose, readonly_copy

MIN_LINES: Final = 5
"""Eq. (20) needs five lines in general position."""
CONFIRMED: Final = 2
"""Starts that lead to the same best place before no more are tried."""
SAME_CHI2: Final = 0.01
"""Sums of squares nearer than this belong to the same place."""
RADIUS_FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to refuse a ball whose radius is as stated."""
SENSOR_LINEARITY: Final = 1e-3
"""Share by which lengths in a profile may be off: what data sheets of such sensors allow. A
radius read by the sensor is not known better."""


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    """The estimate from several targets, the same settled, and the model of each target."""

    estimate: RefinedEstimate
    settled: RefinedEstimate
    models: tuple[TargetModel, ...]

    def part(self, k: int) -> slice:
        """Where the parameters of target k stand behind the six of the sensor."""
        ends = np.cumsum([0] + [len(model.prior_information) for model in self.models])
        return slice(int(ends[k]), int(ends[k + 1]))


def calibrate_on_plane(
    samples: Sequence[LineSample],
    target: PlaneTarget | None,
    noise: NoiseModel,
    *,
    T_f_s_guess: Array | None = None,
) -> HandEyeCalibration:
    """Calibrate the sensor's pose on the flange from lines on one plane.

    Parameters
    ----------
    samples : sequence of LineSample
        Five lines or more.
    target : PlaneTarget or None
        The plane as touched, see `fit_plane`; none where it is to be found together with the
        sensor.
    noise : NoiseModel
        What lines and poses err by.
    T_f_s_guess : ndarray, shape (4, 4), optional
        About how the sensor sits, for instance from the bracket's drawing. Not needed; it lets
        refusals name the sensor's axes, and is one more start for an unknown plane.

    Raises
    ------
    CalibrationRefused
        If the result could not be trusted: too few lines, a missing motion, too many bad poses,
        or residuals that the noise model doesn't explain.

    Notes
    -----
    Cibicik et al. 2022, appendix, for the closed form. The refinement minimises offset and tilt
    of each line, weighed by their covariance under range noise and the arm's errors, over T_f_s
    and the plane, which its touched points hold in place.
    """
    return calibrate_on_targets([SeenBoard(samples, target, noise)], noise, T_f_s_guess=T_f_s_guess)


def calibrate_on_sphere(
    samples: Sequence[ArcSample],
    sphere: SphereTarget,
    noise: NoiseModel,
    *,
    T_f_s_guess: Array | None = None,
) -> HandEyeCalibration:
    """Calibrate the sensor's pose on the flange from arcs on one ball that stays where it is.

    Parameters
    ----------
    samples : sequence of ArcSample
        Five arcs or more, at different heights of the ball.
    sphere : SphereTarget
        The ball; where it lies is found together with the sensor.
    noise : NoiseModel
        What arcs and poses err by.
    T_f_s_guess : ndarray, shape (4, 4), optional
        About how the sensor sits.

    Raises
    ------
    CalibrationRefused
        As `calibrate_on_targets` does.
    """
    return calibrate_on_targets([SeenBall(samples, sphere, noise)], noise, T_f_s_guess=T_f_s_guess)


def calibrate_on_roof(
    samples: Sequence[RoofSample], noise: NoiseModel, *, T_f_s_guess: Array | None = None
) -> HandEyeCalibration:
    """Calibrate the sensor's pose on the flange from profiles of a roof edge.

    Parameters
    ----------
    samples : sequence of RoofSample
        Five profiles or more.
    noise : NoiseModel
        What lines and poses err by.
    T_f_s_guess : ndarray, shape (4, 4), optional
        About how the sensor sits.

    Raises
    ------
    CalibrationRefused
        As `calibrate_on_targets` does.
    """
    return calibrate_on_targets([SeenRoof(samples, noise)], noise, T_f_s_guess=T_f_s_guess)


def calibrate_on_targets(
    targets: Sequence[SeenBoard | SeenBall | SeenRoof],
    noise: NoiseModel,
    *,
    T_f_s_guess: Array | None = None,
    sensor_is_fixed: bool = False,
) -> HandEyeCalibration:
    """Calibrate one sensor from profiles of one or several targets, all solved together.

    Parameters
    ----------
    targets : sequence of SeenBoard, SeenBall or SeenRoof
        The profiles of each target. Targets stay where they are; each has unknowns of its own.
    noise : NoiseModel
        What profiles and poses err by.
    T_f_s_guess : ndarray, shape (4, 4), optional
        About how the sensor sits (on the base, where it is fixed).
    sensor_is_fixed : bool
        The sensor stands fixed in the room, and the arm carries the targets.

    Raises
    ------
    CalibrationRefused
        If the result could not be trusted: too few profiles, a missing motion, too many bad
        poses, residuals that the noise model doesn't explain, or a ball of another radius than
        stated.
    """
    if sensor_is_fixed:
        targets = [one.with_inverse_poses() for one in targets]
    T_b_f = _poses(targets)
    R_guess = None if T_f_s_guess is None else T_f_s_guess[:3, :3]
    touched = next((one.target for one in targets if isinstance(one, SeenBoard)), None)
    check_motion(T_b_f, None if touched is None else touched.plane.u, R_guess)
    starts = [T for one in targets for T in one.starts()]
    if T_f_s_guess is not None:
        starts.append(T_f_s_guess)
    measured_radius = None
    if any(isinstance(one, SeenBall) for one in targets):
        free = _solve(_with_free_radius(targets), noise, starts, sensor_is_fixed)
        measured_radius = _check_radius(targets, free)
        starts = [free.estimate.T_f_s]
    solution = _solve(targets, noise, starts, sensor_is_fixed)
    estimate = solution.estimate
    condition = _check_geometry(targets, solution, R_guess)
    names = [name for one in targets for name in one.names]
    residuals = sample_residuals(names, estimate, solution.settled)
    excess = residual_excess(estimate, residuals)
    covariance = excess**2 * estimate.covariance
    check_certainty(covariance[:6, :6])
    result = HandEyeCalibration(
        estimate.T_f_s,
        covariance,
        " and ".join(one.kind for one in targets),
        residuals,
        condition,
        estimate.chi2,
        estimate.dof,
        excess,
        measured_radius=measured_radius,
        geometry=estimate.geometry,
        sensor_is_fixed=sensor_is_fixed,
    )
    for k, one in reversed(list(enumerate(targets))):
        result = _with_target(result, one, solution, k)
    return result


def _poses(targets: Sequence[SeenTarget]) -> Array:
    count = sum(len(one.names) for one in targets)
    if count < MIN_LINES:
        raise CalibrationRefused(
            "too few lines",
            f"{count} were taken, at least {MIN_LINES} are needed and twelve are good; take "
            "more, each with another tilt of the sensor",
        )
    return np.concatenate([one.T_b_f for one in targets if one.names])


def _solve(
    targets: Sequence[SeenTarget], noise: NoiseModel, begin: list[Array], sensor_is_fixed: bool
) -> _Solution:
    """The best of many starts, without the profiles that contradict the others."""
    T_b_f = _poses(targets)
    true_poses = np.stack([inverse_pose(T) for T in T_b_f]) if sensor_is_fixed else T_b_f
    correlation = geometry_correlation(true_poses)
    every = np.ones(len(T_b_f), dtype=bool)
    starts = []
    for T_f_s in begin:
        begun = [one.start_at(T_f_s) for one in targets]
        models = [start.model for start in begun]
        if sensor_is_fixed:
            ends = np.cumsum([len(one.names) for one in targets])[:-1]
            errors = np.split(inverse_pose_errors(true_poses), ends)
            models = [FixedSensorModel(m, e) for m, e in zip(models, errors, strict=True)]
        combined = CombinedModel(tuple(models), correlation, noise.geometry)
        target = np.concatenate([start.target for start in begun])
        starts.append((combined.misfit(T_f_s, target), T_f_s, target, begun, combined))
    starts.sort(key=lambda start: start[0])
    found = []
    for _, T_f_s, target, begun, combined in starts:
        estimate = refine_by_least_squares(combined, T_f_s, target, every)
        solution = _Solution(estimate, estimate, tuple(start.model for start in begun))
        behind = not sensor_is_fixed and any(
            one.is_behind(start, estimate.T_f_s, estimate.target[solution.part(k)])
            for k, (one, start) in enumerate(zip(targets, begun, strict=True))
        )
        found.append((behind, estimate.chi2, combined, solution))
        lowest = min(found, key=lambda one: one[:2])
        if (
            sum(one[0] == lowest[0] and one[1] < lowest[1] + SAME_CHI2 for one in found)
            == CONFIRMED
        ):
            break
    _, _, combined, best = min(found, key=lambda one: one[:2])
    final = reject_outlying_profiles(combined, best.estimate, noise.geometry)
    return replace(best, estimate=final, settled=settle_targets(combined, final))


def _with_free_radius(
    targets: Sequence[SeenBoard | SeenBall | SeenRoof],
) -> list[SeenBoard | SeenBall | SeenRoof]:
    return [
        replace(one, sphere=SphereTarget()) if isinstance(one, SeenBall) else one for one in targets
    ]


def _check_radius(
    targets: Sequence[SeenBoard | SeenBall | SeenRoof], solution: _Solution
) -> MeasuredRadius:
    """The first ball's radius as the profiles show it; refused where it is not the stated one."""
    k = next(k for k, one in enumerate(targets) if isinstance(one, SeenBall))
    ball = targets[k]
    stated = ball.sphere.radius if isinstance(ball, SeenBall) else None
    estimate, at = solution.estimate, solution.part(k)
    radius = float(estimate.target[at][3])
    excess = max(1.0, estimate.chi2 / max(estimate.dof, 1))
    variance = excess * estimate.covariance[6:, 6:][at, at][3, 3] + (SENSOR_LINEARITY * radius) ** 2
    measured = MeasuredRadius(radius, float(np.sqrt(variance)), stated)
    if stated is None:
        return measured
    limit = float(-ndtri(RADIUS_FALSE_ALARM_PROBABILITY / 2)) * measured.sigma
    if abs(radius - stated) > limit:
        raise CalibrationRefused(
            "a ball of another radius than stated",
            f"the arcs show a radius of {1e3 * radius:.2f} mm, certain to "
            f"{1e3 * measured.sigma:.2f} mm, and {1e3 * stated:.2f} mm is stated; measure the ball "
            "with a caliper (a radius is half a diameter), and check that the sensor's lengths "
            "are right",
        )
    return measured


def _check_geometry(
    targets: Sequence[SeenBoard | SeenBall | SeenRoof], solution: _Solution, R_guess: Array | None
) -> float:
    """Condition number; refuses profiles that leave the sensor's pose open."""
    estimate, first = solution.estimate, solution.models[0]
    if len(targets) > 1 or not isinstance(first, PlaneModel):
        return check_scaled_condition(estimate)
    plane = first.target.boxplus(estimate.target)
    u_f = plane.u @ targets[0].T_b_f[estimate.used, :3, :3]
    equations = rotation_equations(first.lines, plane.u)[estimate.used]
    condition = check_rotation_condition(equations, u_f, estimate.T_f_s[:3, :3], R_guess)
    if not first.target.was_touched:
        check_tilts_vary(u_f, estimate.T_f_s[:3, :3])
    return condition


def _with_target(
    result: HandEyeCalibration, seen: SeenTarget, solution: _Solution, k: int
) -> HandEyeCalibration:
    """The result with where one target came out."""
    estimate, model = solution.settled, solution.models[k]
    at = solution.part(k)
    target, covariance = estimate.target[at], estimate.covariance[6:, 6:][at, at]
    if isinstance(seen, SeenBoard) and isinstance(model, PlaneModel):
        closed = None
        if seen.target is not None and len(solution.models) == 1:
            closed = solve_closed_form(stack_lines(seen.T_b_f, seen.fits), seen.target.plane)
        return replace(result, board=_plane_found(model, target, covariance), closed_form=closed)
    if isinstance(model, RoofModel):
        roof = RoofTarget(
            _plane_found(model.left, target[:3], covariance[:3, :3]),
            _plane_found(model.right, target[3:], covariance[3:, 3:]),
        )
        return replace(result, roof=roof)
    if isinstance(seen, SeenBall):
        radius = (seen.sphere.radius or 0.0) + float(target[3])
        return replace(result, centre_b=readonly_copy(target[:3]), radius=radius)
    return result


def _plane_found(model: PlaneModel, step: Array, covariance: Array) -> PlaneTarget:
    """A plane as it came out, with its own certainty."""
    return replace(
        model.target,
        plane=model.target.boxplus(step),
        information=np.asarray(np.linalg.inv(covariance)),
    )
