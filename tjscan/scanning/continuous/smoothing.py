"""Corners along the groove, smoothed: a local fit beside the sections, never across a change."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, unit_vector
from tjscan.groove.root import ROOT_NOT_SEEN, SEAM_BESIDE
from tjscan.scanning.seam_fit import ARM_REPEATABILITY
from tjscan.scanning.section import ScannedSection, Sections

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

REWEIGHTING_ROUNDS: Final = 3
OUTLIER_SIGMAS: Final = 3.0
"""Standard deviations at which a section begins to count less."""


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
    corners = np.array([section.points_b[1:4] for section in sections])
    covariances = np.array([section.groove.corner_covariances_s for section in sections])
    sigmas = np.sqrt(0.5 * np.trace(covariances, axis1=2, axis2=3) + ARM_REPEATABILITY**2)
    chords = np.linalg.norm(np.diff([section.T_b_g[:3, 3] for section in sections], axis=0), axis=1)
    along = np.append(0.0, chords.cumsum())
    smooth = corners.copy()
    for k, name in enumerate(("p2", "p3", "p4")):
        smooth[[name in section.groove.absent for section in sections], k] = np.nan
        for part in _alike(sections, along, corners[:, k], sigmas[:, k]):
            smooth[part, k] = _smooth_way(along[part], smooth[part, k], sigmas[part, k])
    return smooth


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
    conditions = set(section.groove.conditions) - {SEAM_BESIDE}  # beside, nothing changes
    return () if ROOT_NOT_SEEN in conditions else (section.groove.absent, conditions)


def _jumps(along: Array, way: Array, sigma: Array) -> NDArray[np.bool_]:
    """After which sections two in a row leave the straight way of those before, shape (n - 1,)."""
    n, found = SECTIONS_BEFORE_A_JUMP, np.zeros(max(len(way) - 1, 0), dtype=bool)
    for i in range(n - 1, len(way) - 2):
        s = along[i - n + 1 : i + 1] - along[i]
        weight = 1.0 / sigma[i - n + 1 : i + 1, None]
        A = weight * np.column_stack((np.ones(n), s))
        fit, *_ = np.linalg.lstsq(A, weight * way[i - n + 1 : i + 1], rcond=None)
        spread = np.linalg.inv(A.T @ A)
        for later in (i + 1, i + 2):
            row = np.array((1.0, along[later] - along[i]))
            expected = np.sqrt(sigma[later] ** 2 + row @ spread @ row)
            off = way[later] - row @ fit
            across = off - (off @ unit_vector(fit[1])) * unit_vector(fit[1])
            if np.linalg.norm(across) <= JUMP_SIGMAS * expected:
                break
        else:
            found[i] = True
    return found


def _smooth_way(along: Array, way: Array, sigma: Array) -> Array:
    """A corner's places by robust parabolas, shape (n, 3)."""
    smooth = way.copy()
    for i, s in enumerate(along):
        near = np.flatnonzero((np.abs(along - s) <= HALF_WIDTH) & np.isfinite(way[:, 0]))
        if len(near) < FEWEST_NEIGHBOURS or not np.isfinite(way[i, 0]):
            continue
        A = np.vander((along[near] - s) / HALF_WIDTH, 3, increasing=True)
        weight = 1.0 / sigma[near]
        for _ in range(REWEIGHTING_ROUNDS):
            fit, *_ = np.linalg.lstsq(weight[:, None] * A, weight[:, None] * way[near], rcond=None)
            off = np.linalg.norm(way[near] - A @ fit, axis=1) / (OUTLIER_SIGMAS * sigma[near])
            weight = 1.0 / (sigma[near] * np.maximum(1.0, off))
        smooth[i] = fit[0]
    return smooth
