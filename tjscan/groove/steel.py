"""A fit on bare steel: without mill scale, and behind where light pulls its notch in.

Scale covers the outer sides in patches, a few tenths of a millimetre proud, with bare steel
between: two levels a step apart, the farther being the steel. One side often shows too little of
either level to separate a patch from its own bend: how thick scale is and how far the side bends is
known better from the sections before.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot, inf, log, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, unit_vectors
from tjscan.groove import kernel
from tjscan.groove.prior import (
    NOTCH_PULLS,
    SCALE_THICKNESSES,
    GroovePrior,
    SectionEvidence,
    posterior,
)
from tjscan.groove.refinement import refine_fit
from tjscan.groove.reflections import reflection_probability, without_seam_cap
from tjscan.groove.shape import pull_log_likelihoods
from tjscan.groove.sides import (
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    CubicCurve,
    FittedProfile,
    GrooveFit,
    Polyline,
    corners_between_sides,
)

PULL_REACH: Final = 4e-3
"""Distance from a notch in metres within which points are pulled in: real profiles
show 3 to 5 mm."""

PULL_RELATIVE_SIGMA: Final = 0.15
"""Share of itself by which a pull is uncertain, for its reach is."""

POINTS_PER_SCALE_BLOCK: Final = 6
"""Points that are averaged."""

INNER_POINTS: Final = slice(2, 4)
"""Those of a block, in the order of their heights, whose mean is its median."""

FEWEST_BLOCKS_OF_SIDE: Final = 5
"""Blocks of a side that show something."""

SURFACE_REACH: Final = 1.0e-3
"""Points this near a side, in metres, are of its surface or of what lies on it."""

BLOCK_UNDULATION: Final = 0.02e-3
"""Standard deviation, in metres, of a block of points beyond noise: no surface is a parabola."""

STEEPEST_SLOPE_UNDER_SCALE: Final = 0.06
"""Slope against the fitted side that the steel under scale may have."""

MOST_TRIED_SURFACES: Final = 160
TRIED_MIDDLES: Final = (0.35, 0.5, 0.65)
"""Most surfaces that are tried through three blocks, and where the second is between the others."""

STRAY_BLOCK_COST: Final = 9.0
"""What a block costs that lies on neither level, in squared standard deviations."""

SCALE_COVERED_SHARE: Final = 0.35
SCALE_PATCH_WIDTH: Final = 12e-3
"""Share of a surface that scale covers, and about how wide its patches are, in metres:
assumptions, after what tubes show that have lain in a yard."""

BLOCK_EVIDENCE_WEIGHT: Final = 0.5
"""Weight of a block's evidence: neighbours undulate together."""

MISTAKEN_LEVEL_SHARE: Final = 0.1
"""Share of the corners beside which steel is taken for scale, or scale for steel: one in ten of
simulated ones."""

MOST_REFLECTED_BESIDE_SCALE: Final = 0.08
"""Share of reflections up to which scale is looked for a second time."""

STEP_BLOCK, FEWEST_SCALE_STEPS = 5, 2
LEAST_SCALE_STEP: Final = 0.12e-3
"""Points of which medians are compared, how many steps from one to the next show scale in a single
profile, and how high these are, in metres: a wave of 0.2 mm in 10 mm rises by less."""

MOST_STEEL_ROUNDS: Final = 3


class SideOnSteel(NamedTuple):
    """What m points of an outer side show of the steel under mill scale.

    Parameters
    ----------
    log_thicknesses : ndarray, shape (n,)
        Log-likelihood of each of `SCALE_THICKNESSES`.
    bend, bend_sigma : float
        Of the steel as the points alone show it, and the standard deviation, in 1/m; infinite where
        they show none.
    thickness : float
        Of the scale, in metres; zero where there is most likely none.
    on_scale : ndarray of bool, shape (m,)
        Which points lie on scale.
    curve : CubicCurve
        The steel.
    height_variance : float
        Mean square by which other likely surfaces lie off it at the side's corner, in m².
    """

    log_thicknesses: Array
    bend: float
    bend_sigma: float
    thickness: float
    on_scale: NDArray[np.bool_]
    curve: CubicCurve
    height_variance: float


