"""One station registered to another by what both saw.

Views of the shared stretch are taken for views of one smooth groove whose shape is not known: a
Gaussian process over the azimuth, with a generous spread. What is left is generalised least
squares for the six numbers by which the second station is misplaced. A view counts as a whole, with
the arm's error that all its points share, and less if it contradicts the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from tjscan.core import pose_vector
from tjscan.core.frames import Array, Mask, array_dataclass, skew_matrix, unit_vector
from tjscan.core.gaussian_process import PeriodicKernel
from tjscan.core.robust import tukey_weights
from tjscan.stitching.stations import StationOverlap, arc_of_azimuths
from tjscan.stitching.unrolled_views import CORNER_VALUES_PER_VIEW, VALUES_PER_VIEW, UnrolledViews

SECTION_SHAPE_AZIMUTH: Final = radians(30.0)
"""Azimuth over which the section of a groove changes its shape."""

SECTION_KERNEL: Final = PeriodicKernel(5e-3, SECTION_SHAPE_AZIMUTH)
"""How that shape may change over the azimuth, in metres."""

AZIMUTH_BEYOND_OVERLAP: Final = radians(25.0)
"""Azimuth on either side of the overlap whose views help to find the shape."""

REWEIGHTING_ROUNDS: Final = 8
LEAST_VIEW_WEIGHT: Final = 1e-6

LARGEST_CONDITION_NUMBER: Final = 1e12
UNKNOWN_POSE_VARIANCE: Final = 1.0
"""Square metres and square radians: the variances of a pose about which nothing is known."""

LEAST_VIEW_STEP: Final = 5e-3
"""Metres between views that show which way the groove runs."""


@array_dataclass
class StationRegistration:
    """Pose of one station against another, found from their overlap.

    Parameters
    ----------
    overlap : StationOverlap
        Which one.
    T : ndarray, shape (4, 4)
        Maps the second station's own frame j into the first's.
    covariance : ndarray, shape (6, 6)
        Of translation and rotation vector, about the origin of j.
    centre : ndarray, shape (3,)
        Amid the overlap, on the groove, in j.
    along : ndarray, shape (3,)
        Unit vector along the groove there.
    reduced_chi2 : float
        Chi-squared of the residuals per degree of freedom.
    azimuth : ndarray, shape (n,)
        Of each view, radians beyond the overlap's middle.
    residual : ndarray, shape (n, 6)
        What is left of its corners' outward and upward places, metres.
    of_second, counted : ndarray, shape (n,)
        Which views are the second station's, and to which the robust kernel gave weight.
    number : ndarray, shape (n,)
        Which of its station's views each is.
    by_points : ndarray, shape (n, 6, k, 3)
        How `T` changes as each of the points moves that a view's values are made of, see
        `UnrolledViews`, in the first station's j: translation and rotation vector about its origin.
    """

    overlap: StationOverlap
    T: Array
    covariance: Array
    centre: Array
    along: Array
    reduced_chi2: float
    azimuth: Array
    residual: Array
    of_second: Mask
    counted: Mask
    number: NDArray[np.intp]
    by_points: Array

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residuals that count, of all if none does, metres."""
        chosen = self.counted if self.counted.any() else ~self.counted
        return float(np.sqrt(np.mean(self.residual[chosen] ** 2)))

    @property
    def counted_share(self) -> float:
        """Share of the views to which the robust fit gave weight."""
        return float(self.counted.mean())

    @property
    def position_sigma(self) -> float:
        """Standard deviation of the second station's position amid the overlap, metres.

        Root mean square over the three directions.
        """
        covariance = point_covariance_from_pose(self.covariance, self.centre)
        return float(np.sqrt(np.trace(covariance) / 3))


Registrations = Sequence[StationRegistration]


