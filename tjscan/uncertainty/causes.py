"""What makes sections err, and how every view of a scan answers to it, to first order.

Most causes move a view as a whole: where the laser sits on the hand, the arm's geometry, what the
arm does not repeat. Such a motion is a twist, and it moves any point of the view. What is wrong
with the laser bends the profile in its own plane instead (`tjscan.uncertainty.causes`).

What is wrong with the laser bends every profile alike, in the profile's own plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from tjscan.core import pose_vector
from tjscan.core.frames import Array, array_dataclass, pose
from tjscan.groove.section import measure_groove
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.model import LaserModel
from tjscan.scanning.section import Sections
from tjscan.uncertainty.budget import (
    BudgetComponent,
    UncertaintyBudget,
    covariance_factor,
    points_moved_by_twist,
)

READING_CAUSE: Final = "reading of the profile"
HAND_EYE_CAUSE: Final = "laser on the hand"
GEOMETRY_CAUSE: Final = "arm's geometry"
HAND_EYE_AND_ARM_CAUSE: Final = "laser on the hand and arm's geometry"
REPEATABILITY_CAUSE: Final = "arm's repeatability"
SWAY_CAUSE: Final = "sway"
CLOCK_CAUSE: Final = "laser's clock"

LEAST_DISTANCE_AHEAD: Final = 5e-3
"""Metres to another section that shows which way the groove leads."""

ProfileBend = Callable[[Array, Array], Array]
"""How points of a profile move by places and tangents, see `bend` of `ViewCause`."""


@array_dataclass
class ViewCause:
    """A cause of error, and how n views answer to m independent standard normal draws of it.

    Parameters
    ----------
    name, evidence, is_shared
        As of `BudgetComponent`.
    twists : ndarray, shape (n, 6, m)
        How each view moves as a whole in b: translation of what is at b's origin, metres, and
        rotation vector, radians.
    points : ndarray, shape (n, 5, 3, m)
        How its p1 to p5 move in b, metres.
    measures : ndarray, shape (n, 4, m)
        How its measures change.
    bend : callable, optional
        How any point of a profile moves as well in the plane of the laser, which all profiles do
        alike: gets places, metres, and unit tangents of the steel there, both in x and z of s,
        shape (k, 2), and gives shape (k, 2, m), metres. None if views move as a whole alone.
    """

    name: str
    evidence: str
    is_shared: bool
    twists: Array
    points: Array
    measures: Array
    bend: ProfileBend | None = None

    def with_motions(self, sections: Sections, twists: Array) -> Self:
        """The same cause, whose draws move the views as a whole as well.

        Parameters
        ----------
        sections : sequence of ScannedSection
            Of the views.
        twists : ndarray, shape (n, 6, m)
            Motions as of `twists`.
        """
        points = np.array([section.points_b for section in sections])
        moved = self.points + points_moved_by_twist(points, twists)
        return replace(self, twists=self.twists + twists, points=moved)

    def moves_of_points(
        self, view: NDArray[np.intp], T_b_s: Array, points: Array, tangents: Array
    ) -> Array:
        """How points of profiles move in b, shape (k, 3, m), metres.

        Parameters
        ----------
        view : ndarray of int, shape (k,)
            Which view each was seen in.
        T_b_s : ndarray, shape (k, 4, 4)
            Where the sensor was then.
        points, tangents : ndarray, shape (k, 3)
            Places, metres, and unit tangents of the steel in the plane of the laser; in s.
        """
        R = T_b_s[:, :3, :3]
        in_b = np.einsum("kij,kj->ki", R, points) + T_b_s[:, :3, 3]
        moved = points_moved_by_twist(in_b[:, None], self.twists[view])[:, 0]
        if self.bend is not None:
            bent = self.bend(points[:, [0, 2]], tangents[:, [0, 2]])
            moved = moved + R[:, :, [0, 2]] @ bent
        return moved

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
        measures = self.measures[:count]
        return BudgetComponent(self.name, self.evidence, self.is_shared, points, measures)


def motion_cause(
    name: str, evidence: str, sections: Sections, twists: Array, *, is_shared: bool
) -> ViewCause:
    """Cause that moves views as a whole, by twists, shape (n, 6, m), in b about its origin."""
    points = np.array([section.points_b for section in sections])
    moved = points_moved_by_twist(points, twists)
    measures = np.zeros((len(points), 4, twists.shape[-1]))  # read in the profile's own plane
    return ViewCause(name, evidence, is_shared, twists, moved, measures)


def reading_cause(sections: Sections) -> ViewCause:
    """The reading of the groove in a profile's points: each section's own."""
    n = len(sections)
    points, measures = np.zeros((n, 5, 3, 10)), np.zeros((n, 4, 10))
    for k, section in enumerate(sections):
        in_plane = section.view.T_b_s[:3, [0, 2]]
        factor = covariance_factor(section.groove.covariance_s).reshape(3, 2, 6)
        points[k, 1:4, :, :6] = in_plane @ factor
        measures[k, :, 6:] = covariance_factor(section.groove.measure_covariance)
    return ViewCause(READING_CAUSE, "observed", False, np.zeros((n, 6, 10)), points, measures)


def repeatability_cause(
    sections: Sections, repeatability: ArmRepeatability, evidence: str
) -> ViewCause:
    """What the arm does not repeat: drawn again in each view, it moves it about its flange."""
    factor = covariance_factor(repeatability.covariance)
    flanges = [pose(p=section.view.T_b_f[:3, 3]) for section in sections]
    twists = np.array([pose_vector.adjoint(flange) @ factor for flange in flanges])
    return motion_cause(REPEATABILITY_CAUSE, evidence, sections, twists, is_shared=False)


def hand_eye_cause(
    sections: Sections,
    T_f_s: Array,
    covariance: Array,
    evidence: str,
    flange_by_deviations: Array | None = None,
) -> ViewCause:
    """Where the laser sits on the hand: one error of T_f_s in all views of an arm.

    With the arm's deviations, if these were calibrated with it: their errors go together.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of one calibration.
    T_f_s : ndarray, shape (4, 4)
        As calibrated, metres.
    covariance : ndarray, shape (6, 6) or (6 + 6 k, 6 + 6 k)
        Of a step of it, see `tjscan.core.pose_vector.boxplus`: translation, metres, and turn
        about the sensor's origin, radians, both in the axes of f; and of the deviations.
    evidence : str
        As of `BudgetComponent`.
    flange_by_deviations : ndarray, shape (n, 6, k, 6), optional
        As of `arm_geometry_cause`.
    """
    name = HAND_EYE_CAUSE if flange_by_deviations is None else HAND_EYE_AND_ARM_CAUSE
    factor = covariance_factor(covariance)
    twists = calibration_twists(sections, T_f_s, flange_by_deviations, factor)
    return motion_cause(name, evidence, sections, twists, is_shared=True)


def calibration_twists(
    sections: Sections, T_f_s: Array, flange_by_deviations: Array | None, by_draws: Array
) -> Array:
    """How views move with what a calibration is off by, shape (n, 6, m), in b about its origin.

    Parameters
    ----------
    sections, T_f_s
        As of `hand_eye_cause`.
    flange_by_deviations : ndarray, shape (n, 6, k, 6), or None
        As of `arm_geometry_cause`; none if the arm was not calibrated with the sensor.
    by_draws : ndarray, shape (6, m) or (6 + 6 k, m)
        Steps of T_f_s, and of the deviations, by each draw.
    """
    n = len(sections)
    # The step turns about the sensor: about the flange's origin it is this twist.
    by_all = np.tile(pose_vector.adjoint(pose(p=T_f_s[:3, 3])), (n, 1, 1))
    if flange_by_deviations is not None:
        by_all = np.concatenate((by_all, flange_by_deviations.reshape(n, 6, -1)), axis=2)
    return _twists_in_b(sections, by_all @ by_draws)


def arm_geometry_cause(
    sections: Sections,
    flange_by_deviations: Array,
    sigmas: Array,
    evidence: str,
    absolute: float | None = None,
) -> ViewCause:
    """Deviations of an arm's joints from its model, which nothing is known of but their size.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of one arm.
    flange_by_deviations : ndarray, shape (n, 6, k, 6)
        How the flange moves in each view, in its own axes, with the deviations of k joints; see
        `tjscan.robot.deviations.deviation_jacobian`.
    sigmas : ndarray, shape (6,)
        Standard deviations of a joint's deviations, metres and radians.
    evidence : str
        As of `BudgetComponent`.
    absolute : float, optional
        Root mean square of the flange's distance from where the arm reports it, over these
        views, metres: deviations are taken for so many times larger or smaller.
    """
    n = len(sections)
    in_f = (flange_by_deviations * sigmas).reshape(n, 6, -1)
    if absolute is not None:
        in_f = in_f * (absolute / np.sqrt(np.mean(np.sum(in_f[:, :3] ** 2, axis=(1, 2)))))
    return motion_cause(
        GEOMETRY_CAUSE, evidence, sections, _twists_in_b(sections, in_f), is_shared=True
    )


def sway_cause(sections: Sections) -> ViewCause:
    """How far the sensor was from its place of rest after all: drawn again in each view.

    Across the groove that is what the burst leaves open; along it nothing shows a motion. What of
    one along the groove is seen in the plane of the laser is taken for one in it, so that the
    error that is left is along the groove and not square to that plane.
    """
    origins = np.array([section.T_b_g[:3, 3] for section in sections])
    twists = np.zeros((len(sections), 6, 3))
    for k, section in enumerate(sections):
        if section.view.sway is None:
            continue
        ways = origins - origins[k]
        lengths = np.linalg.norm(ways, axis=1)
        lengths[lengths < LEAST_DISTANCE_AHEAD] = np.inf
        nearest = int(lengths.argmin())
        ahead = ways[nearest] if np.isfinite(lengths[nearest]) else section.T_b_g[:3, 0]
        axes, _ = np.linalg.qr(np.column_stack((ahead, np.eye(3))))
        across, along = section.view.sway
        twists[k, :3] = axes * (along, across, across)
    return motion_cause(SWAY_CAUSE, "observed", sections, twists, is_shared=False)


def clock_cause(sections: Sections) -> ViewCause:
    """How late the laser's clock may be against the arm's, the same in a whole continuous scan.

    Each view moves as far as the sensor moved in the standard deviation of its profile's time.
    """
    views = [section.view for section in sections]
    twists = np.zeros((len(views), 6, 1))
    for k, view in enumerate(views):
        before, after = views[max(k - 1, 0)], views[min(k + 1, len(views) - 1)]
        if view.profile.time_uncertainty > 0 and after.time > before.time:
            share = view.profile.time_uncertainty / (after.time - before.time)
            R = after.T_b_s[:3, :3] @ before.T_b_s[:3, :3].T
            turn = share * pose_vector.rotation_to_vector(R)
            moved = share * (after.T_b_s[:3, 3] - before.T_b_s[:3, 3])
            twists[k, :, 0] = *(moved - np.cross(turn, view.T_b_s[:3, 3])), *turn
    return motion_cause(CLOCK_CAUSE, "measured", sections, twists, is_shared=True)


def _twists_in_b(sections: Sections, twists: Array) -> Array:
    """Motions of the flange, (n, 6, m) in its axes, as twists in b about b's origin."""
    return np.array([pose_vector.adjoint(section.view.T_b_f) for section in sections]) @ twists


