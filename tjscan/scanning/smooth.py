"""The fifth predictor: the section that a laser plane will cut out of the seam of two tubes."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, sqrt
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import SetPointTooFar, TubesNotFound
from tjscan.core.frames import Array, cross, inverse_pose, pose, unit_vector
from tjscan.core.gaussian_process import Matern52, OrdinaryKriging
from tjscan.scanning import seam_fit, target
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import Sections, SetPoint, SetPointPredictor, StepRequest
from tjscan.scanning.sections_before import check_set_point

_DIFFERENCE_STEP: Final = 1e-6


class ExpectedSection:
    """Model of the next section, with which the predictor solves for its place.

    A section is given by its origin in b (metres) and the angles of wall and leg in the laser
    plane (radians), shape (5,).

    Parameters
    ----------
    track : RecentSections
        The sections so far.
    seam : LocalTubeFit
        The tubes that fit them.
    T_b_g : ndarray, shape (4, 4)
        Frame g of the last section, metres.
    step : float
        Distance of the origins, d_st, metres.
    """

    def __init__(
        self, track: seam_fit.RecentSections, seam: seam_fit.LocalTubeFit, T_b_g: Array, step: float
    ) -> None:
        self._track, self._seam, self._T_b_g, self._step = track, seam, T_b_g, step
        at = np.array([step])
        kernels = (
            Matern52(spread, seam_fit.SECTION_SHAPE_WAVELENGTH)
            for spread in seam_fit.SECTION_SHAPE_SIGMAS
        )
        rows = zip(track.shape.T, track.shape_sigmas.T, kernels, strict=True)
        shape = [np.concatenate(OrdinaryKriging(track.along, *row).predict(at)) for row in rows]
        # Distances of p2 and p4 from the origin along their tangents (metres), opening (radians).
        self._shape, self._shape_sigmas = np.array(shape).T
        # Of p2, p4 and both tangents: what the tubes leave.
        left = (values[[0, 1, 4, 5]] for values in seam.expected_residuals_at(step))
        self._residuals, self._residual_sigmas, self._residual_jacobian = left

    def initial_section(self, R_b_s: Array) -> Array:
        """A section straight on along the seam, shape (5,), to start from.

        Parameters
        ----------
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        track = self._track
        forward = track.origins[-1] - track.origins[-2]
        t = unit_vector(cross(*self._seam.walls().normals))
        t = t if t @ forward > 0 else -t
        flat = track.tangents[:, -1] @ R_b_s
        angles = np.arctan2(flat[:, 2], flat[:, 0])
        return np.concatenate((track.origins[-1] + self._step * t, angles))

    def after_newton_step(self, section: Array, R_b_s: Array) -> Array:
        """Section after one Newton step towards what a plane of this orientation cuts, shape (5,).

        Parameters
        ----------
        section : ndarray, shape (5,)
            As the class has it.
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        around = seam_fit.with_small_steps(section, _DIFFERENCE_STEP)
        values = self._wall_distances(self._seam.walls(), around, R_b_s)
        J = (values[1:] - values[0]).T / _DIFFERENCE_STEP
        return np.asarray(section - np.linalg.solve(J, values[0]))

    def direction(self, section: Array, R_b_s: Array) -> Array:
        """Direction onwards along the edge in which wall and leg would meet, unit vector in b.

        Parameters
        ----------
        section : ndarray, shape (5,)
            As the class has it.
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        points = section[:3] + self._shape[:2, None] * wall_and_leg(section, R_b_s)
        axes = np.broadcast_to(np.eye(3), (2, 3, 3))
        _, normals = self._seam.walls().offsets_and_slopes(points[:, None], axes)
        t = unit_vector(cross(*normals))
        return t if t @ (section[:3] - self._T_b_g[:3, 3]) > 0 else -t

    def ideal_frame_and_work_angle(self, section: Array, R_b_s: Array) -> tuple[Array, float]:
        """Ideal frame t in b, eq. (12), and work angle (radians), eq. (16), of a section.

        Parameters
        ----------
        section : ndarray, shape (5,)
            As the class has it.
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        wall, leg = wall_and_leg(section, R_b_s)
        T_b_g = np.eye(4)
        T_b_g[:3, 1], T_b_g[:3, 3] = -wall, section[:3]
        gamma_2 = float(np.arcsin(np.clip(wall @ leg, -1.0, 1.0)))
        return target.correction_target_pose(self._T_b_g, T_b_g), 0.5 * self._shape[2] - gamma_2

    def covariance(self, section: Array, R_b_s: Array) -> Array:
        """Covariance of the ideal frame t (in its own axes) and work angle, shape (7, 7).

        Parameters
        ----------
        section : ndarray, shape (5,)
            As the class has it.
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        around, thetas, shapes = (
            seam_fit.with_small_steps(values, _DIFFERENCE_STEP)
            for values in (section, self._seam.theta, self._shape[:2])
        )
        walls = self._seam.walls()
        by_section = _step_jacobian(self._wall_distances(walls, around, R_b_s))
        by_theta = _step_jacobian(self._wall_distances(self._seam.walls(thetas), section, R_b_s))
        by_theta[:4] -= self._residual_jacobian
        misses = [self._wall_distances(walls, section, R_b_s, lengths) for lengths in shapes]
        by_shape = _step_jacobian(np.array(misses))
        spread = by_theta @ self._seam.covariance @ by_theta.T
        spread += (by_shape * self._shape_sigmas[:2] ** 2) @ by_shape.T
        spread[range(4), range(4)] += self._residual_sigmas**2
        back = np.linalg.inv(by_section)
        changes = [self._target_change(section, one, R_b_s) for one in around]
        seven = _step_jacobian(np.array(changes))
        total = seven @ back @ spread @ back.T @ seven.T
        total[6, 6] += (0.5 * self._shape_sigmas[2]) ** 2
        return np.asarray(total)

    def _wall_distances(
        self, walls: seam_fit.LocalWalls, section: Array, R_b_s: Array, lengths: Array | None = None
    ) -> Array:
        """How far sections (..., 5) are from lying on the walls a step away, shape (..., 5)."""
        lengths = self._shape[:2] if lengths is None else lengths
        tangents = wall_and_leg(section, R_b_s)
        points = section[..., None, :3] + lengths[:, None] * tangents
        distances, slopes = walls.offsets_and_slopes(points[..., None, :], tangents[..., None, :])
        gone = np.linalg.norm(section[..., :3] - self._T_b_g[:3, 3], axis=-1) - self._step
        on_walls = np.concatenate((distances[..., 0], slopes[..., 0]), axis=-1) - self._residuals
        gone = np.broadcast_to(gone[..., None], (*on_walls.shape[:-1], 1))
        return np.concatenate((on_walls, gone), axis=-1)

    def _target_change(self, section: Array, other: Array, R_b_s: Array) -> Array:
        """Position, rotation vector and work angle of another section's ideal in this one's t."""
        T, _ = self.ideal_frame_and_work_angle(section, R_b_s)
        T_other, work_angle = self.ideal_frame_and_work_angle(other, R_b_s)
        return np.append(pose_vector.pose_to_vector(inverse_pose(T) @ T_other), work_angle)


