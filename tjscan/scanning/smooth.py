"""The fifth predictor: along the seam of the two tubes that fit the sections."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, sqrt
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import SetPointRefused, TubesNotFound
from tjscan.core.frames import Array, pose
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.seam.fit import RecentSections, fit_tubes_to_sections, recent_section_arrays
from tjscan.scanning.seam.next_section import ExpectedSection
from tjscan.scanning.section import Sections, SetPoint, SetPointPredictor, StepRequest
from tjscan.scanning.sections_before import check_set_point
from tjscan.scanning.target import PREDICTION_CASES, ScanDirection, paper_predictor

MOST_ROUNDS: Final = 30
SETTLED_STEP: Final = 1e-7
"""Metres and radians: a smaller step ends the search for the section."""

KEPT_SIGMAS: Final = 3.0
"""Standard deviations that are kept from the tolerances of a view: a view planned at
their edge often needs a correction."""


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
    otherwise = paper_predictor(PREDICTION_CASES[3], plan.direction)

    def predictor(sections: Sections, step: float) -> SetPoint:
        track, last = recent_section_arrays(sections), sections[-1]
        R_b_now = last.view.T_b_s[:3, :3]
        try:
            seam = fit_tubes_to_sections(track)
            ahead = ExpectedSection.from_track(track, seam, last.T_b_g, step)
            guess = ahead.initial_section(track, R_b_now)
            section, ideal = _solve_section_and_pose(
                ahead, plan, guess, R_b_now, R_b_now, (0.0, 0.0)
            )
            covariance = ahead.covariance(section, _R_b_s(ideal))
            slack = _free_rotation(plan, covariance, track, step)
            _, lagging = _solve_section_and_pose(
                ahead, plan, section, _R_b_s(ideal), R_b_now, slack
            )
            to = replace(lagging, covariance=covariance, straight=False)
            check_set_point(to, StepRequest(last, lagging.T_b_t[:3, 3], step), plan)
        except (TubesNotFound, SetPointRefused, np.linalg.LinAlgError):
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
    for _ in range(MOST_ROUNDS):
        found = ahead.after_newton_step(section, R_b_s)
        T_b_t, work_angle = ahead.ideal_frame_and_work_angle(found, R_b_s)
        T_s_t = plan.target_pose_in_sensor(work_angle)
        R_s_t = T_s_t[:3, :3]
        turned = T_b_t[:3, :3] @ _lag_rotation(T_b_t[:3, :3], R_b_now @ R_s_t, slack)
        moved = max(np.abs(found - section).max(), np.abs(turned @ R_s_t.T - R_b_s).max())
        section, R_b_s = found, turned @ R_s_t.T
        if moved < SETTLED_STEP:
            return section, SetPoint(pose(turned, T_b_t[:3, 3]), T_s_t)
    raise TubesNotFound("no section of the seam lies a step further on")


def _lag_rotation(R_b_t_ideal: Array, R_b_t_now: Array, slack: tuple[float, float]) -> Array:
    """Rotation off the ideal orientation, within the slack, that is nearest to the present one."""
    if max(slack) == 0:
        return np.eye(3)
    back = pose_vector.rotation_to_vector(R_b_t_ideal.T @ R_b_t_now)
    for part, most in ((back[:1], slack[0]), (back[1:], slack[1])):
        angle = float(np.linalg.norm(part))
        part *= min(1.0, most / angle) if angle > 0 else 1.0
    return pose_vector.rotation_from_vector(back)


def _free_rotation(
    plan: ScanPlan, covariance: Array, track: RecentSections, step: float
) -> tuple[float, float]:
    """What the doubt of prediction and reading leaves of the tolerances, radians."""
    criterion = plan.correction_criterion
    if criterion is None:
        return 0.0, 0.0
    turns = -1.0 if plan.direction is ScanDirection.COUNTERCLOCKWISE else 1.0
    about = covariance[3, 3] + covariance[6, 6] + 2 * turns * covariance[3, 6]
    aside = max(covariance[4, 4], covariance[5, 5])
    origin, opening = track.shape_sigmas[-1, [0, 2]]
    work_angle = criterion.work_angle - KEPT_SIGMAS * hypot(sqrt(max(about, 0.0)), 0.5 * opening)
    rotation = criterion.rotation - KEPT_SIGMAS * hypot(sqrt(aside), origin / step)
    return max(0.0, work_angle), max(0.0, rotation)


def _R_b_s(to: SetPoint) -> Array:
    return np.asarray(to.T_b_t[:3, :3] @ to.T_s_t[:3, :3].T)