def budget_of_causes(causes: Sequence[ViewCause], T_r_b: Array, count: int) -> UncertaintyBudget:
    """Budget of a scan's finished sections in the frame of its result.

    Parameters
    ----------
    causes : sequence of ViewCause
        Of all views, the sections' first.
    T_r_b : ndarray, shape (4, 4)
        The arm's base in that frame.
    count : int
        How many sections.
    """
    parts = (cause.component(T_r_b[:3, :3], count).with_fewest_draws() for cause in causes)
    return UncertaintyBudget(tuple(parts))


LINEARITY_CAUSE: Final = "laser's linearity"
RANGE_BIAS_CAUSE: Final = "range bias at steep incidence"

LARGEST_INCIDENCE_TANGENT: Final = 5.0
"""Tangent of the incidence beyond which a range errs by no more: such points are lost."""

SIDE_DERIVATIVE_STEP: Final = 1e-6
"""Metres along a side over which its turn is taken: far more than rounding, less than it bends."""


def linearity_cause(
    sections: Sections, deviation: float, model: LaserModel, evidence: str
) -> ViewCause:
    """What the laser deviates by all over its window, see `LaserDeviation`.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of one laser.
    deviation : float
        Largest deviation in the window, metres.
    model : LaserModel
        The window.
    evidence : str
        As of `BudgetComponent`.
    """
    field = LaserDeviation.for_window(deviation, model.measuring_range)

    def corner_moves(xz: Array, tangents: Array) -> tuple[Array, Array]:
        turns = []
        for at, t in ((xz[1], tangents[0]), (xz[3], tangents[3])):
            ahead, here = field.displacements_at(np.array((at + SIDE_DERIVATIVE_STEP * t, at)))
            by_step = (ahead - here) / SIDE_DERIVATIVE_STEP
            turns.append(t[0] * by_step[1] - t[1] * by_step[0])
        return field.displacements_at(xz), np.array(turns)

    def bend(xz: Array, _tangents: Array) -> Array:
        return field.displacements_at(xz)

    return _bending_cause(LINEARITY_CAUSE, evidence, sections, bend, corner_moves)


