"""The uncertainty budget of sections: components, combined and expanded as in the GUM [1]_.

A component states how the points and measures of all sections answer to independent standard normal
draws, to first order. A shared component is drawn once for all sections, so that they err alike;
another one is drawn again for each. All covariances follow, also those between sections, without a
matrix that is as large as the number of points squared.

It is summarised in a few numbers, and states what an alignment to the joint leaves of it.

References
----------
.. [1] JCGM 100:2008, Evaluation of measurement data - Guide to the expression of uncertainty in
   measurement, equations (13) and (18); JCGM 102:2011 for quantities of several dimensions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from tjscan.core.frames import Array, Mask, array_dataclass, skew_matrix
from tjscan.core.units import DEG, MM, MM2
from tjscan.groove.measured import MeasuredSection

COVERAGE_FACTOR: Final = 2.0
"""k of the expanded uncertainty: about 95 % of a normal distribution in one dimension. Of a
distance made up of several it covers 95 % or more."""

CORNER_POINTS: Final = slice(1, 4)
"""p2, p3 and p4 among the five points."""

NEGLIGIBLE_DRAW_SHARE: Final = 1e-4
"""Share of a component's largest singular value below which a draw is left out."""


@array_dataclass
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

    def with_fewest_draws(self) -> BudgetComponent:
        """The same covariances from as few draws as make a difference; a shared one only."""
        n, m = len(self.points), self.points.shape[-1]
        if not self.is_shared or m < 2:
            return self
        flat = np.concatenate((self.points.reshape(-1, m), self.measures.reshape(-1, m)))
        size = np.sqrt(np.mean(flat[: 15 * n] ** 2)), np.sqrt(np.mean(flat[15 * n :] ** 2))
        scale = np.repeat(np.where(np.array(size) > 0, size, 1.0), (15 * n, 4 * n))
        _, singular, Vt = np.linalg.svd(flat / scale[:, None], full_matrices=False)
        kept = flat @ Vt[singular > NEGLIGIBLE_DRAW_SHARE * singular[0]].T
        k = kept.shape[1]
        points, measures = np.split(kept, (15 * n,))
        return replace(self, points=points.reshape(n, 5, 3, k), measures=measures.reshape(n, 4, k))


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

    def rotated_budget(self, R: Array) -> UncertaintyBudget:
        """The same budget in a frame in which this one's axes are the columns of R, (3, 3)."""
        turned = (np.einsum("ij,nkjm->nkim", R, one.points) for one in self.components)
        pairs = zip(self.components, turned, strict=True)
        return UncertaintyBudget(tuple(replace(one, points=points) for one, points in pairs))

    def fuse_sections(self, shares: Sequence[Sequence[SectionShare]]) -> UncertaintyBudget:
        """The budget of sections that are each made of one or several of these.

        Parameters
        ----------
        shares : sequence of sequence of SectionShare
            What each new section is made of.
        """
        return UncertaintyBudget(tuple(_fused_component(one, shares) for one in self.components))

    def sections_with_covariances(
        self, sections: Sequence[MeasuredSection]
    ) -> tuple[MeasuredSection, ...]:
        """The sections, in their order, with the covariances that the budget gives them."""
        stated = zip(
            sections,
            self.corner_covariances,
            self.measure_covariances,
            self.shared_corner_sigmas,
            strict=True,
        )
        return tuple(
            replace(section, covariances=C, measure_covariance=M, shared_sigmas=sigmas)
            for section, C, M, sigmas in stated
        )


def _fused_component(
    component: BudgetComponent, shares: Sequence[Sequence[SectionShare]]
) -> BudgetComponent:
    """A component of sections made of others: what is not shared keeps draws of its own."""
    m = component.points.shape[-1]
    copies = 1 if component.is_shared else max(len(parts) for parts in shares)
    points = np.zeros((len(shares), 5, 3, copies * m))
    measures = np.zeros((len(shares), 4, copies * m))
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


ALIGNMENT_CAUSE: Final = "alignment"

WALL_POINT_INDICES: Final = (0, 1, 3, 4)
"""p1 and p2 lie on the brace's wall, p4 and p5 on the leg."""


def aligned_budget(
    budget: UncertaintyBudget, points: Array, normals: Array, *, by_tubes: bool
) -> UncertaintyBudget:
    """Budget of sections that were brought onto a reference by their walls.

    What the components share moves the walls, too, and the alignment takes back what of it looks
    like a motion of all: that part is gone. What each section has for itself moves the alignment
    a little, which all sections then share. The alignment counts as a least-squares fit of the
    walls' distances at p1, p2, p4 and p5, all alike.

    Parameters
    ----------
    budget : UncertaintyBudget
        Of n sections, before.
    points : ndarray, shape (n, 5, 3)
        p1 to p5, in the frame of the budget, metres; the joint's if tubes are fitted.
    normals : ndarray, shape (n, 2, 3)
        Of the brace's wall and of the leg, at each section.
    by_tubes : bool
        Whether tubes of any size were fitted, as they are to find a joint's own frame; else what
        was measured was laid on the reference as it is.
    """
    n = len(points)
    at = points[:, WALL_POINT_INDICES].reshape(-1, 3)
    across = normals[:, (0, 0, 1, 1)].reshape(-1, 3)
    turned = np.cross(at, across)
    columns = [across, turned]
    if by_tubes:
        # Radii, and how the leg is beside and under the brace: offset along y, turn about it.
        on_leg = np.tile((0.0, 0.0, 1.0, 1.0), n)
        shift, turn = on_leg * across[:, 1], on_leg * turned[:, 1]
        columns.append(np.column_stack((1 - on_leg, on_leg, shift, turn)))
    taken_back = -np.linalg.pinv(np.concatenate(columns, axis=1))[:6]
    components, own = [], np.zeros((6, 6))
    for one in budget.components:
        m = one.points.shape[-1]
        off = np.einsum("kc,kcm->km", across, one.points[:, WALL_POINT_INDICES].reshape(-1, 3, m))
        if one.is_shared:
            moved = points_moved_by_twist(points, taken_back @ off)
            one = replace(one, points=one.points + moved)
        else:
            by_section = taken_back.reshape(6, n, 4).transpose(1, 0, 2) @ off.reshape(n, 4, m)
            own += np.einsum("nim,njm->ij", by_section, by_section)
        components.append(one)
    place = points_moved_by_twist(points, covariance_factor(own))
    found = BudgetComponent(ALIGNMENT_CAUSE, "observed", True, place, np.zeros((n, 4, 6)))
    return UncertaintyBudget((*components, found))


