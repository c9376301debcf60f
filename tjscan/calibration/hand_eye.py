"""Hand-eye calibration: where the laser sits on the flange, how sure that is, or a refusal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tjscan.calibration.circle_fit import CircleFit
from tjscan.calibration.closed_form import (
    ClosedFormSolution,
    rotation_equations,
    sensor_on_flange_side_share,
    solve_closed_form,
    stack_lines,
)
from tjscan.calibration.design import HandEyeUncertainty
from tjscan.calibration.line_fit import LineFit
from tjscan.calibration.motion import (
    MAX_CONDITION,
    check_motion,
    check_rotation_condition,
    check_tilts_vary,
)
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.plane_model import PlaneModel
from tjscan.calibration.plucker import PluckerPlane
from tjscan.calibration.refine import (
    RefinedEstimate,
    leave_one_out_changes,
    refine_by_least_squares,
)
from tjscan.calibration.snooping import chi2_is_plausible, reject_outlying_profiles
from tjscan.calibration.sphere_model import SphereModel
from tjscan.calibration.starts import (
    plane_calibration_starts,
    sphere_calibration_starts,
    sphere_start_parameters,
)
from tjscan.calibration.targets import PlaneTarget, SphereTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, readonly_copy, transform_points

MIN_LINES: Final = 5
"""Eq. (20) needs five lines in general position."""
MAX_SIGMA_SCALE: Final = 3.0
"""Residuals so many times larger than stated are not what the noise model describes. Smaller
excess, where it is significant, widens the covariance."""
MAX_SIGMA_SCALE_AFTER_REJECTION: Final = 2.0
"""The same limit where profiles were left out: without the worst ones the others look better than
they are, and which ones are bad is itself in doubt."""
MAX_SIGMA_POSITION: Final = 5e-3
MAX_SIGMA_ROTATION: Final = float(np.radians(1.0))
"""Metres and radians RMS; a drawing of the bracket is better than a calibration less certain."""
TARGET_SIGMA_POSITION: Final = 0.5e-3
TARGET_SIGMA_ROTATION: Final = float(np.radians(0.1))
"""Metres and radians RMS; what a weld groove is to be measured to."""
REFINED_STARTS: Final = 12
"""Starts refined for an unknown plane."""


@dataclass(frozen=True, slots=True, eq=False)
class LineSample:
    """A line fitted to a profile of the board, and the flange pose it was taken from.

    Parameters
    ----------
    name : str
        What reports call it.
    T_b_f : ndarray, shape (4, 4)
        Flange pose, as the arm read it.
    fit : LineFit
        The line, frame s.
    """

    name: str
    T_b_f: Array
    fit: LineFit

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_b_f", readonly_copy(self.T_b_f))


@dataclass(frozen=True, slots=True, eq=False)
class ArcSample:
    """A circle fitted to a profile of the ball, and the flange pose; see `LineSample`."""

    name: str
    T_b_f: Array
    fit: CircleFit

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_b_f", readonly_copy(self.T_b_f))


@dataclass(frozen=True, slots=True)
class SampleResidual:
    """How far one line is off the result, and how much the result would change without it.

    Parameters
    ----------
    name : str
        Of the sample.
    used : bool
        False for a bad pose: the result does without it.
    offset : float
        Distance of the line's centroid from the plane, in metres; of an arc, the distance of
        the ball's centre from where it should be, in the laser plane.
    tilt : float or None
        Angle of the line out of the plane, in radians; none for an arc.
    misfit : float
        Both together, against what the noise model lets one expect, in standard deviations
        (RMS per residual); about one for a good line.
    shift : float
        Metres by which the sensor's position would move without this line.
    turn : float
        Radians by which its rotation would.
    """

    name: str
    used: bool
    offset: float
    tilt: float | None
    misfit: float
    shift: float
    turn: float


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeCalibration:
    """Result of a calibration: the sensor's pose on the flange, its covariance and residuals.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange.
    joint_covariance : ndarray, shape (6 + m, 6 + m)
        Of its translation (metres), a small rotation on top of it (radians), both in the axes of
        f, and the target's parameters; widened by `sigma_scale` squared.
    method : str
        What it rests on: ``plane touched``, ``plane unknown``, ``sphere of known radius`` or
        ``sphere of unknown radius``.
    residuals : tuple of SampleResidual
        One per sample, in their order.
    condition : float
        Of eq. (21), first over fifth singular value; for a sphere, of the scaled normal
        equations.
    chi2, dof : float, int
        Weighted sum of squares that is left, and its expectation under the noise model.
    sigma_scale : float
        By how much residuals are larger than stated, where that is significant; else one.
    board : PlaneTarget or None
        The board, frame b, as it came out; none for a sphere.
    centre_b : ndarray, shape (3,), or None
        The ball's centre; none for a plane.
    radius : float or None
        The ball's radius; none for a plane.
    closed_form : ClosedFormSolution or None
        What eq. (20)-(25) gave, with all lines; none without a touched plane.
    """

    T_f_s: Array
    joint_covariance: Array
    method: str
    residuals: tuple[SampleResidual, ...]
    condition: float
    chi2: float
    dof: int
    sigma_scale: float
    board: PlaneTarget | None = None
    centre_b: Array | None = None
    radius: float | None = None
    closed_form: ClosedFormSolution | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_f_s", readonly_copy(self.T_f_s))
        object.__setattr__(self, "joint_covariance", readonly_copy(self.joint_covariance))

    @property
    def covariance(self) -> Array:
        """Covariance of T_f_s, shape (6, 6): translation and small rotation in the axes of f."""
        return self.joint_covariance[:6, :6]

    @property
    def uncertainty(self) -> HandEyeUncertainty:
        """How far T_f_s is expected to be off, position and rotation."""
        return HandEyeUncertainty(self.covariance)

    @property
    def rejected_sample_names(self) -> tuple[str, ...]:
        """Names of the samples that contradict the others; the result does without them."""
        return tuple(r.name for r in self.residuals if not r.used)

    @property
    def caveats(self) -> tuple[str, ...]:
        """Warnings to a user before relying on the calibration; empty for a good one."""
        said = []
        if self.rejected_sample_names:
            said.append(
                f"left out as contradicting the others: {', '.join(self.rejected_sample_names)}"
            )
        if self.sigma_scale > 1:
            said.append(
                f"residuals are {self.sigma_scale:.1f} times larger than stated; the uncertainty "
                "has been widened by as much"
            )
        sure = self.uncertainty
        if sure.position > TARGET_SIGMA_POSITION or sure.rotation > TARGET_SIGMA_ROTATION:
            said.append(
                f"the sensor's place is certain to {1e3 * sure.position:.2f} mm and "
                f"{np.degrees(sure.rotation):.2f}° only; add lines that are tilted further"
            )
        return tuple(said)


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
    of each line, weighed by their covariance under range noise and pose noise, over T_f_s and
    the plane, which its touched points hold in place.
    """
    T_b_f = _poses(samples)
    fits = [sample.fit for sample in samples]
    R_guess = None if T_f_s_guess is None else T_f_s_guess[:3, :3]
    check_motion(T_b_f, None if target is None else target.plane.u, R_guess)
    closed = None
    if target is None:
        target, T_f_s = _find_plane(T_b_f, fits, noise, T_f_s_guess)
    else:
        closed = solve_closed_form(stack_lines(T_b_f, fits), target.plane)
        T_f_s = closed.T_f_s
    model = PlaneModel.from_line_fits(T_b_f, fits, target, noise)
    every = np.ones(len(fits), dtype=bool)
    estimate = reject_outlying_profiles(
        model, refine_by_least_squares(model, T_f_s, np.zeros(3), every)
    )

    plane = target.boxplus(estimate.target)
    used = estimate.used
    condition = check_rotation_condition(
        rotation_equations(model.lines, plane.u)[used],
        plane.u @ T_b_f[used, :3, :3],
        estimate.T_f_s[:3, :3],
        R_guess,
    )
    if not target.was_touched:
        check_tilts_vary(plane.u @ T_b_f[estimate.used, :3, :3], estimate.T_f_s[:3, :3])
    method = "plane touched" if target.was_touched else "plane unknown"
    board = replace(
        target, plane=plane, information=np.asarray(np.linalg.inv(estimate.covariance[6:, 6:]))
    )
    return _accept(samples, estimate, method, condition, board=board, closed_form=closed)


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
        As `calibrate_on_plane` does.
    """
    T_b_f = _poses(samples)
    check_motion(T_b_f, None, None if T_f_s_guess is None else T_f_s_guess[:3, :3])
    model = SphereModel.from_arc_fits(T_b_f, [sample.fit for sample in samples], sphere, noise)
    starts = sphere_calibration_starts(model)
    if T_f_s_guess is not None:
        centres = [
            transform_points(T @ T_f_s_guess, c)
            for T, c in zip(T_b_f, model.centres_s, strict=True)
        ]
        starts.append((T_f_s_guess, sphere_start_parameters(model, np.mean(centres, axis=0))))
    every = np.ones(len(samples), dtype=bool)
    estimate = min(
        (refine_by_least_squares(model, *start, every) for start in starts), key=lambda e: e.chi2
    )
    estimate = reject_outlying_profiles(model, estimate)
    condition = _scaled_condition(estimate)
    if condition > MAX_CONDITION:
        raise CalibrationRefused(
            "ill-conditioned",
            f"the condition number is {condition:.0f}, the limit {MAX_CONDITION:.0f}; see the "
            "ball from more directions and at different heights",
        )
    known = sphere.radius is not None
    method = "sphere of known radius" if known else "sphere of unknown radius"
    radius = sphere.radius if sphere.radius is not None else float(estimate.target[3])
    centre = readonly_copy(estimate.target[:3])
    return _accept(samples, estimate, method, condition, centre_b=centre, radius=radius)


def _poses(samples: Sequence[LineSample] | Sequence[ArcSample]) -> Array:
    if len(samples) < MIN_LINES:
        raise CalibrationRefused(
            "too few lines",
            f"{len(samples)} were taken, at least {MIN_LINES} are needed and twelve are good; take "
            "more, each with another tilt of the sensor",
        )
    return np.stack([sample.T_b_f for sample in samples])


def _find_plane(
    T_b_f: Array, fits: list[LineFit], noise: NoiseModel, guess: Array | None
) -> tuple[PlaneTarget, Array]:
    """Plane and sensor that fit the lines best, from many starts."""
    lines = stack_lines(T_b_f, fits)
    starts = plane_calibration_starts(lines, REFINED_STARTS)
    if guess is not None:
        points = np.stack(
            [transform_points(T, p) for T, p in zip(T_b_f @ guess, lines.points_s, strict=True)]
        )
        centre = points.mean(axis=0)
        u = np.linalg.svd(points - centre)[2][2]
        starts.append((guess, PluckerPlane(u, -float(u @ centre))))
    every = np.ones(len(fits), dtype=bool)
    found = []
    for T_f_s, plane in starts:
        near = (T_b_f[0] @ T_f_s @ np.append(lines.points_s[0], 1.0))[:3]
        target = PlaneTarget.unknown_plane(plane, near)
        estimate = refine_by_least_squares(
            PlaneModel.from_line_fits(T_b_f, fits, target, noise), T_f_s, np.zeros(3), every
        )
        behind = (
            sensor_on_flange_side_share(
                lines, target.boxplus(estimate.target), estimate.T_f_s[:3, 3]
            )
            < 0.5
        )
        found.append((behind, estimate.chi2, target, estimate))
    _, _, target, estimate = min(found, key=lambda one: one[:2])
    near = (T_b_f[0] @ estimate.T_f_s @ np.append(lines.points_s[0], 1.0))[:3]
    plane = target.boxplus(estimate.target)
    if plane.signed_distances(T_b_f[0, :3, 3]) < 0:  # the normal points to the sensor's side
        plane = PluckerPlane(-plane.u, -plane.u0)
    return PlaneTarget.unknown_plane(plane, near), estimate.T_f_s


def _scaled_condition(estimate: RefinedEstimate) -> float:
    """Of the pose's normal equations, each parameter in units of its own certainty."""
    covariance = estimate.covariance[:6, :6]
    sigma = np.sqrt(np.diag(covariance))
    values = np.linalg.eigvalsh(covariance / np.outer(sigma, sigma))
    return float(np.sqrt(values[-1] / max(values[0], 1e-300)))


