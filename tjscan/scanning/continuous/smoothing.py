"""Corners along the groove, smoothed: a local fit beside the sections, never across a change."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, inverse_pose, unit_vector
from tjscan.groove.root import ROOT_NOT_SEEN, SEAM_BESIDE
from tjscan.groove.section import FROM_NEIGHBOURS
from tjscan.scanning.seam_fit import ARM_REPEATABILITY
from tjscan.scanning.section import ScannedSection, Sections, Substep
from tjscan.scanning.sections_before import name_tack_ends, section_with_corners

HALF_WIDTH: Final = 12e-3
"""Metres to either side over which a corner's way is a parabola: the bend of the tightest groove
changes it by micrometres there, and a bevel of two facets is misread for ten millimetres on end."""

FEWEST_NEIGHBOURS: Final = 5
"""Sections within the width below which a corner stays as it was read."""

JUMP_SIGMAS: Final = 4.0
"""Standard deviations by which two sections in a row must leave the way of those before them where
something begins."""

SECTIONS_BEFORE_A_JUMP: Final = 4
"""Sections whose straight way is carried on to find one."""

LARGEST_CONTRADICTION: Final = 0.35e-3
"""Metres from where its neighbours show a corner up to which it counts as read: undulation of a
ground bevel and what is stated of a good reading are less."""

CONTRADICTION_SIGMAS: Final = 2.5
"""Standard deviations of where they show it, at least."""

REWEIGHTING_ROUNDS: Final = 3
OUTLIER_SIGMAS: Final = 3.0
"""Standard deviations at which a section begins to count less."""


def finished_sections(sections: Sections) -> tuple[ScannedSection, ...]:
    """The sections of a whole scan as they are given.

    Tack welds are named to their ends, see `name_tack_ends`. A corner far from where its
    neighbours show it is given as they do, and its section is named: single readings of scaled,
    scalloped faces err by as much, their neighbours otherwise. Those of a stepwise scan stay as
    they are.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of the scan, in order.
    """
    named = name_tack_ends(sections)
    given = list(named)
    if not any(section.view.substep is Substep.FUSED for section in named):
        return named
    for k, stretch in _stretches(named):
        for i, number in enumerate(stretch.numbers):
            shown = stretch.place_at(i, own=False)
            if shown is None:
                continue
            off = np.linalg.norm(_across(stretch.way[i] - shown.point, shown.direction))
            if off > max(LARGEST_CONTRADICTION, CONTRADICTION_SIGMAS * shown.sigma):
                given[number] = _corrected(given[number], k, shown)
    return tuple(given)


def smooth_corners(sections: Sections) -> Array:
    """p2, p3 and p4 of each section by a robust parabola through its neighbours.

    Parameters
    ----------
    sections : sequence of ScannedSection
        In order along the groove.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Metres in frame b; not a number where a corner is not seen. A corner with few neighbours of
        its kind is as it was read.
    """
    smooth = np.full((len(sections), 3, 3), np.nan)
    for k, stretch in _stretches(sections):
        for i, number in enumerate(stretch.numbers):
            shown = stretch.place_at(i, own=True)
            smooth[number, k] = stretch.way[i] if shown is None else shown.point
    return smooth


@dataclass(frozen=True)
class _Place:
    """Where a corner is by its neighbours, the way there, and a standard deviation; in frame b."""

    point: Array
    direction: Array
    sigma: float


@dataclass(frozen=True)
class _Stretch:
    """One corner along sections of one form, one condition, and no jump.

    Parameters
    ----------
    numbers : ndarray of int, shape (m,)
        Of the sections in which it is seen.
    along, sigmas : ndarray, shape (m,)
        Metres along the groove; standard deviation on one axis.
    way : ndarray, shape (m, 3)
        Its places in frame b, metres.
    """

    numbers: NDArray[np.intp]
    along: Array
    sigmas: Array
    way: Array

    def place_at(self, i: int, *, own: bool) -> _Place | None:
        """Where section i has the corner by a robust parabola, through itself, too, if `own`.

        Near an end of the stretch through as many sections as elsewhere. None if they are few.
        """
        ends = self.along[0] + HALF_WIDTH, self.along[-1] - HALF_WIDTH
        middle = min(max(self.along[i], ends[0]), max(ends))
        near = np.abs(self.along - middle) <= HALF_WIDTH
        near[i] = own
        if np.count_nonzero(near) < FEWEST_NEIGHBOURS:
            return None
        way, sigma = self.way[near], self.sigmas[near]
        powers = np.vander((self.along[near] - self.along[i]) / HALF_WIDTH, 3, increasing=True)
        weight = 1.0 / sigma
        for _ in range(REWEIGHTING_ROUNDS):
            rows = weight[:, None] * powers
            fit, *_ = np.linalg.lstsq(rows, weight[:, None] * way, rcond=None)
            off = np.linalg.norm(way - powers @ fit, axis=1)
            weight = 1.0 / (sigma * np.maximum(1.0, off / (OUTLIER_SIGMAS * sigma)))
        variance = float(np.linalg.inv(rows.T @ rows)[0, 0])
        # Neighbours err alike: they are no surer together than they scatter.
        return _Place(fit[0], fit[1], sqrt(variance + 0.5 * float(np.median(off)) ** 2))


def _stretches(sections: Sections) -> Iterator[tuple[int, _Stretch]]:
    """Each stretch, with the number of its corner: 0 to 2 for p2 to p4."""
    corners = np.array([section.points_b[1:4] for section in sections])
    covariances = np.array([section.groove.corner_covariances_s for section in sections])
    sigmas = np.sqrt(0.5 * np.trace(covariances, axis1=2, axis2=3) + ARM_REPEATABILITY**2)
    chords = np.linalg.norm(np.diff([section.T_b_g[:3, 3] for section in sections], axis=0), axis=1)
    along = np.append(0.0, chords.cumsum())
    for k, name in enumerate(("p2", "p3", "p4")):
        seen = np.array([name not in section.groove.absent for section in sections])
        for part in _alike(sections, along, corners[:, k], sigmas[:, k]):
            own = part[seen[part]]
            if len(own):
                yield k, _Stretch(own, along[own], sigmas[own, k], corners[own, k])


def _corrected(section: ScannedSection, k: int, shown: _Place) -> ScannedSection:
    """A section with a corner, 0 to 2 for p2 to p4, where its neighbours show it."""
    T_s_b, groove = inverse_pose(section.view.T_b_s), section.groove
    point = T_s_b[:3, :3] @ shown.point + T_s_b[:3, 3]
    way = T_s_b[:3, :3] @ shown.direction
    points, covariance = groove.points_s.copy(), groove.covariance_s.copy()
    points[k + 1, [0, 2]] = (point - point[1] / way[1] * way)[[0, 2]]
    own = slice(2 * k, 2 * k + 2)
    covariance[own] = covariance[:, own] = 0.0
    covariance[own, own] = shown.sigma**2 * np.eye(2)
    before = section_with_corners(groove, groove.points_s, groove.covariance_s)
    after = section_with_corners(groove, points, covariance)
    conditions = tuple(dict.fromkeys((*groove.conditions, FROM_NEIGHBOURS)))
    area = groove.area + after.area - before.area  # over the root's face, as it was read
    return replace(section, groove=replace(after, area=area, conditions=conditions))


def _alike(sections: Sections, along: Array, way: Array, sigma: Array) -> list[NDArray[np.intp]]:
    """Numbers of the sections of each stretch of one form, one condition, and no jump."""
    forms: list[tuple[object, ...]] = [()]
    for section in sections:
        forms.append(_form(section) or forms[-1])
    changes = [one != next_ for one, next_ in pairwise(forms[1:])]
    jumps = _jumps(along, way, sigma) | _jumps(-along[::-1], way[::-1], sigma[::-1])[::-1]
    breaks = np.flatnonzero(np.array(changes, dtype=bool) | jumps) + 1
    return np.split(np.arange(len(sections)), breaks)


def _form(section: ScannedSection) -> tuple[object, ...]:
    """What the groove is like; empty where the root was not seen: as before, then."""
    # With these nothing changes.
    conditions = set(section.groove.conditions) - {SEAM_BESIDE, FROM_NEIGHBOURS}
    return () if ROOT_NOT_SEEN in conditions else (section.groove.absent, conditions)


def _jumps(along: Array, way: Array, sigma: Array) -> NDArray[np.bool_]:
    """After which sections two in a row leave the straight way of those before, shape (n - 1,)."""
    n, found = SECTIONS_BEFORE_A_JUMP, np.zeros(max(len(way) - 1, 0), dtype=bool)
    for i in range(n - 1, len(way) - 2):
        before = slice(i - n + 1, i + 1)
        line = np.column_stack((np.ones(n), along[before] - along[i]))
        A = line / sigma[before, None]
        fit, *_ = np.linalg.lstsq(A, way[before] / sigma[before, None], rcond=None)
        left = np.linalg.norm(way[before] - line @ fit, axis=1)
        if (left > JUMP_SIGMAS * sigma[before]).any():  # what lies on no line leads nowhere
            continue
        spread = np.linalg.inv(A.T @ A)
        for later in (i + 1, i + 2):
            row = np.array((1.0, along[later] - along[i]))
            expected = np.sqrt(sigma[later] ** 2 + row @ spread @ row)
            off = _across(way[later] - row @ fit, fit[1])
            if np.linalg.norm(off) <= JUMP_SIGMAS * expected:
                break
        else:
            found[i] = True
    return found


def _across(off: Array, direction: Array) -> Array:
    """The part of an offset, shape (3,), that is square to a direction of any length."""
    along = unit_vector(direction)
    return np.asarray(off - (off @ along) * along)