TYPICAL_QUANTILES: Final = (0.4, 0.6)
"""Quantiles between which a corner's combined uncertainty counts as typical."""

COMBINED_ROW_NAME: Final = "combined"

MEASURE_UNITS: Final = np.array((DEG.factor, MM.factor, MM.factor, MM2.factor))


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """Standard uncertainties of typical corners and measures by one cause, or all together.

    Parameters
    ----------
    name, evidence : str
        The cause, and where its size comes from: observed, calibrated, stated or assumed.
    shared : bool
        Whether all sections err alike by it.
    corner_mm : float
        Of the place of a corner, all directions together.
    groove_angle_deg, root_width_mm, depth_mm, area_mm2 : float
        Of the measures.
    """

    name: str
    evidence: str
    shared: bool
    corner_mm: float
    groove_angle_deg: float
    root_width_mm: float
    depth_mm: float
    area_mm2: float


@dataclass(frozen=True, slots=True)
class BudgetSummary:
    """A budget in a few numbers, of the middle fifth of all corners and measures.

    Squares of the components add up to the square of what is combined.

    Parameters
    ----------
    components : tuple of BudgetRow
        By cause.
    combined, expanded : BudgetRow
        Combined standard uncertainty, and that times the coverage factor.
    coverage_factor : float
        k.
    left_out : tuple of str
        What may err and is not in the budget, since nothing states how far.
    """

    components: tuple[BudgetRow, ...]
    combined: BudgetRow
    expanded: BudgetRow
    coverage_factor: float = COVERAGE_FACTOR
    left_out: tuple[str, ...] = ()


def budget_in_words(budget: BudgetSummary) -> str:
    """The combined and expanded uncertainty of a corner, and what makes most of it."""
    most = max(budget.components, key=lambda one: one.corner_mm)
    return (
        f"a corner is known to {budget.combined.corner_mm:.3f} mm (standard uncertainty), "
        f"{budget.expanded.corner_mm:.3f} mm expanded with k = {budget.coverage_factor:g}; most of "
        f"it by {most.name} ({most.evidence}, {most.corner_mm:.3f} mm)"
    )


def summarise_budget(
    budget: UncertaintyBudget, seen: Mask, left_out: Sequence[str] = ()
) -> BudgetSummary:
    """Summarise a budget.

    Parameters
    ----------
    budget : UncertaintyBudget
        Of n sections.
    seen : ndarray of bool, shape (n, 3)
        Which of p2, p3 and p4 count: those that are absent don't.
    left_out : sequence of str
        What is not in the budget.
    """
    total = _middle_quantiles_mask(np.trace(budget.corner_covariances, axis1=-2, axis2=-1), seen)
    whole = np.diagonal(budget.measure_covariances, axis1=-2, axis2=-1)
    typical = [_middle_quantiles_mask(whole[:, k], np.ones(len(whole), bool)) for k in range(4)]
    combined = np.zeros(5)
    rows = []
    for one in budget.components:
        corners = np.trace(one.corner_covariances, axis1=-2, axis2=-1)[total].mean()
        by_measure = np.diagonal(one.measure_covariances, axis1=-2, axis2=-1)
        variances = [corners, *(by_measure[which, k].mean() for k, which in enumerate(typical))]
        combined += variances
        rows.append(_budget_row(one.name, one.evidence, one.is_shared, np.sqrt(variances)))
    sigma = np.sqrt(combined)
    return BudgetSummary(
        tuple(rows),
        _budget_row(COMBINED_ROW_NAME, "", False, sigma),
        _budget_row(f"expanded, k = {COVERAGE_FACTOR:g}", "", False, COVERAGE_FACTOR * sigma),
        left_out=tuple(left_out),
    )


def _middle_quantiles_mask(variances: Array, counted: Mask) -> Mask:
    """Which of the variances that count are in the middle; all that count if none is."""
    chosen = variances[counted] if counted.any() else variances
    low = np.quantile(chosen, TYPICAL_QUANTILES[0], method="lower")
    high = np.quantile(chosen, TYPICAL_QUANTILES[1], method="higher")
    amid = (variances >= low) & (variances <= high)
    return np.asarray(amid & counted if counted.any() else amid)


def _budget_row(name: str, evidence: str, shared: bool, sigmas: Array) -> BudgetRow:
    corner, *measures = sigmas.tolist()
    values = (np.array(measures) / MEASURE_UNITS).tolist()
    return BudgetRow(name, evidence, shared, corner / MM.factor, *values)