def _find_steel(fit: GrooveFit, k: int, known: Array) -> SideOnSteel | None:
    """Look at outer side k as two levels; None if it shows too little.

    `known` is the logarithm of what is known of each of `SCALE_THICKNESSES`.
    """
    fitted, side, own = fit.fitted, fit.model.sides[k], fit.fitted.spans[k]
    near = np.flatnonzero(np.abs(fitted.residuals[own]) < SURFACE_REACH)
    count = len(near) // POINTS_PER_SCALE_BLOCK
    if count < FEWEST_BLOCKS_OF_SIDE:
        return None
    base = fitted.curves[k].rebased_at_tangent(fitted.middles[k])
    s, d = base.local_coordinates(fit.row.points[own])
    corner = base.position_along_chord(*fitted.corners[0 if k == 0 else -1].tolist())
    d = d - base.c3 * s**3
    blocks = near[: count * POINTS_PER_SCALE_BLOCK].reshape(count, POINTS_PER_SCALE_BLOCK)
    along = s[blocks].mean(axis=1)
    heights = np.sort(d[blocks], axis=1)[:, INNER_POINTS].mean(axis=1)
    least = max(float(fitted.sigmas.min()), LEAST_NOISE)
    correlated = min(fitted.variance_inflation / POINTS_PER_SCALE_BLOCK, 1.0)
    sigma, expected = hypot(least * sqrt(correlated), BLOCK_UNDULATION), side.expected_bend or 0.0
    surfaces = np.vstack((_surfaces_through_blocks(along, heights), (base.c0, base.c1, base.c2)))
    off = heights - surfaces @ np.array((np.ones(count), along, along**2))
    costs = _scale_costs(off / sigma, SCALE_THICKNESSES / sigma, along)
    costs += ((surfaces[:, 2] - expected) / side.bend) ** 2
    cheapest = costs.min(axis=1)
    log_thicknesses = -0.5 * BLOCK_EVIDENCE_WEIGHT * (cheapest - cheapest[0])
    thickness = _mean_if_present(SCALE_THICKNESSES, posterior(known, log_thicknesses))
    cost = costs[int(np.abs(SCALE_THICKNESSES - thickness).argmin())]
    best = int(cost.argmin())
    known_bend = expected, side.bend
    on_scale, surface, bend, bend_sigma = _fit_steel(
        (s, d), surfaces[best], thickness, sigma, known_bend
    )
    c0, c1, c2 = surface.tolist()
    likely = np.exp(-0.5 * BLOCK_EVIDENCE_WEIGHT * (cost - cost[best]))
    away = (surfaces - surfaces[best]) @ np.array((1.0, corner, corner * corner))
    return SideOnSteel(
        np.asarray(log_thicknesses),
        bend,
        bend_sigma,
        thickness,
        on_scale,
        base._replace(c0=c0, c1=c1, c2=c2),
        float(likely @ away**2 / likely.sum()),
    )


def _fit_steel(
    points: tuple[Array, Array],
    surface: Array,
    thickness: float,
    sigma: float,
    known_bend: tuple[float, float],
) -> tuple[NDArray[np.bool_], Array, float, float]:
    """Which points, s and d, lie on scale; the steel; its bend and sigma by the points alone."""
    (s, d), (expected, spread) = points, known_bend
    basis = np.array((np.ones_like(s), s, s * s))
    known = np.diag((0.0, 0.0, spread**-2))
    for _ in range(MOST_STEEL_ROUNDS):
        off = d - surface @ basis
        on_scale = (np.abs(off + thickness) < np.abs(off)) & (thickness > 0)
        raised = np.where(on_scale, d + thickness, d)
        used = np.abs(raised - surface @ basis) < OUTLIER_SIGMAS * sigma
        if np.count_nonzero(used) < FEWEST_BLOCKS_OF_SIDE * POINTS_PER_SCALE_BLOCK:
            return on_scale, surface, expected, inf
        # A block's standard deviation is a mean's: its points count as one.
        weighted = basis[:, used] / (POINTS_PER_SCALE_BLOCK * sigma**2)
        information, seen = weighted @ basis[:, used].T, weighted @ raised[used]
        surface = np.asarray(np.linalg.solve(information + known, seen + known[2] * expected))
    alone = np.linalg.inv(information)
    return on_scale, surface, float((alone @ seen)[2]), sqrt(max(float(alone[2, 2]), 0.0))


