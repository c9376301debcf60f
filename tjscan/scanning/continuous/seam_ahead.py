"""The seam ahead of the last section: where frame t shall go, and how sure that is."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import Array, array_dataclass, unit_vector
from tjscan.scanning import seam_fit
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import Sections
from tjscan.scanning.smooth import ExpectedSection, wall_and_leg
from tjscan.scanning.target import target_pose_along

FIRST_DISTANCE: Final = 6e-3
PREDICTION_SPACING: Final = 12e-3
"""Metres from the last section to the first place that is predicted, and from place to place."""

DIRECTION_LENGTH: Final = 40e-3
BEND_LENGTH: Final = 16e-3
"""Metres of groove that show its direction, and that show its bend, too."""

NEWTON_STEPS: Final = 4
"""From each place to the next."""

LARGEST_SIGMA: Final = 2.5e-3
"""Metres across the groove, standard deviation: up to it the groove stays well in view."""


@array_dataclass
class SeamAhead:
    """Frames t along the seam ahead.

    Parameters
    ----------
    lengths : ndarray, shape (m,)
        Metres along the groove from the last section, rising.
    T_b_t, T_b_s : ndarray, shape (m, 4, 4)
        Frame t, its x axis along the groove, and the sensor as the plan wants it there, metres.
    """

    lengths: Array
    T_b_t: Array
    T_b_s: Array


def predict_seam(sections: Sections, plan: ScanPlan, farthest: float) -> SeamAhead:
    """Predict the seam beyond the last section, as far as it is known well.

    Parameters
    ----------
    sections : sequence of ScannedSection
        Those that the seam is fitted to, two or more.
    plan : ScanPlan
        Direction and view.
    farthest : float
        Metres from the last section.

    Raises
    ------
    TubesNotFound
        If no seam fits the sections.
    """
    track, last = seam_fit.RecentSections(sections), sections[-1]
    seam = seam_fit.fit_tubes_to_sections(track)
    distances = np.arange(FIRST_DISTANCE, farthest + PREDICTION_SPACING, PREDICTION_SPACING)
    R_b_s, section = last.view.T_b_s[:3, :3], None
    T_b_t, angles = [], []
    for distance in distances:
        ahead = ExpectedSection(track, seam, last.T_b_g, float(distance))
        if section is None:
            section = ahead.initial_section(R_b_s)
        else:
            section[:3] += PREDICTION_SPACING * T_b_t[-1][:3, 0]
        try:
            for _ in range(NEWTON_STEPS):
                section = ahead.after_newton_step(section, R_b_s)
                wall, _ = wall_and_leg(section, R_b_s)
                _, work_angle = ahead.ideal_frame_and_work_angle(section, R_b_s)
                along = ahead.direction(section, R_b_s)
                T = target_pose_along(along, -wall, section[:3])
                R_b_s = T[:3, :3] @ plan.target_pose_in_sensor(work_angle)[:3, :3].T
        except np.linalg.LinAlgError as error:
            raise TubesNotFound("no section of the seam lies ahead") from error
        covariance = ahead.covariance(section, R_b_s)
        if not np.isfinite(covariance).all() or max(np.diag(covariance)[1:3]) > LARGEST_SIGMA**2:
            break
        T_b_t.append(T)
        angles.append(work_angle)
    if len(T_b_t) < 2:
        raise TubesNotFound("the seam ahead is too unsure")
    frames = np.array(T_b_t)
    chords = np.linalg.norm(np.diff(frames[:, :3, 3], axis=0), axis=1)
    lengths = FIRST_DISTANCE + np.concatenate(([0.0], chords.cumsum()))
    T_s_t = np.array([plan.target_pose_in_sensor(float(angle)) for angle in angles])
    return SeamAhead(lengths, frames, frames @ np.linalg.inv(T_s_t))


def seam_direction(sections: Sections) -> Array:
    """Direction of the groove at the last of two or more sections, unit vector.

    Of parabolas through the ways of the last sections' corners, each as far as it came along the
    groove, as surely as they are known; of lines through short ways. Where the sensor turns, the
    corners come less far, or further, than the sections' origins, which lie beside them.
    """
    last = sections[-seam_fit.MOST_RECENT_SECTIONS :]
    origins = np.array([section.T_b_g[:3, 3] for section in last])
    steps = np.linalg.norm(np.diff(origins, axis=0), axis=1)
    along = -np.append(steps[::-1].cumsum()[::-1], 0.0)
    near = along >= min(-DIRECTION_LENGTH, along[-2])
    recent = [section for section, is_near in zip(last, near, strict=True) if is_near]
    corners = np.array([section.points_b[1:4] for section in recent])
    covariances = np.array([section.groove.corner_covariances_s for section in recent])
    sigmas = np.sqrt(0.5 * np.trace(covariances, axis1=2, axis2=3) + seam_fit.ARM_REPEATABILITY**2)
    onwards, slope = unit_vector(origins[-1] - origins[near][0]), np.zeros(3)
    for way, sigma in zip(corners.swapaxes(0, 1), sigmas.T, strict=True):
        gone = (way - way[-1]) @ onwards
        degree = 2 if len(recent) > 2 and np.ptp(gone) >= BEND_LENGTH else 1
        powers = np.vander(gone, degree + 1, increasing=True)
        inverse = np.linalg.inv(powers.T @ (powers / sigma[:, None] ** 2))
        slope += (inverse @ powers.T @ (way / sigma[:, None] ** 2))[1] / inverse[1, 1]
    return unit_vector(slope)