def range_bias_cause(sections: Sections, bias: float, evidence: str) -> ViewCause:
    """Range that errs in proportion to the tangent of the incidence, the same on all profiles.

    Each side moves along the light; a corner is where its sides meet then. Incidence counts in
    the laser's plane, and light comes from the sensor's origin.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of one laser, on steel of one kind.
    bias : float
        Standard deviation of the range's error at 45° of incidence, metres.
    evidence : str
        As of `BudgetComponent`.
    """

    def bend(xz: Array, tangents: Array) -> Array:
        ray = xz / np.linalg.norm(xz, axis=1, keepdims=True)
        along = np.abs(np.sum(ray * tangents, axis=1))
        square = np.abs(ray[:, 0] * tangents[:, 1] - ray[:, 1] * tangents[:, 0])
        tangent = np.minimum(along / np.maximum(square, 1e-9), LARGEST_INCIDENCE_TANGENT)
        return np.asarray((bias * tangent[:, None] * ray)[..., None])

    def corner_moves(xz: Array, tangents: Array) -> tuple[Array, Array]:
        normals = np.column_stack((tangents[:, 1], -tangents[:, 0]))
        offsets = np.empty((4, 2))  # of each side along its normal, at its first and second point
        for k in range(4):  # the side between a point and the next
            offsets[k] = bend(xz[[k, k + 1]], np.tile(tangents[k], (2, 1)))[..., 0] @ normals[k]
        points = np.zeros((5, 2))
        points[0], points[4] = normals[0] * offsets[0, 0], normals[3] * offsets[3, 1]
        for i in (1, 2, 3):
            both = normals[[i - 1, i]]
            points[i] = np.linalg.lstsq(both, (offsets[i - 1, 1], offsets[i, 0]), rcond=1e-2)[0]
        lengths = np.linalg.norm(xz[[0, 4]] - xz[[1, 3]], axis=1)
        # The normal is clockwise of the tangent: moving along it turns a side clockwise.
        turns = np.array((offsets[0, 0] - offsets[0, 1], offsets[3, 0] - offsets[3, 1])) / lengths
        return points[:, :, None], turns[:, None]

    return _bending_cause(RANGE_BIAS_CAUSE, evidence, sections, bend, corner_moves)