def _accept(
    samples: Sequence[LineSample] | Sequence[ArcSample],
    estimate: RefinedEstimate,
    method: str,
    condition: float,
    *,
    board: PlaneTarget | None = None,
    centre_b: Array | None = None,
    radius: float | None = None,
    closed_form: ClosedFormSolution | None = None,
) -> HandEyeCalibration:
    """The result; refused where it is too uncertain or its residuals are too large."""
    residuals = _residuals([sample.name for sample in samples], estimate)
    sigma_scale = _sigma_scale(estimate, residuals)
    covariance = sigma_scale**2 * estimate.covariance
    sure = HandEyeUncertainty(covariance[:6, :6])
    if sure.position > MAX_SIGMA_POSITION or sure.rotation > MAX_SIGMA_ROTATION:
        raise CalibrationRefused(
            "too uncertain",
            f"the sensor's place is certain to {1e3 * sure.position:.2f} mm and "
            f"{np.degrees(sure.rotation):.2f}° only; take more lines, tilted further, and turned "
            "about the board's normal",
        )
    return HandEyeCalibration(
        estimate.T_f_s,
        covariance,
        method,
        residuals,
        condition,
        estimate.chi2,
        estimate.dof,
        sigma_scale,
        board,
        centre_b,
        radius,
        closed_form,
    )