def point_covariance_from_pose(covariance: Array, points: Array) -> Array:
    """Covariances, shape (..., 3, 3), of points that move with an uncertain pose.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
        Of a pose: translation (metres) and rotation vector (radians) about the origin.
    points : ndarray, shape (..., 3)
        In the outer frame of that pose, metres.
    """
    p = np.asarray(points, dtype=float)
    turned = -skew_matrix(p)  # a rotation vector r moves p by r × p
    by_pose = np.concatenate((np.broadcast_to(np.eye(3), turned.shape), turned), axis=-1)
    return np.asarray(by_pose @ covariance @ by_pose.swapaxes(-1, -2))


def align_second_to_first(
    overlap: StationOverlap, first: UnrolledViews, second: UnrolledViews
) -> StationRegistration:
    """Align the second station of an overlap to the first.

    Parameters
    ----------
    overlap : StationOverlap
        What they share.
    first, second : UnrolledViews
        Unrolled about one shape. The second's points are to be moved by little: the unrolled
        problem is linear for a tenth of a degree or so; see `register_overlaps`.

    Returns
    -------
    StationRegistration
        If the views leave a direction free, one whose covariance means no knowledge.
    """
    views, of_second = _views_near_overlap(overlap, first, second)
    azimuth = overlap.arc.offset_from_middle(views.azimuth)
    value = views.value - views.value.mean(axis=0)
    shape = value.shape
    difference = azimuth[:, None] - azimuth
    kernel, slope_kernel = SECTION_KERNEL(difference), SECTION_KERNEL.derivative(difference)
    by_pose, azimuth_by_pose = views.by_pose, views.azimuth_by_pose
    weights, slope, motion = np.ones(len(value)), np.zeros(shape), np.zeros(6)
    residual = np.zeros(shape)
    for _ in range(REWEIGHTING_ROUNDS):
        noise = views.covariance / weights[:, None, None]
        factor = cho_factor(_covariance_of_all_values(kernel, noise), lower=True)
        # Moved points are compared with the groove at their new azimuth.
        by_motion = by_pose - slope[:, :, None] * azimuth_by_pose
        design = (by_motion * of_second[:, None, None]).reshape(-1, 6)
        solved = cho_solve(factor, np.column_stack((design, value.ravel())))
        information = design.T @ solved[:, :6]
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        if not np.linalg.cond(information / np.outer(scale, scale)) < LARGEST_CONDITION_NUMBER:
            spread, motion = UNKNOWN_POSE_VARIANCE * np.eye(6), np.zeros(6)
            by_value = np.zeros((len(value), 6, VALUES_PER_VIEW))
            break
        spread = np.asarray(np.linalg.inv(information), dtype=float)
        motion = -spread @ (design.T @ solved[:, 6])
        by_value = -spread @ solved[:, :6].T.reshape(6, *shape).transpose(1, 0, 2)
        pull = (solved[:, 6] + solved[:, :6] @ motion).reshape(shape)
        slope = np.einsum("lmc,mc->lc", slope_kernel, pull)
        residual = np.einsum("nij,nj->ni", noise, pull)
        # The root mean square of a view's ten standardised residuals.
        size = np.sqrt(_mahalanobis_sq(residual, views.covariance) / VALUES_PER_VIEW)
        weights = tukey_weights(size / max(1.0, float(np.median(size))), LEAST_VIEW_WEIGHT)
    counted = weights > 0.1
    # A view's own noise shows in its residual as far as the groove could not follow it.
    inverse = cho_solve(factor, np.eye(value.size)).reshape(*shape, *shape)
    own = np.einsum("ninj,nij->n", inverse, noise)
    degrees = max(float(own[counted].sum()) - 6, 1.0)
    reduced_chi2 = float(_mahalanobis_sq(residual, noise)[counted].sum()) / degrees
    centred = by_value - by_value.mean(axis=0)  # values count from their mean over the views
    by_points = views.by_points - slope[:, :, None, None] * views.azimuth_by_points
    return StationRegistration(
        overlap,
        pose_vector.pose_from_vector(motion),
        max(1.0, reduced_chi2) * spread,
        *_overlap_middle(overlap, first),
        reduced_chi2,
        azimuth[:, 2],
        residual[:, :CORNER_VALUES_PER_VIEW],
        of_second,
        counted,
        views.number.astype(np.intp),
        np.einsum("niv,nvkc->nikc", centred, by_points),
    )


