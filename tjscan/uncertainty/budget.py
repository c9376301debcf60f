"""The uncertainty budget of sections: components, combined and expanded as in the GUM [1]_.

A component states how the points and measures of all sections answer to independent standard normal
draws, to first order. A shared component is drawn once for all sections, so that they err alike;
another one is drawn again for each. All covariances follow, also those between sections, without a
matrix that is as large as the number of points squared.

References
----------
.. [1] JCGM 100:2008, Evaluation of measurement data - Guide to the expression of uncertainty in
   measurement, equations (13) and (18); JCGM 102:2011 for quantities of several dimensions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from tjscan.core.frames import Array, frozen_arrays, skew_matrix
from tjscan.groove.measured import MeasuredSection

COVERAGE_FACTOR: Final = 2.0
"""k of the expanded uncertainty: about 95 % of a normal distribution in one dimension. Of a
distance made up of several it covers 95 % or more."""

CORNER_POINTS: Final = slice(1, 4)
"""p2, p3 and p4 among the five points."""

NEGLIGIBLE_SHARE: Final = 1e-4
"""Share of a component's largest singular value below which a draw is left out."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class BudgetComponent:
    """One cause of uncertainty, and how n sections answer to m independent draws of it.

    Parameters
    ----------
    name : str
        The cause, such as ``arm, geometry``.
    evidence : str
        Where its size comes from: ``observed``, ``calibrated``, ``stated`` or ``assumed``.
    is_shared : bool
        Whether one draw moves all sections; else each has a draw of its own.
    points : ndarray, shape (n, 5, 3, m)
        How p1 to p5 move with each draw, in the frame of the result, metres.
    measures : ndarray, shape (n, 4, m)
        How groove angle (radians), root width, depth (metres) and area (m²) change.
    """

    name: str
    evidence: str
    is_shared: bool
    points: Array
    measures: Array

    @property
    def corner_covariances(self) -> Array:
        """Covariances of p2, p3 and p4 that it makes, shape (n, 3, 3, 3), m²."""
        corners = self.points[:, CORNER_POINTS]
        return np.asarray(corners @ np.swapaxes(corners, -1, -2))

    @property
    def measure_covariances(self) -> Array:
        """Covariances of the measures that it makes, shape (n, 4, 4)."""
        return np.asarray(self.measures @ np.swapaxes(self.measures, -1, -2))

    def compressed(self) -> BudgetComponent:
        """The same covariances from as few draws as make a difference; a shared one only."""
        n, m = len(self.points), self.points.shape[-1]
        if not self.is_shared or m < 2:
            return self
        flat = np.concatenate((self.points.reshape(-1, m), self.measures.reshape(-1, m)))
        size = np.sqrt(np.mean(flat[: 15 * n] ** 2)), np.sqrt(np.mean(flat[15 * n :] ** 2))
        scale = np.repeat(np.where(np.array(size) > 0, size, 1.0), (15 * n, 4 * n))
        _, singular, Vt = np.linalg.svd(flat / scale[:, None], full_matrices=False)
        kept = flat @ Vt[singular > NEGLIGIBLE_SHARE * singular[0]].T
        k = kept.shape[1]
        return replace(
            self,
            points=kept[: 15 * n].reshape(n, 5, 3, k),
            measures=kept[15 * n :].reshape(n, 4, k),
        )


@dataclass(frozen=True, slots=True, eq=False)
class SectionShare:
    """How a section counts in another one that is made of several.

    Parameters
    ----------
    number : int
        Which section.
    points : ndarray, shape (5, 3, 3)
        How p1 to p5 of the new one move with its own.
    measures : ndarray, shape (4, 4)
        How the measures do.
    """

    number: int
    points: Array
    measures: Array

    @classmethod
    def whole_section(cls, number: int) -> Self:
        """Share of a section that is taken as it is."""
        return cls(number, np.tile(np.eye(3), (5, 1, 1)), np.eye(4))