def _bending_cause(
    name: str,
    evidence: str,
    sections: Sections,
    bend: ProfileBend,
    corner_moves: Callable[[Array, Array], tuple[Array, Array]],
) -> ViewCause:
    """Cause that bends profiles in the plane of the laser, and leaves views where they are.

    Parameters
    ----------
    corner_moves : callable
        From the five points (5, 2) in x and z of s, and unit tangents of the four sides (4, 2), to
        how the points move (5, 2, m), and how both outer tangents turn (2, m).
    """
    moves, measures = [], []
    for section in sections:
        groove = section.groove
        wall, leg = groove.wall_s[[0, 2]], groove.leg_s[[0, 2]]
        xz = groove.points_s[:, [0, 2]]
        tangents = np.diff(xz, axis=0)
        tangents[0], tangents[3] = wall, leg
        size = np.linalg.norm(tangents, axis=1, keepdims=True)
        points, turns = corner_moves(xz, tangents / np.where(size > 0, size, 1.0))
        moves.append(section.view.T_b_s[:3, [0, 2]] @ points)
        by = np.concatenate((points[1:4].reshape(6, -1), turns))
        p2, p3, p4 = xz[1:4].tolist()
        measures.append(measure_groove(p2, p3, p4, wall.tolist(), leg.tolist()).jacobian @ by)
    unmoved = np.zeros((len(moves), 6, moves[0].shape[-1]))  # bent, and not moved as a whole
    return ViewCause(name, evidence, True, unmoved, np.array(moves), np.array(measures), bend)
