"""A groove fitted to bare steel: without mill scale, and behind where light pulls its notch in."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.curves import CubicCurve
from tjscan.groove.fit import GrooveCandidate
from tjscan.groove.fitted_profile import (
    FittedProfile,
    OrderedProfilePoints,
    corners_between_sides,
)
from tjscan.groove.prior import (
    NOTCH_PULLS,
    SCALE_THICKNESSES,
    GroovePrior,
    SectionEvidence,
    posterior,
)
from tjscan.groove.pulled_notch import (
    PULL_DOUBT,
    closeness_to_notch,
    estimate_pull,
    sines_with_rays,
)
from tjscan.groove.refinement import refine_fit
from tjscan.groove.scale import TwoLevels, find_two_levels

MISLED_SHARE: Final = 0.02
"""Share of the profiles whose flanks are none of what the model of a pull has: they say nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class BareSteel:
    """A groove's candidate on bare steel.

    Parameters
    ----------
    row : OrderedProfilePoints
        The points, moved to the steel.
    found : GrooveCandidate
        Fitted to them.
    covariance : ndarray, shape (2 k, 2 k)
        What the doubt about scale and pull adds to that of corners and outer sides' angles.
    evidence : SectionEvidence
        What the profile says by itself of what persists along the groove.
    """

    row: OrderedProfilePoints
    found: GrooveCandidate
    covariance: Array
    evidence: SectionEvidence


def find_bare_steel(
    row: OrderedProfilePoints, found: GrooveCandidate, prior: GroovePrior, tolerance: float
) -> BareSteel:
    """Move points to the steel, and fit the groove to them again.

    Parameters
    ----------
    row : OrderedProfilePoints
    found : GrooveCandidate
        Of any form of a tee.
    prior : GroovePrior
        What is known from the sections before.
    tolerance : float
        Distance within which a point belongs to a side, in metres.
    """
    sides = found.model.sides
    last = len(sides) - 1
    covariance = np.zeros((2 * last + 2,) * 2)
    has_face = found.model.has_root_bead
    notch = found.fitted.corners[-2:] if has_face else found.fitted.corners[-1:]
    expected_pull = float(np.exp(prior.log_pulls) @ NOTCH_PULLS) if has_face else 0.0
    pulled = expected_pull * closeness_to_notch(row.points, notch)
    levels: dict[int, TwoLevels] = {}
    for k in (0, last):
        own = found.fitted.points_of(k)
        square = np.zeros(len(row.points))
        square[own] = sines_with_rays(found.fitted.curves[k], row.points[own])
        seen = find_two_levels(row, found.fitted, k, sides[k], pulled * square)
        if seen is not None:
            levels[k] = seen
    log_thicknesses = sum(
        (seen.log_likelihoods for seen in levels.values()), np.zeros(len(SCALE_THICKNESSES))
    )
    thickness = _if_likely(SCALE_THICKNESSES, posterior(prior.log_thicknesses, log_thicknesses))
    back = np.zeros(len(row.points))
    bends, sigmas = np.zeros(2), np.full(2, np.inf)
    curves = list(found.fitted.curves)
    for k, seen in levels.items():
        own = found.fitted.points_of(k)
        steel = seen.find_steel(thickness)
        bends[int(k > 0)], sigmas[int(k > 0)] = steel.bend, steel.bend_sigma
        if not thickness:
            continue
        back[own] = steel.on_scale * thickness / sines_with_rays(seen.base, row.points[own])
        curves[k] = steel.curve
        corner = 0 if k == 0 else last - 1
        s = seen.base.position_along_chord(*found.fitted.corners[corner].tolist())
        shift = corner_shift(found.fitted, corner, k)
        index = slice(2 * corner, 2 * corner + 2)
        doubt = seen.height_variance(thickness, s)
        covariance[index, index] += doubt * np.outer(shift, shift)
    row, found = _moved(row, found, back, tolerance, tuple(curves))

    log_pulls = np.zeros(len(NOTCH_PULLS))
    if has_face:
        log_pulls = _log_pulls(row, found, back)
        probability = posterior(prior.log_pulls, log_pulls)
        pull = _if_likely(NOTCH_PULLS, probability)
        doubt = float(probability @ (NOTCH_PULLS - pull) ** 2) + (PULL_DOUBT * pull) ** 2
        shift = np.zeros(2 * last + 2)
        for corner in (last - 2, last - 1):
            at = found.fitted.corners[corner][None]
            sine = float(sines_with_rays(found.fitted.curves[last - 1], at)[0])
            shift[2 * corner : 2 * corner + 2] = sine * corner_shift(found.fitted, corner, last - 1)
        covariance += doubt * np.outer(shift, shift)
        closeness = closeness_to_notch(row.points, found.fitted.corners[-2:])
        # At its ends the face is pulled in most. Few of its points would be bent by less between.
        closeness[found.fitted.points_of(last - 1)] = 1.0
        back = pull * closeness
        curves = list(found.fitted.curves)
        face = curves[last - 1]
        middle = np.array([face.points_at(found.fitted.middles[last - 1])])
        deeper = pull * float(sines_with_rays(face, middle)[0])
        curves[last - 1] = face._replace(c0=face.c0 + deeper)
        row, found = _moved(row, found, back, tolerance, tuple(curves))
    evidence = SectionEvidence(bends, sigmas, log_pulls, log_thicknesses, found.model.name)
    return BareSteel(row, found, covariance, evidence)