def _surfaces_through_blocks(along: Array, heights: Array) -> Array:
    """Parabolas through three blocks each, shape (l, 3), that are not too steep for steel.

    The three are far apart, and evenly drawn of so many.
    """
    a, c = np.triu_indices(len(along), max(2, len(along) // 3))
    every = -(-len(a) // MOST_TRIED_SURFACES)
    a, c = a[::every], c[::every]
    b = np.clip(a + ((c - a) * np.resize(TRIED_MIDDLES, len(a))).astype(np.intp), a + 1, c - 1)
    first = (heights[b] - heights[a]) / (along[b] - along[a])
    bend = ((heights[c] - heights[b]) / (along[c] - along[b]) - first) / (along[c] - along[a])
    slope = first - bend * (along[a] + along[b])
    surfaces = np.array((heights[a] - along[a] * (slope + along[a] * bend), slope, bend)).T
    return np.asarray(surfaces[np.abs(slope) < STEEPEST_SLOPE_UNDER_SCALE])


def _scale_costs(off: Array, steps: Array, along: Array) -> Array:
    """What surfaces cost, shape (n, l), whose blocks, shape (l, b), are so far behind them."""
    pitch = abs(float(np.median(np.diff(along)))) / SCALE_PATCH_WIDTH
    rarely = max(-2 * log(pitch), 0.0)
    found = np.empty((len(steps), len(off)))
    if kernel.compiled is not None:
        kernel.compiled.scale_costs(off, steps, found, rarely)
        return found
    bare = off**2
    found[0] = np.minimum(bare, STRAY_BLOCK_COST).sum(axis=1)
    for k, step in enumerate(steps[1:].tolist(), 1):
        raised = (off + step) ** 2
        on_scale, pays = raised < bare, np.minimum(np.minimum(raised, bare), STRAY_BLOCK_COST)
        seen = pays < STRAY_BLOCK_COST
        change = (np.diff(on_scale) & seen[:, 1:] & seen[:, :-1]).sum(axis=1)
        begins = np.where((on_scale & seen)[:, 0], SCALE_COVERED_SHARE, 1 - SCALE_COVERED_SHARE)
        found[k] = pays.sum(axis=1) + rarely * change - 2 * np.log(begins)
    return found


def fit_bare_steel(fit: GrooveFit, prior: GroovePrior | None, tolerance: float) -> GrooveFit:
    """Move points to the steel, and fit the groove to them again.

    Parameters
    ----------
    fit : GrooveFit
        Of any form of a tee.
    prior : GroovePrior, optional
        What is known from the sections before; without it points are moved for scale alone, and
        only if a side steps up and down.
    tolerance : float
        Distance within which a point belongs to a side, in metres.
    """
    if prior is None:
        fitted = without_seam_cap(fit.fitted)
        if not any(_has_mill_scale_steps(fitted, k) for k in (0, -1)):
            return fit
    bare = _fit_without_scale(fit, prior, tolerance)
    moved = np.abs(bare.fitted.corners - fit.fitted.corners).max() > tolerance
    if moved and reflection_probability(bare.fitted) < MOST_REFLECTED_BESIDE_SCALE:
        # From there scale is seen that was too far off before.
        bare = _fit_without_scale(replace(bare, row=fit.row), prior, tolerance)
    if prior is None or not fit.model.sides[-2].bead:
        return bare
    return _fit_without_pull(bare, prior, tolerance)


def _has_mill_scale_steps(fitted: FittedProfile, k: int) -> bool:
    """Whether a side steps up and down, as scale does that has flaked off in part, and no wave."""
    residuals = fitted.residuals[fitted.spans[k]]
    near = residuals[np.abs(residuals) < SURFACE_REACH]
    blocks = near[: len(near) // STEP_BLOCK * STEP_BLOCK].reshape(-1, STEP_BLOCK)
    steps = np.abs(np.diff(np.sort(blocks, axis=1)[:, STEP_BLOCK // 2]))
    scale = (steps > LEAST_SCALE_STEP) & (steps < SCALE_THICKNESSES[-1])
    return bool(np.count_nonzero(scale) >= FEWEST_SCALE_STEPS)


def _fit_without_scale(fit: GrooveFit, prior: GroovePrior | None, tolerance: float) -> GrooveFit:
    """The fit on the steel under mill scale."""
    row, fitted, last = fit.row, fit.fitted, len(fit.model.sides) - 1
    known = (prior or GroovePrior()).log_thicknesses
    log_thicknesses = np.zeros((2, len(SCALE_THICKNESSES)))
    covariance = np.zeros((2 * last + 2,) * 2)
    back = np.zeros(len(row.points))
    bends, sigmas = np.zeros(2), np.full(2, np.inf)
    curves = list(fitted.curves)
    for side, k, corner in ((0, 0, 0), (1, last, last - 1)):
        steel = _find_steel(fit, k, known[side])
        if steel is None:
            continue
        log_thicknesses[side] = steel.log_thicknesses
        bends[side], sigmas[side] = steel.bend, steel.bend_sigma
        if not steel.thickness:
            continue
        own = fitted.spans[k]
        sines = steel.curve.chord_sines_with_rays(row.points[own])
        back[own] = steel.on_scale * steel.thickness / sines
        curves[k] = steel.curve
        shift = fitted.corner_shift(corner, k)
        index = slice(2 * corner, 2 * corner + 2)
        variance = steel.height_variance + MISTAKEN_LEVEL_SHARE * steel.thickness**2
        covariance[index, index] += variance * np.outer(shift, shift)
    no_pulls = np.zeros(len(NOTCH_PULLS))
    evidence = SectionEvidence(bends, sigmas, no_pulls, log_thicknesses)
    fit = replace(fit, steel_covariance=covariance, evidence=evidence)
    return _fit_moved_points(fit, back, tolerance, tuple(curves))


def _fit_without_pull(fit: GrooveFit, prior: GroovePrior, tolerance: float) -> GrooveFit:
    """The fit behind where light between the faces pulls the notch in."""
    fitted, face = fit.fitted, len(fit.model.sides) - 2
    log_pulls = pull_log_likelihoods(fit.row, fitted, face)
    probability = posterior(prior.log_pulls, log_pulls)
    pull = _mean_if_present(NOTCH_PULLS, probability)
    doubt = float(probability @ (NOTCH_PULLS - pull) ** 2) + (PULL_RELATIVE_SIGMA * pull) ** 2
    shift = np.zeros(2 * face + 4)
    for corner in (face - 1, face):
        at = fitted.corners[corner][None]
        sine = float(fitted.curves[face].chord_sines_with_rays(at)[0])
        shift[2 * corner : 2 * corner + 2] = sine * fitted.corner_shift(corner, face)
    # Points take a raised cosine of their distance from the nearer corner.
    away = np.linalg.norm(fit.row.points[:, None] - fitted.corners[-2:], axis=2).min(axis=1)
    closeness = 0.5 + 0.5 * np.cos(np.pi * np.minimum(away / PULL_REACH, 1.0))
    # At its ends the face is pulled in most. Few of its points would be bent by less between.
    closeness[fitted.spans[face]] = 1.0
    curves = list(fitted.curves)
    middle = np.array([curves[face].point_on_curve(fitted.middles[face])])
    deeper = pull * float(curves[face].chord_sines_with_rays(middle)[0])
    curves[face] = curves[face]._replace(c0=curves[face].c0 + deeper)
    evidence = None if fit.evidence is None else replace(fit.evidence, log_pulls=log_pulls)
    covariance = fit.steel_covariance + doubt * np.outer(shift, shift)
    fit = replace(fit, steel_covariance=covariance, evidence=evidence)
    return _fit_moved_points(fit, pull * closeness, tolerance, tuple(curves))


def _mean_if_present(values: Array, probability: Array) -> float:
    """What there is if anything is, in metres; zero, the first value, if most likely nothing is."""
    there = 1 - float(probability[0])
    return float(probability @ values) / there if there > 0.5 else 0.0


def _fit_moved_points(
    fit: GrooveFit, back: Array, tolerance: float, curves: tuple[CubicCurve, ...]
) -> GrooveFit:
    """The fit, begun from `curves`, to points moved along their rays, (n,) metres."""
    met = corners_between_sides(curves, fit.fitted.corners)
    if met is None or not back.any():
        return fit
    x_s, z_s = (fit.row.points + back[:, None] * unit_vectors(fit.row.points)).T
    moved = replace(fit.row, x_s=x_s, z_s=z_s)
    start = Polyline(curves, met[0], fit.cost)
    again = refine_fit(moved, start, fit.model.sides, tolerance, annealed=False)
    return fit if again is None else replace(fit, row=moved, fitted=again)
