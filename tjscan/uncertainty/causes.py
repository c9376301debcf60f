"""What makes sections err, and how every view of a scan answers to it, to first order.

Most causes move a view as a whole: where the laser sits on the hand, the arm's geometry, what the
arm does not repeat. Such a motion is a twist, and it moves any point of the view. What is wrong
with the laser bends the profile in its own plane instead (`tjscan.uncertainty.laser_causes`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.frames import Array, pose, readonly_copy, skew_matrix
from tjscan.joint.tubes.walls import ArmRepeatability
from tjscan.scanning.section import ScannedSection
from tjscan.uncertainty.budget import BudgetComponent, UncertaintyBudget, covariance_factor

READING: Final = "reading of the profile"
HAND_EYE: Final = "laser on the hand"
GEOMETRY: Final = "arm's geometry"
REPEATABILITY: Final = "arm's repeatability"

LEVER: Final = 0.5
"""Metres of arm over which a turn of a link moves the flange by as much as a shift of the link
does: it divides what a maker states of the flange among lengths and angles. Assumption."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewCause:
    """A cause of error, and how n views answer to m independent standard normal draws of it.

    Parameters
    ----------
    name, evidence, is_shared
        As of `BudgetComponent`.
    twists : ndarray, shape (n, 6, m)
        How each view moves in b: translation of what lies at b's origin, metres, and rotation
        vector, radians. Of a cause that bends profiles it is the motion that comes nearest.
    points : ndarray, shape (n, 5, 3, m)
        How its p1 to p5 move in b, metres.
    measures : ndarray, shape (n, 4, m)
        How its measures change.
    """

    name: str
    evidence: str
    is_shared: bool
    twists: Array
    points: Array
    measures: Array

    def __post_init__(self) -> None:
        for name in ("twists", "points", "measures"):
            object.__setattr__(self, name, readonly_copy(getattr(self, name)))

    def component(self, R_r_b: Array, count: int) -> BudgetComponent:
        """Component of the budget of the first sections, in the frame of the result.

        Parameters
        ----------
        R_r_b : ndarray, shape (3, 3)
            Axes of b in that frame.
        count : int
            How many sections.
        """
        points = np.einsum("ij,nkjm->nkim", R_r_b, self.points[:count])
        return BudgetComponent(
            self.name, self.evidence, self.is_shared, points, self.measures[:count]
        )


def points_moved_by_twist(points: Array, twists: Array) -> Array:
    """How points move with twists about the origin, shape (..., k, 3, m), metres.

    Parameters
    ----------
    points : ndarray, shape (..., k, 3)
        Metres.
    twists : ndarray, shape (..., 6, m)
        Translations, metres, before rotation vectors, radians.
    """
    translation, rotation = twists[..., None, :3, :], twists[..., None, 3:, :]
    return np.asarray(translation - skew_matrix(points) @ rotation)


def motion_cause(
    name: str,
    evidence: str,
    sections: Sequence[ScannedSection],
    twists: Array,
    *,
    is_shared: bool,
) -> ViewCause:
    """Cause that moves views as a whole, by twists, shape (n, 6, m), in b about its origin."""
    points = np.array([section.points_b for section in sections])
    moved = points_moved_by_twist(points, twists)
    measures = np.zeros((len(points), 4, twists.shape[-1]))  # read in the profile's own plane
    return ViewCause(name, evidence, is_shared, twists, moved, measures)


def reading_cause(sections: Sequence[ScannedSection]) -> ViewCause:
    """The reading of the groove in a profile's points: each section's own."""
    n = len(sections)
    points, measures = np.zeros((n, 5, 3, 10)), np.zeros((n, 4, 10))
    for k, section in enumerate(sections):
        in_plane = section.view.T_b_s[:3, [0, 2]]
        factor = covariance_factor(section.groove.covariance_s).reshape(3, 2, 6)
        points[k, 1:4, :, :6] = in_plane @ factor
        measures[k, :, 6:] = covariance_factor(section.groove.measure_covariance)
    return ViewCause(READING, "observed", False, np.zeros((n, 6, 10)), points, measures)


def repeatability_cause(
    sections: Sequence[ScannedSection], repeatability: ArmRepeatability, evidence: str
) -> ViewCause:
    """What the arm does not repeat: drawn anew in each view, it moves it about its flange."""
    factor = covariance_factor(repeatability.covariance)
    about_flange = [
        pose_vector.adjoint(pose(p=section.view.T_b_f[:3, 3])) @ factor for section in sections
    ]
    return motion_cause(REPEATABILITY, evidence, sections, np.array(about_flange), is_shared=False)


def hand_eye_cause(
    sections: Sequence[ScannedSection], T_f_s: Array, covariance: Array, evidence: str
) -> ViewCause:
    """Where the laser sits on the hand: one error of T_f_s in all views of an arm.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of one calibration.
    T_f_s : ndarray, shape (4, 4)
        As calibrated, metres.
    covariance : ndarray, shape (6, 6)
        Of a step of it, see `tjscan.core.pose_vector.boxplus`: translation, metres, and turn
        about the sensor's origin, radians, both in the axes of f.
    evidence : str
        As of `BudgetComponent`.
    """
    # The step turns about the sensor: about the flange's origin it is this twist.
    step = pose_vector.adjoint(pose(p=T_f_s[:3, 3])) @ covariance_factor(covariance)
    twists = [pose_vector.adjoint(section.view.T_b_f) @ step for section in sections]
    return motion_cause(HAND_EYE, evidence, sections, np.array(twists), is_shared=True)


def arm_geometry_cause(
    sections: Sequence[ScannedSection], T_b_joints: Array, absolute: float, evidence: str
) -> ViewCause:
    """Deviations of an arm's links from its model, as large as its maker states of the flange.

    Each link may be shifted and turned a little in any direction, as it was made or mounted: a
    deviation is fixed in its link and moves all that the link carries. What comes after the last
    joint is the same in all views, and is part of `T_f_s`.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of one arm.
    T_b_joints : ndarray, shape (n, k, 4, 4)
        Frames that turn with each of k joints, in b, in every view.
    absolute : float
        Root mean square of the flange's distance from where the arm reports it, over these
        views, metres.
    evidence : str
        As of `BudgetComponent`.
    """
    unit = np.diag(np.repeat((LEVER, 1.0), 3))
    by_link = np.array(
        [[pose_vector.adjoint(T) @ unit for T in joints[:-1]] for joints in T_b_joints]
    )
    twists = by_link.transpose(0, 2, 1, 3).reshape(len(sections), 6, -1)
    flanges = np.array([section.view.T_b_f[:3, 3] for section in sections])
    moved = points_moved_by_twist(flanges[:, None], twists)
    scale = absolute / np.sqrt(np.mean(np.sum(moved**2, axis=(1, 2, 3))))
    return motion_cause(GEOMETRY, evidence, sections, scale * twists, is_shared=True)


def budget_of_causes(causes: Sequence[ViewCause], T_r_b: Array, count: int) -> UncertaintyBudget:
    """Budget of a scan's finished sections in the frame of its result.

    Parameters
    ----------
    causes : sequence of ViewCause
        Of all views, those of the sections first.
    T_r_b : ndarray, shape (4, 4)
        The arm's base in that frame.
    count : int
        How many sections.
    """
    parts = (cause.component(T_r_b[:3, :3], count).compressed() for cause in causes)
    return UncertaintyBudget(tuple(parts))