def _residuals(names: list[str], estimate: RefinedEstimate) -> tuple[SampleResidual, ...]:
    deletion = leave_one_out_changes(estimate)
    r = estimate.linearised.residuals
    arcs = r.shape[1] == 3
    offset = np.hypot(r[:, 0], r[:, 1]) if arcs else r[:, 0]
    misfit = np.sqrt(deletion.chi2 / r.shape[1])
    return tuple(
        SampleResidual(
            names[i],
            bool(estimate.used[i]),
            float(offset[i]),
            None if arcs else float(r[i, 1]),
            float(misfit[i]),
            float(np.linalg.norm(deletion.step[i, :3])),
            float(np.linalg.norm(deletion.step[i, 3:])),
        )
        for i in range(len(names))
    )


def _sigma_scale(estimate: RefinedEstimate, residuals: tuple[SampleResidual, ...]) -> float:
    """By how much residuals exceed the noise model: one unless that is significant."""
    if chi2_is_plausible(estimate):
        return 1.0
    sigma_scale = float(np.sqrt(estimate.chi2 / estimate.dof))
    if sigma_scale <= (MAX_SIGMA_SCALE if estimate.used.all() else MAX_SIGMA_SCALE_AFTER_REJECTION):
        return sigma_scale
    worst = sorted(residuals, key=lambda one: -one.misfit)[:3]
    shown = ", ".join(
        f"{one.name} ({1e3 * one.offset:+.2f} mm"
        + ("" if one.tilt is None else f", {np.degrees(one.tilt):+.2f}°")
        + ")"
        for one in worst
    )
    raise CalibrationRefused(
        "residuals that the noise model can't explain",
        f"they are {sigma_scale:.1f} times larger than stated range and pose noise allow; worst "
        f"are {shown}. Check the sensor's own calibration, that board and sensor sit tight and "
        "that each line belongs to its pose; or state the noise that this cell really has",
    )
