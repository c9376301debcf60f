"""Hand-eye calibration: the laser's pose on the flange and its uncertainty, or a refusal."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from scipy.special import stdtrit

from tjscan.calibration import checks
from tjscan.calibration.closed_form import rotation_equations, solve_closed_form
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration, MeasuredRadius
from tjscan.calibration.solve.refine import FALSE_ALARM_PROBABILITY, laser_response_of_estimate
from tjscan.calibration.solve.solution import CalibrationProblem, SensorSolution, Targets
from tjscan.calibration.targets.ball import SeenBall, SphereTarget
from tjscan.calibration.targets.line import stack_lines
from tjscan.calibration.targets.plane import PlaneModel, SeenBoard
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array

SENSOR_LINEARITY: Final = 1e-3
"""Share by which lengths in a profile may be off, as data sheets of such sensors state it. A
radius read by the sensor is not known better."""


def calibrate_on_targets(
    targets: Targets,
    noise: NoiseModel,
    *,
    T_f_s_guess: Array | None = None,
    sensor_is_fixed: bool = False,
    check_conventions: bool = False,
    readings: checks.PoseReadings = MappingProxyType({}),
) -> HandEyeCalibration:
    """Calibrate one sensor from profiles of one or several targets, all solved together.

    Parameters
    ----------
    targets : sequence of SeenTarget
        The profiles of each target. Each target stays at its place and has its own unknowns.
    noise : NoiseModel
        Errors of profiles and poses.
    T_f_s_guess : ndarray, shape (4, 4), optional
        About how the sensor sits (on the base, if it is fixed).
    sensor_is_fixed : bool
        The sensor is fixed in the room, and the arm carries the targets.
    check_conventions : bool
        Refuse poses that fit far better when read by another convention, and profiles that fit
        no better than with each other's poses: for poses that were converted by hand.
    readings : mapping, optional
        What the files of these poses mean by other conventions, see `check_pose_convention`.

    Raises
    ------
    CalibrationRefused
        If the result could not be trusted: too few profiles, a missing motion, too many bad
        poses, residuals that the noise model doesn't explain, or a ball of another radius than
        stated.

    Notes
    -----
    Cibicik et al. 2022, appendix, for the closed form. The refinement minimises offset and tilt
    of each line, weighted by their covariance under range noise and the arm's errors, over T_f_s
    and the plane, which its touched points hold in place.
    """
    problem = CalibrationProblem(targets, noise, sensor_is_fixed)
    problem = problem.with_poses(problem.invert_if_fixed(problem.T_b_f))
    T_b_f = problem.T_b_f
    R_guess = None if T_f_s_guess is None else T_f_s_guess[:3, :3]
    touched = next((one.target for one in targets if isinstance(one, SeenBoard)), None)
    starts = problem.starts + ([] if T_f_s_guess is None else [T_f_s_guess])
    try:
        u_b = None if touched is None else touched.plane.u
        checks.check_poses_fix_hand_eye(T_b_f, u_b, R_guess)
    except CalibrationRefused:
        if check_conventions:  # numbers of another unit are poses that hardly differ
            model, rough = problem.fit(starts, 1)
            as_read = SensorSolution(rough, rough, rough, model)
            checks.check_pose_convention(problem, as_read, readings)
        raise
    measured_radius = None
    if any(isinstance(one, SeenBall) for one in targets):
        unstated = [
            replace(one, sphere=SphereTarget()) if isinstance(one, SeenBall) else one
            for one in problem.targets
        ]
        problem_unstated = replace(problem, targets=unstated)
        free = problem_unstated.solve(starts)
        if check_conventions:
            checks.check_pose_convention(problem_unstated, free, readings)
        measured_radius = _check_radius(targets, free)
        starts = [free.estimate.T_f_s]
    solution = problem.solve(starts)
    estimate = solution.estimate
    if check_conventions:
        if measured_radius is None:
            checks.check_pose_convention(problem, solution, readings)
        checks.check_pose_pairing(problem, solution)
    notes = checks.swapped_pose_notes(problem, solution)
    condition, advice = _condition_and_advice(T_b_f, solution, R_guess)
    residuals = checks.sample_residuals(problem.names, estimate, solution.settled)
    excess = checks.check_residuals(estimate, residuals)
    covariance = excess**2 * estimate.covariance
    checks.check_result_certainty(covariance[:6, :6], advice)
    closed_form = None
    if touched is not None and len(targets) == 1:
        closed_form = solve_closed_form(stack_lines(T_b_f, targets[0].fits), touched.plane)
    return HandEyeCalibration(
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
        closed_form=closed_form,
        notes=notes,
        by_laser=laser_response_of_estimate(estimate),
        **_target_fields(solution),
    )


def _check_radius(targets: Targets, solution: SensorSolution) -> MeasuredRadius:
    """The first ball's radius as the profiles show it; refused if it is not the stated one."""
    balls = ((k, one.sphere.radius) for k, one in enumerate(targets) if isinstance(one, SeenBall))
    k, stated = next(balls)
    estimate, at = solution.estimate, solution.model.target_slice(k)
    radius = float(estimate.target[at][3])
    variance = estimate.variance_scale * estimate.covariance[6:, 6:][at, at][3, 3]
    variance += (SENSOR_LINEARITY * radius) ** 2
    sigma = float(np.sqrt(variance))
    # A spread that was itself estimated from few residuals is no sure one: Student's t.
    widened = estimate.dof if estimate.variance_scale > 1 else np.inf
    limit = float(-stdtrit(widened, FALSE_ALARM_PROBABILITY / 2)) * sigma
    if stated is not None and abs(radius - stated) > limit:
        raise CalibrationRefused(
            "a ball of another radius than stated",
            f"the arcs show a radius of {1e3 * radius:.2f} mm, certain to "
            f"{1e3 * sigma:.2f} mm, and {1e3 * stated:.2f} mm is stated; measure the ball "
            "with a caliper (a radius is half a diameter), and check that the sensor's lengths "
            "are right",
        )
    return MeasuredRadius(radius, sigma, stated)


def _condition_and_advice(
    T_b_f: Array, solution: SensorSolution, R_guess: Array | None
) -> tuple[float, str]:
    """Condition number, and what makes the sensor's pose more certain.

    Raises
    ------
    CalibrationRefused
        If tilts that are all alike leave the height of an unknown plane open.
    """
    estimate, models = solution.estimate, solution.model.models
    first = models[0]
    if len(models) > 1 or not isinstance(first, PlaneModel):
        advice = "see the target from more directions and at different heights"
        return checks.scaled_condition(estimate.covariance[:6, :6]), advice
    plane, R = first.target.boxplus(estimate.target), estimate.T_f_s[:3, :3]
    u_f = plane.u @ T_b_f[estimate.used, :3, :3]
    if not first.target.is_place_known:
        checks.check_tilts_vary(u_f, R)
    equations = rotation_equations(first.lines, plane.u)[estimate.used]
    condition = checks.rotation_condition(equations)
    return condition, checks.advise_further_tilts(condition, u_f, R, R_guess)


def _target_fields(solution: SensorSolution) -> dict[str, Any]:
    """Fields of the result that hold the targets; of several of a kind, the first."""
    found: dict[str, Any] = {}
    for k, model in reversed(list(enumerate(solution.model.models))):
        at, settled = solution.model.target_slice(k), solution.settled
        found |= model.result_fields(settled.target[at], settled.covariance[6:, 6:][at, at])
    return found