def _log_pulls(row: OrderedProfilePoints, found: GrooveCandidate, back: Array) -> Array:
    """Log-likelihood of each of `NOTCH_PULLS`.

    Where points about the notch were moved back, (n,) metres, what was taken for scale may as
    well be pulled.
    """
    fitted = found.fitted
    rays = row.points / np.linalg.norm(row.points, axis=1)[:, None]
    doubtful = np.where(closeness_to_notch(row.points, fitted.corners[-2:]) > 0, back, 0.0)
    rows = [row]
    if doubtful.any():
        rows.append(replace(row, points=row.points - doubtful[:, None] * rays))
    likelihood = np.zeros(len(NOTCH_PULLS))
    for one in rows:
        pull, sigma = estimate_pull(one, fitted, found.model)
        if isfinite(sigma):
            spread = np.hypot(sigma, PULL_DOUBT * NOTCH_PULLS)
            density = sigma / spread * np.exp(-0.5 * ((pull - NOTCH_PULLS) / spread) ** 2)
            likelihood += ((1 - MISLED_SHARE) * density + MISLED_SHARE) / len(rows)
        else:
            likelihood += 1 / len(rows)
    return np.log(likelihood)


def _if_likely(values: Array, probability: Array) -> float:
    """What there is if anything is, in metres; zero, the first value, where nothing likely is."""
    there = 1 - float(probability[0])
    return float(probability @ values) / there if there > 0.5 else 0.0


def _moved(
    row: OrderedProfilePoints,
    found: GrooveCandidate,
    back: Array,
    tolerance: float,
    curves: tuple[CubicCurve, ...],
) -> tuple[OrderedProfilePoints, GrooveCandidate]:
    """Points moved away from the sensor along their rays, (n,) metres, and the groove in them.

    It is fitted from `curves` on.
    """
    met = corners_between_sides(curves, found.fitted.corners)
    if met is None or not back.any():
        return row, found
    rays = row.points / np.linalg.norm(row.points, axis=1)[:, None]
    moved = replace(row, points=(row.points + back[:, None] * rays).T.copy().T)
    again = refine_fit(moved, curves, met[0], found.model.sides, tolerance, annealed=False)
    return (row, found) if again is None else (moved, replace(found, fitted=again))


def corner_shift(fitted: FittedProfile, corner: int, side: int) -> Array:
    """By how much a corner moves, shape (2,), per metre that one of its sides lies farther back.

    Parameters
    ----------
    fitted : FittedProfile
    corner : int
        Number of the corner.
    side : int
        Number of the side before it or after it.
    """
    j = side - corner
    own = fitted.curves[side].tangent_at(fitted.places[corner][j])
    tx, tz = fitted.curves[corner + 1 - j].tangent_at(fitted.places[corner][1 - j])
    return np.array((tx, tz)) / (tx * own[1] - tz * own[0])