def wall_and_leg(section: Array, R_b_s: Array) -> Array:
    """Unit vectors along wall and leg, shape (..., 2, 3)."""
    angles = section[..., 3:, None]
    return np.asarray(np.cos(angles) * R_b_s[:, 0] + np.sin(angles) * R_b_s[:, 2])


def _step_jacobian(values: Array) -> Array:
    """Jacobian from values at a place and at steps of `_DIFFERENCE_STEP` beside it."""
    return np.asarray((values[1:] - values[0]).T / _DIFFERENCE_STEP)


MOST_SOLVER_ROUNDS: Final = 30
CONVERGED_VIEW_STEP: Final = 1e-7
"""Metres and radians: a smaller step ends the search for the section."""

MARGIN_SIGMAS: Final = 3.0
"""Standard deviations that are kept from the tolerances of a view: a view planned at
their edge often needs a correction."""


def predictor_for_plan(plan: ScanPlan) -> SetPointPredictor:
    """Predictor of set-points that a plan names."""
    if plan.prediction == target.SMOOTH_PREDICTION:
        return tube_fit_predictor(plan)
    return target.paper_predictor(target.PREDICTION_CASES[plan.prediction], plan.direction)


def tube_fit_predictor(plan: ScanPlan) -> SetPointPredictor:
    """Predict what the laser plane will cut out of the seam, a step further on.

    Parameters
    ----------
    plan : ScanPlan
        Direction and view; and what a view may be off the ideal one: inside of that the
        sensor turns as little as it can.

    Notes
    -----
    If no such section is found, and if none can be (two sections, one of them misread),
    the prediction is the one of the paper's case 3, which states no covariance.
    """
    otherwise = target.paper_predictor(target.PREDICTION_CASES[3], plan.direction)

    def predictor(sections: Sections, step: float) -> SetPoint:
        track, last = seam_fit.RecentSections(sections), sections[-1]
        R_b_now = last.view.T_b_s[:3, :3]
        try:
            seam = seam_fit.fit_tubes_to_sections(track)
            ahead = ExpectedSection(track, seam, last.T_b_g, step)
            guess = ahead.initial_section(R_b_now)
            now = R_b_now, R_b_now, (0.0, 0.0)
            section, ideal = _solve_section_and_pose(ahead, plan, guess, *now)
            covariance = ahead.covariance(section, _sensor_rotation(ideal))
            slack = _rotation_tolerance_left(plan, covariance, track, step)
            later = _sensor_rotation(ideal), R_b_now, slack
            _, lagging = _solve_section_and_pose(ahead, plan, section, *later)
            to = replace(lagging, covariance=covariance, straight=False)
            check_set_point(to, StepRequest(last, lagging.T_b_t[:3, 3], step), plan)
        except (TubesNotFound, SetPointTooFar, np.linalg.LinAlgError):
            return otherwise(sections, step)
        return to

    return predictor