def _mahalanobis_sq(residual: Array, covariance: Array) -> Array:
    """Squared standardised size of residuals (n, 10), shape (n,)."""
    standard = np.linalg.solve(covariance, residual[..., None])[..., 0]
    return np.asarray(np.sum(residual * standard, axis=1))


def _overlap_middle(overlap: StationOverlap, seen: UnrolledViews) -> tuple[Array, Array]:
    """Where a station saw the groove amid the overlap, and the groove's direction there."""
    order = np.argsort(np.abs(overlap.arc.offset_from_middle(seen.place)), kind="stable")
    centre = seen.middle[order[0]]
    # Prediction and correction views show nearly one place: the direction comes from another.
    far = np.linalg.norm(seen.middle[order] - centre, axis=1) > LEAST_VIEW_STEP
    return centre, unit_vector(seen.middle[order[np.argmax(far)]] - centre)


def _views_near_overlap(
    overlap: StationOverlap, first: UnrolledViews, second: UnrolledViews
) -> tuple[UnrolledViews, Mask]:
    """The views of both stations in and beside the overlap, and which are the second's."""
    reach = 0.5 * overlap.arc.span_angle + AZIMUTH_BEYOND_OVERLAP
    away = (np.abs(overlap.arc.offset_from_middle(o.place)) for o in (first, second))
    one, other = (o.select_views(off < reach) for o, off in zip((first, second), away, strict=True))
    return one.joined_with(other), np.repeat((False, True), (len(one), len(other)))


def _covariance_of_all_values(kernel: Array, noise: Array) -> Array:
    """Covariance of all values: the groove's, each value by itself, and the views', each apart."""
    n = len(noise)
    total = np.zeros((n, VALUES_PER_VIEW, n, VALUES_PER_VIEW))
    for value in range(VALUES_PER_VIEW):
        total[:, value, :, value] = kernel[:, :, value]
    views = np.arange(n)
    total[views, :, views, :] += noise
    return total.reshape(n * VALUES_PER_VIEW, n * VALUES_PER_VIEW)


@dataclass(frozen=True, slots=True, eq=False)
class StitchingDraft:
    """Stitching as far as it has come: stations, overlaps and registrations, for messages.

    Parameters
    ----------
    names : tuple of str
        Of the stations.
    azimuths : tuple of ndarray
        Of each station's sections, radians.
    overlaps : tuple of StationOverlap
        All of them, the small ones too.
    registrations : tuple of StationRegistration
        As far as it came.
    """

    names: tuple[str, ...]
    azimuths: tuple[Array, ...]
    overlaps: tuple[StationOverlap, ...]
    registrations: tuple[StationRegistration, ...] = ()

    def describe_overlap(self, overlap: StationOverlap) -> str:
        """Describe an overlap in a text: its stations, azimuth, length and sections."""
        a, b = self.names[overlap.first], self.names[overlap.second]
        one, other = overlap.sections
        return (
            f"stations {a} and {b} overlap at azimuth "
            f"{np.degrees(overlap.arc.middle_azimuth):.0f}° by "
            f"{np.degrees(overlap.arc.span_angle):.1f}° ({one} and {other} sections)"
        )

    def describe_coverage(self) -> str:
        """Describe in a text the azimuths that each station covers."""
        arcs = [arc_of_azimuths(azimuths) for azimuths in self.azimuths]
        return ", ".join(
            f"{name} reaches from {np.degrees(arc.start):.0f}° to {np.degrees(arc.end):.0f}°"
            for name, arc in zip(self.names, arcs, strict=True)
        )
