"""Hand-eye calibration: where the laser sits on the flange, how sure that is, or a refusal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.special import ndtri

from tjscan.calibration.checks.acceptance import (
    check_certainty,
    check_scaled_condition,
    residual_excess,
    sample_residuals,
)
from tjscan.calibration.checks.evidence import check_pairing, check_pose_convention, swapped_pairs
from tjscan.calibration.checks.motion import (
    check_motion,
    check_rotation_condition,
    check_tilts_vary,
)
from tjscan.calibration.fits.laser_error import estimate_by_laser
from tjscan.calibration.fits.line_bundle import stack_lines
from tjscan.calibration.fits.samples import ArcSample, LineSample, RoofSample
from tjscan.calibration.models.plane import PlaneModel
from tjscan.calibration.models.roof import RoofModel
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration, MeasuredRadius
from tjscan.calibration.solve.closed_form import rotation_equations, solve_closed_form
from tjscan.calibration.solve.refine import RefinedEstimate
from tjscan.calibration.solve.seen import SeenBall, SeenBoard, SeenRoof, SeenTarget
from tjscan.calibration.solve.solution import Solution, solve_targets, stack_poses, with_poses
from tjscan.calibration.targets import PlaneTarget, RoofTarget, SphereTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose, readonly_copy

RADIUS_FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to refuse a ball whose radius is as stated."""
SENSOR_LINEARITY: Final = 1e-3
"""Share by which lengths in a profile may be off: what data sheets of such sensors allow. A
radius read by the sensor is not known better."""


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
    check_conventions: bool = False,
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
    check_conventions : bool
        Refuse poses that fit far better when read by another convention, and profiles that fit
        no better than with each other's poses: for poses that were converted by somebody.

    Raises
    ------
    CalibrationRefused
        If the result could not be trusted: too few profiles, a missing motion, too many bad
        poses, residuals that the noise model doesn't explain, or a ball of another radius than
        stated.
    """
    if sensor_is_fixed:
        targets = with_poses(targets, np.stack([inverse_pose(T) for T in stack_poses(targets)]))
    T_b_f = stack_poses(targets)
    R_guess = None if T_f_s_guess is None else T_f_s_guess[:3, :3]
    touched = next((one.target for one in targets if isinstance(one, SeenBoard)), None)
    check_motion(T_b_f, None if touched is None else touched.plane.u, R_guess)
    starts = [T for one in targets for T in one.starts()]
    if T_f_s_guess is not None:
        starts.append(T_f_s_guess)
    measured_radius = None
    if any(isinstance(one, SeenBall) for one in targets):
        free = solve_targets(_with_free_radius(targets), noise, starts, sensor_is_fixed)
        measured_radius = _check_radius(targets, free)
        starts = [free.estimate.T_f_s]
    solution = solve_targets(targets, noise, starts, sensor_is_fixed)
    estimate = solution.estimate
    if check_conventions:
        check_pose_convention(targets, noise, solution, sensor_is_fixed)
        check_pairing(targets, noise, solution, sensor_is_fixed)
    notes = swapped_pairs(targets, noise, solution, sensor_is_fixed)
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
        notes=notes,
        by_laser=_by_laser(estimate),
    )
    for k, one in reversed(list(enumerate(targets))):
        result = _with_target(result, one, solution, k)
    return result


def _by_laser(estimate: RefinedEstimate) -> Array | None:
    stacked, rows = estimate.stacked, estimate.rows_used
    if stacked.by_laser is None:
        return None
    return estimate_by_laser(
        estimate.covariance,
        stacked.jacobian[rows],
        stacked.covariance[np.ix_(rows, rows)],
        stacked.by_laser[rows],
    )


def _with_free_radius(
    targets: Sequence[SeenBoard | SeenBall | SeenRoof],
) -> list[SeenBoard | SeenBall | SeenRoof]:
    return [
        replace(one, sphere=SphereTarget()) if isinstance(one, SeenBall) else one for one in targets
    ]


def _check_radius(
    targets: Sequence[SeenBoard | SeenBall | SeenRoof], solution: Solution
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
    targets: Sequence[SeenBoard | SeenBall | SeenRoof], solution: Solution, R_guess: Array | None
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
    result: HandEyeCalibration, seen: SeenTarget, solution: Solution, k: int
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