def _solve_section_and_pose(
    ahead: ExpectedSection,
    plan: ScanPlan,
    section: Array,
    R_b_s: Array,
    R_b_now: Array,
    slack: tuple[float, float],
) -> tuple[Array, SetPoint]:
    """Section and set-point that fit each other: the plane decides on the section, it on the plane.

    Parameters
    ----------
    section : ndarray, shape (5,)
        To start from, in a sensor with the orientation `R_b_s`.
    R_b_now : ndarray, shape (3, 3)
        Where the sensor comes from.
    slack : tuple of float
        How far it may lag behind, about the groove and about the other axes of t, radians.

    Raises
    ------
    TubesNotFound
        If they don't come to rest.
    """
    for _ in range(MOST_SOLVER_ROUNDS):
        found = ahead.after_newton_step(section, R_b_s)
        T_b_t, work_angle = ahead.ideal_frame_and_work_angle(found, R_b_s)
        T_s_t = plan.target_pose_in_sensor(work_angle)
        R_s_t = T_s_t[:3, :3]
        turned = T_b_t[:3, :3] @ _nearest_rotation(T_b_t[:3, :3], R_b_now @ R_s_t, slack)
        moved = max(np.abs(found - section).max(), np.abs(turned @ R_s_t.T - R_b_s).max())
        section, R_b_s = found, turned @ R_s_t.T
        if moved < CONVERGED_VIEW_STEP:
            return section, SetPoint(pose(turned, T_b_t[:3, 3]), T_s_t)
    raise TubesNotFound("no section of the seam is a step further on")


def _nearest_rotation(R_b_t_ideal: Array, R_b_t_now: Array, slack: tuple[float, float]) -> Array:
    """Rotation off the ideal orientation, within the slack, that is nearest to the present one."""
    if max(slack) == 0:
        return np.eye(3)
    back = pose_vector.rotation_to_vector(R_b_t_ideal.T @ R_b_t_now)
    for part, most in ((back[:1], slack[0]), (back[1:], slack[1])):
        angle = float(np.linalg.norm(part))
        part *= min(1.0, most / angle) if angle > 0 else 1.0
    return pose_vector.rotation_from_vector(back)


def _rotation_tolerance_left(
    plan: ScanPlan, covariance: Array, track: seam_fit.RecentSections, step: float
) -> tuple[float, float]:
    """What the doubt of prediction and reading leaves of the tolerances, radians."""
    criterion = plan.correction_criterion
    if criterion is None:
        return 0.0, 0.0
    turns = -1.0 if plan.direction is target.ScanDirection.COUNTERCLOCKWISE else 1.0
    about = covariance[3, 3] + covariance[6, 6] + 2 * turns * covariance[3, 6]
    aside = max(covariance[4, 4], covariance[5, 5])
    origin, opening = track.shape_sigmas[-1, [0, 2]]
    work_angle = criterion.work_angle - MARGIN_SIGMAS * hypot(sqrt(max(about, 0.0)), 0.5 * opening)
    rotation = criterion.rotation - MARGIN_SIGMAS * hypot(sqrt(aside), origin / step)
    return max(0.0, work_angle), max(0.0, rotation)


def _sensor_rotation(to: SetPoint) -> Array:
    return np.asarray(to.T_b_t[:3, :3] @ to.T_s_t[:3, :3].T)