@dataclass(frozen=True, slots=True, eq=False)
class UncertaintyBudget:
    """All components of the uncertainty of n sections; they are independent of each other.

    Parameters
    ----------
    components : tuple of BudgetComponent
        One at least.
    """

    components: tuple[BudgetComponent, ...]

    @property
    def corner_covariances(self) -> Array:
        """Combined covariances of p2, p3 and p4, shape (n, 3, 3, 3), m²."""
        return np.asarray(sum(one.corner_covariances for one in self.components))

    @property
    def shared_corner_sigmas(self) -> Array:
        """Standard deviation that corners share with other sections, shape (n, 3), metres.

        All directions together.
        """
        shared = [one.corner_covariances for one in self.components if one.is_shared]
        total = np.sum(shared, axis=0) if shared else np.zeros((len(self), 3, 3, 3))
        return np.asarray(np.sqrt(np.trace(total, axis1=-2, axis2=-1)))

    @property
    def measure_covariances(self) -> Array:
        """Combined covariances of the measures, shape (n, 4, 4)."""
        return np.asarray(sum(one.measure_covariances for one in self.components))

    def __len__(self) -> int:
        return len(self.components[0].points)

    def covariance_between(self, one: tuple[int, int], other: tuple[int, int]) -> Array:
        """Covariance of two points, shape (3, 3), m².

        Parameters
        ----------
        one, other : tuple of (int, int)
            Which section, and which of its points, 0 for p1.
        """
        total = np.zeros((3, 3))
        for part in self.components:
            if part.is_shared or one[0] == other[0]:
                total += part.points[one] @ part.points[other].T
        return total

    def rotated(self, R: Array) -> UncertaintyBudget:
        """The same budget in a frame in which this one's axes are the columns of R, (3, 3)."""
        return self._with_points(lambda points: np.einsum("ij,nkjm->nkim", R, points))

    def made_of(self, shares: Sequence[Sequence[SectionShare]]) -> UncertaintyBudget:
        """The budget of sections each of which is made of one or several of these.

        Parameters
        ----------
        shares : sequence of sequence of SectionShare
            What each new section is made of.
        """
        return UncertaintyBudget(tuple(_made_of(one, shares) for one in self.components))

    def stated_in(self, sections: Sequence[MeasuredSection]) -> tuple[MeasuredSection, ...]:
        """The sections, in their order, with the covariances that the budget gives them."""
        corners, measures = self.corner_covariances, self.measure_covariances
        shared = self.shared_corner_sigmas
        return tuple(
            replace(
                section,
                covariances=corners[k],
                measure_covariance=measures[k],
                shared_sigmas=shared[k],
            )
            for k, section in enumerate(sections)
        )

    def _with_points(self, change: Callable[[Array], Array]) -> UncertaintyBudget:
        return UncertaintyBudget(
            tuple(replace(one, points=change(one.points)) for one in self.components)
        )


def _made_of(
    component: BudgetComponent, shares: Sequence[Sequence[SectionShare]]
) -> BudgetComponent:
    """A component of sections made of others: what is not shared keeps draws of its own."""
    m = component.points.shape[-1]
    copies = 1 if component.is_shared else max(len(parts) for parts in shares)
    points, measures = (
        np.zeros((len(shares), 5, 3, copies * m)),
        np.zeros((len(shares), 4, copies * m)),
    )
    for k, parts in enumerate(shares):
        for i, share in enumerate(parts):
            first = 0 if component.is_shared else i * m
            own = slice(first, first + m)
            points[k, ..., own] += share.points @ component.points[share.number]
            measures[k, ..., own] += share.measures @ component.measures[share.number]
    return replace(component, points=points, measures=measures)


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


def covariance_factor(covariance: Array) -> Array:
    """Factor L, shape (k, k), with L @ L.T the covariance, which may be singular.

    Parameters
    ----------
    covariance : ndarray, shape (..., k, k)
        Symmetric and not negative, but for rounding.
    """
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])
