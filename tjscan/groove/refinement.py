"""From a hypothesis to the most likely fit: sides straight or curved, corners, covariance.

All sides are fitted to the points that their corners leave them, over and over until nothing
moves. A side's section is a straight line or a shallow cubic whose bend and twist are those of
pipes and bevels, whichever the points make the likelier. How residuals of neighbouring columns
correlate decides how much the points show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import log
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.reflections import LEAST_COLUMNS_OF_HOLE
from tjscan.groove.settings import FACE_BLUNTNESS, SideModel
from tjscan.groove.sides import (
    FIXED_WEIGHT,
    LEAST_NOISE,
    OUTLIER_SIGMAS,
    SCALING_LENGTH,
    SCALING_LENGTH_POWERS,
    CubicCurve,
    FittedProfile,
    Index,
    Polyline,
    corners_between_sides,
)
from tjscan.laser.profile import Profile

LONGEST_LAG: Final = 24
"""Lag in columns beyond which noise is taken as independent."""

WIDEST_HALF_LAG: Final = LONGEST_LAG / 2 * 0.83
"""Largest lag of half the correlation: what stays correlated for longer is shape, not noise."""

LARGEST_NOISE_SHARE_IN_FIT: Final = 0.6
"""No fit is thought to take out a greater share of the noise."""

CORRELATION_POWER: Final = 1.6
"""Of the lag in the exponent: a filter's correlation has one, speckle's two."""

_LOG_TWO: Final = log(2)
_LEAST_CORRELATION: Final = 0.01  # a correlation that is as good as none
_SHORTEST_LAG: Final = 0.15  # columns: white noise

GHOST_SIGMAS: Final = 0.7
"""Off the surface by more, in standard deviations, and next to a run of outliers: a ghost."""

FEWEST_POINTS_OF_GHOST: Final = 3
"""Outliers that make a run."""

FEWEST_SIDE_POINTS: Final = 3
"""Points that a side can be fitted to."""

POOLED_NOISE_POINTS: Final = 20
"""A side of few points can't show its own noise: it leans on all by as many points as this."""

OUTER_SIDE_REACH: Final = 3.0
"""Points of a rough or patched outer side lie within so many tolerances of it."""

FIRST_ROUND_TOLERANCES: Final = (4.0, 2.0)
"""Tolerance of the first rounds: a side known from one end only must find its other end."""

SETTLED_SIGMAS: Final = 1.0
"""Corners that move less from one round to the next are final, in standard deviations."""

SAME_FIT_DISTANCE: Final = 0.05e-3
"""Fits whose corners differ by less, in metres, become the same."""

MOST_REFINEMENT_ROUNDS: Final = 10
ROUNDS_BEFORE_CURVATURE_CHOICE: Final = 3
"""Rounds in all, and rounds after which sides become straight or curved at the latest."""

REBASED_ROUNDS: Final = 4
"""Rounds; after each one the chords become tangents again; later they lean too little."""

STRAIGHT_LOG_ODDS: Final = 1.1
"""Log of the odds from which a side is straight: a factor of 3, for few points show little."""

RIM_POINTS, LARGEST_CURL, LEAST_CURL_SIGMAS, FEWEST_CURLED_RIMS = 8, 0.6e-3, 2.5, 2
"""Points on either side of a hole that may curl; how far they lie off at most, in metres, and at
least, in standard deviations; and how many rims must be seen to curl."""

_MAD_TO_SIGMA: Final = 1.4826  # of the median absolute deviation of Gaussian noise
_GUESSED_VARIANCE_INFLATION: Final = 4.0  # before the noise's correlation is known


def _lag_of_half_correlation(rho: Array) -> float:
    """Lag at which a correlation has fallen to a half."""
    values = rho.tolist()
    k = next((i for i in range(1, LONGEST_LAG) if values[i] < 0.5), 0)
    if k == 0:
        return WIDEST_HALF_LAG
    before, after = (-log(min(max(v, _LEAST_CORRELATION), 1.0)) for v in values[k - 1 : k + 1])
    half = k - 1 + (_LOG_TWO - before) / (after - before)
    return min(max(half, _SHORTEST_LAG), WIDEST_HALF_LAG)


def noise_share_in_fit(parameters: ArrayLike, inflation: float, count: ArrayLike) -> Array:
    """Share of the variance of correlated noise that a fit takes out of its residuals.

    Parameters
    ----------
    parameters : array_like
        Number of coefficients that were fitted.
    inflation : float
        By how much correlation raises the variance of a mean.
    count : array_like
        Number of points.
    """
    taken = np.asarray(parameters) * max(inflation, 1.0) / np.asarray(count)
    return np.asarray(np.minimum(taken, LARGEST_NOISE_SHARE_IN_FIT))


def estimate_variance_inflation(
    scaled: Array, columns: Index, count: int, parameters: int
) -> float:
    """By how much the correlation of the columns' noise raises the variance of a mean of many.

    It is taken as something between a filter's and speckle's, through where it falls to a half. Of
    the few hundred points of a profile only some ninety are independent: too few to use the
    farther lags as they are. A fit takes up the slowest part of the noise: with p parameters the
    residuals' correlation is too small by about ``p inflation / n`` at all lags, which is put back.

    Parameters
    ----------
    scaled : ndarray, shape (n,)
        Residuals over their own standard deviation.
    columns : ndarray of int, shape (n,)
        The column of each.
    count : int
        Columns in all.
    parameters : int
        Number of coefficients that were fitted.
    """
    grid = np.zeros((2, count + LONGEST_LAG - 1))
    grid[0, columns] = scaled
    grid[1, columns] = 1.0
    product, pairs = (np.correlate(one, one[:count]) for one in grid)
    rho = product / np.maximum(pairs, 1.0)
    rho /= max(float(rho[0]), 1e-30)
    inflation, lost = 1.0, np.zeros(())
    for _ in range(3):
        half = _lag_of_half_correlation(rho * (1 - lost) + lost)
        lags = 0.5 ** ((np.arange(LONGEST_LAG) / half) ** CORRELATION_POWER)
        inflation = max(2 * float(lags.sum()) - 1, 1.0)
        lost = noise_share_in_fit(parameters, inflation, len(scaled))
    return inflation


def refine_fit(
    row: Profile,
    start: Polyline,
    model: tuple[SideModel, ...],
    tolerance: float,
    *,
    annealed: bool = True,
    known: Sequence[Array] = (),
) -> FittedProfile | None:
    """Find the most likely fit near a polyline; None if there is none.

    Parameters
    ----------
    row : Profile
    start : Polyline
        A hypothesis, from the wall.
    model : tuple of SideModel
        What its sides are like.
    tolerance : float
        Distance from the hypothesis within which points belong to it, in metres.
    annealed : bool
        Whether the first rounds reach farther, which sides half hidden need.
    known : sequence of ndarray, shape (k - 1, 2)
        Corners of other fits: one that comes as near as `SAME_FIT_DISTANCE` to them is not
        finished.
    """
    if kernel.compiled is not None:
        values, keep = kernel.fit_record(len(model)).copy(), np.empty(len(row.x_s), np.bool_)
        points = np.empty((2, len(keep)))
        found = kernel.compiled.refine_fit(
            *(row.x_s, row.z_s, row.columns, np.array(start.sides), start.corners),
            *(kernel.model_values(model), np.array(known), values.view(np.float64), points, keep),
            *(row.column_count, tolerance, annealed),
        )
        return found and _compiled_fit(values[0], points, keep, *found)
    widths = FIRST_ROUND_TOLERANCES if annealed else ()
    spread, expected, roughness, bead = kernel.side_priors(model)
    curved, inflation = spread[:, 0] > 0, _GUESSED_VARIANCE_INFLATION
    # What sticks to the long outer sides is wider than their noise.
    reach = np.ones(len(model))
    reach[[0, -1]] = OUTER_SIDE_REACH
    sigmas = np.full(len(model), tolerance / 4)
    holes = np.flatnonzero(np.abs(np.diff(row.columns)) > LEAST_COLUMNS_OF_HOLE)
    fitted: FittedProfile | None = None
    noise_is_known = False
    straight: Array | None = None
    left_out: NDArray[np.bool_] | None = None
    for count in range(MOST_REFINEMENT_ROUNDS):
        if count < max(len(widths), 1):
            limits = np.where(bead, 1.0, (*widths, 1.0)[count]) * tolerance
        else:
            noticed = np.maximum(OUTLIER_SIGMAS * sigmas, OUTLIER_SIGMAS * LEAST_NOISE)
            limits = np.minimum(noticed, tolerance * reach)
        limits = np.maximum(limits, np.maximum(roughness, _face_bluntness(start, bead)))
        prior = prior_weights(spread, curved, sigmas, inflation), expected
        if fitted is not None and count < REBASED_ROUNDS:
            # Nearly the same curves, written over their tangents.
            rebased = map(CubicCurve.rebased_at_tangent, start.sides, fitted.middles)
            start = start._replace(sides=tuple(rebased))
        steel = ~bead if count >= len(widths) else None
        fitted = _fit_sides_once(row, start, limits, prior, curved, left_out, steel)
        if fitted is None:
            return None
        if any(np.abs(fitted.corners - other).max() < SAME_FIT_DISTANCE for other in known):
            return fitted
        moved = np.abs(fitted.corners - start.corners).max() if count else np.inf
        start, sigmas = start._replace(sides=fitted.curves, corners=fitted.corners), fitted.sigmas
        if noise_is_known and moved < SETTLED_SIGMAS * max(float(sigmas.mean()), LEAST_NOISE):
            break
        settling = count >= len(widths) and moved < 0.1 * tolerance
        if not noise_is_known and (settling or count + 1 >= ROUNDS_BEFORE_CURVATURE_CHOICE):
            keep = fitted.keep
            scaled = fitted.residuals[keep] / np.maximum(fitted.sigmas, 1e-9).repeat(fitted.counts)
            parameters = int((2 + fitted.curved).sum())
            inflation = estimate_variance_inflation(
                scaled, row.columns[keep], row.column_count, parameters
            )
            noise_is_known = True
            fitted = replace(fitted, variance_inflation=inflation)
            straight = _log_odds_of_straight_sides(fitted, model)
            curved = curved & (straight < np.where(bead, 0.0, STRAIGHT_LOG_ODDS))
            if left_out is None and len(holes):
                left_out = _find_curled_rims(fitted, holes, bead)
                if left_out is not None:
                    curved, noise_is_known = curved | bead & (spread[:, 0] > 0), False
    if fitted is None or not noise_is_known:
        return None
    return replace(fitted, variance_inflation=inflation, straight=straight)


def _face_bluntness(line: Polyline, bead: NDArray[np.bool_]) -> Array:
    """How far the face of each bead may lie off a parabola, shape (k,), in metres; else zero."""
    bends = np.abs([side.c2 for side in line.sides[1:-1]])
    chords = np.square(np.diff(line.corners, axis=0)).sum(axis=1)
    return np.asarray(bead * np.pad(FACE_BLUNTNESS * bends * chords / 4, 1))


def prior_weights(
    spread: Array, curved: NDArray[np.bool_], sigmas: Array, inflation: float
) -> Array:
    """What the prior adds to the diagonal of the normal matrices, shape (k, 4)."""
    weight = np.zeros((len(spread), 4))
    weight[:, 2:] = FIXED_WEIGHT
    variances = inflation * np.maximum(sigmas, LEAST_NOISE)[:, None] ** 2
    free = curved[:, None] & (spread > 0)
    np.divide(variances, spread * spread, out=weight[:, 2:], where=free)
    return weight


def solve_with_prior(
    equations: tuple[Array, Array], weight: Array, expected: Array
) -> tuple[Array, Array]:
    """Solve normal equations for coefficients (k, 4) and inverses (k, 4, 4), with a prior.

    Parameters
    ----------
    equations : tuple of ndarray
        Matrices, shape (k, 4, 4), and right-hand sides, shape (k, 4).
    weight : ndarray, shape (k, 4)
        What the prior adds to the diagonals; a coefficient that has to be zero weighs
        `FIXED_WEIGHT`.
    expected : ndarray, shape (k,)
        Its mean, for the bends.
    """
    inverse = np.linalg.inv(equations[0] + weight[:, :, None] * np.eye(4))
    rhs = equations[1].copy()
    rhs[:, 2] += np.where(weight[:, 2] < FIXED_WEIGHT, weight[:, 2] * expected, 0.0)
    return (inverse @ rhs[:, :, None])[:, :, 0], np.asarray(inverse, dtype=np.float64)


def _fit_sides_once(
    row: Profile,
    start: Polyline,
    limits: Array,
    prior: tuple[Array, Array],
    curved: NDArray[np.bool_],
    left_out: NDArray[np.bool_] | None,
    steel: NDArray[np.bool_] | None,
) -> FittedProfile | None:
    """Who owns which point, outliers, fits, corners.

    On the sides `steel`, shape (k,), points beside ghosts are dropped.
    """
    points, corners = row.points, start.corners
    cuts = (-row.x_s / row.z_s).searchsorted(-corners[:, 0] / corners[:, 1]).tolist()
    edges = [0, *cuts, len(points)]
    sizes, spans = np.diff(edges), tuple(map(slice, edges, edges[1:]))
    if sizes.min() < FEWEST_SIDE_POINTS:
        return None
    own = [(side, points[span]) for side, span in zip(start.sides, spans, strict=True)]
    s, d = np.concatenate([side.local_coordinates(of_side) for side, of_side in own], axis=1)
    off = np.concatenate([side.signed_distances(of_side) for side, of_side in own])
    scaled = OUTLIER_SIGMAS * off / limits.repeat(sizes)
    keep = np.abs(scaled) < OUTLIER_SIGMAS
    if steel is not None:
        keep = _drop_points_beside_ghosts(scaled, keep, np.array(edges), steel)
    if left_out is not None:
        keep &= ~left_out
    powers = np.vander(s / SCALING_LENGTH, 7, increasing=True).T
    terms = np.concatenate((powers, powers[:4] * d)) * keep
    sums = np.add.reduceat(terms, edges[:-1], axis=1)
    counts = sums[0].astype(np.intp)
    if counts.min() < FEWEST_SIDE_POINTS:
        return None
    equations = sums[_HANKEL_INDEX].transpose(2, 0, 1), sums[7:].T
    try:
        c, inverse = solve_with_prior(equations, *prior)
    except np.linalg.LinAlgError:
        return None
    residuals = d - (c.T.repeat(sizes, axis=1) * powers[:4]).sum(axis=0)
    chords = np.array(start.sides)[:, :4]
    curves = tuple(map(CubicCurve._make, np.hstack((chords, c / SCALING_LENGTH_POWERS)).tolist()))
    met = corners_between_sides(curves, corners)
    if met is None:
        return None
    near = [np.sort(np.abs(residuals[span][keep[span]])) for span in spans]
    sigmas = _MAD_TO_SIGMA * np.array([side[len(side) // 2] for side in near])
    pooled = POOLED_NOISE_POINTS * (sigmas @ counts) / counts.sum()
    sigmas = (counts * sigmas + pooled) / (counts + POOLED_NOISE_POINTS)
    middles = tuple((SCALING_LENGTH * sums[1] / counts).tolist())
    return FittedProfile(
        *(curves, met[1], met[0], edges, spans, s, residuals, keep, sigmas, curved),
        *(equations, inverse, prior[0], counts, middles),
    )


_HANKEL_INDEX: Final = np.add.outer(np.arange(4), np.arange(4))


def _drop_points_beside_ghosts(
    scaled: Array, keep: NDArray[np.bool_], edges: Index, steel: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Drop points that lead over from a side of steel to a run of outliers beside it.

    A bead's face is none: what leads over there is often a part of the bead.
    """
    beside = (scaled > GHOST_SIGMAS).view(np.int8) - (scaled < -GHOST_SIGMAS).view(np.int8)
    starts = np.union1d(edges[:-1], np.flatnonzero(np.diff(beside)) + 1)
    sizes, owner = np.diff(starts, append=edges[-1]), edges[1:-1].searchsorted(starts, "right")
    leads_over = np.add.reduceat(~keep, starts, dtype=np.intp) >= FEWEST_POINTS_OF_GHOST
    leads_over &= steel[owner] & (sizes < np.diff(edges)[owner])
    return keep & ~leads_over.repeat(sizes)


def _find_curled_rims(
    fitted: FittedProfile, holes: Index, bead: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """Points beside holes, shape (n,), if the surface seems to curl there; None if it does not.

    The long sides show whether it does, on most rims, and how far from a hole; the face of a
    bead may follow what curls. Each hole comes after one of the points `holes`.
    """
    n = len(fitted.keep)
    steps = np.arange(RIM_POINTS)
    rims = np.clip(np.concatenate((holes[:, None] - steps, holes[:, None] + 1 + steps)), 0, n - 1)
    owner = np.searchsorted(fitted.edges[1:-1], rims, side="right")
    off = np.abs(fitted.residuals[rims])
    long = ~bead[owner[:, 0]] & (off[:, 0] < LARGEST_CURL)
    curled = (off / np.maximum(fitted.sigmas, LEAST_NOISE)[owner])[long] > LEAST_CURL_SIGMAS
    first = np.count_nonzero(curled[:, 0])
    if first < FEWEST_CURLED_RIMS or 2 * first <= len(curled):
        return None
    width = 1 + int(np.logical_and.accumulate(curled, axis=1).sum(axis=1).max())
    found = np.zeros(n, dtype=np.bool_)
    found[rims[:, :width]] = True
    return found


def coefficient_covariances(
    fitted: FittedProfile, inverse: Array, weight: Array, spread: Array
) -> Array:
    """Covariance of each side's coefficients, shape (k, 4, 4), in powers of s / 20 mm.

    Noise enters through the points, the unknown bend and twist through the prior: ``inverse
    (sigma² inflation A + W S W) inverse``.
    """
    # A fit takes up some of the noise.
    lost = noise_share_in_fit(2 + fitted.curved, fitted.variance_inflation, fitted.counts)
    variance = fitted.variance_inflation * fitted.sigmas**2 / (1 - lost)
    meat = variance[:, None, None] * fitted.equations[0]
    meat[:, (2, 3), (2, 3)] += (np.where(weight < FIXED_WEIGHT, weight, 0.0)[:, 2:] * spread) ** 2
    return np.asarray(inverse @ meat @ inverse)


def _log_odds_of_straight_sides(fitted: FittedProfile, model: tuple[SideModel, ...]) -> Array:
    """Logarithm of the odds that each side is straight, not curved (Savage–Dickey ratio)."""
    spread, *_ = kernel.side_priors(model)
    covariances = coefficient_covariances(fitted, fitted.inverse, fitted.weight, spread)
    variance = np.maximum(covariances[:, 2, 2], 1e-30)
    bend = np.array([c.c2 for c in fitted.curves]) * SCALING_LENGTH**2
    prior = np.maximum(spread[:, 0], 1e-15)
    odds = np.log(prior) - 0.5 * np.log(variance) - bend**2 / (2 * variance)
    known = np.array([side.expected_bend is not None for side in model])
    return np.where(known, -np.inf, odds)


def _compiled_fit(
    value: Any, points: Array, keep: NDArray[np.bool_], finished: bool, *edges: int
) -> FittedProfile:
    """What the compiled loops found, of such a record."""
    return FittedProfile(
        curves=tuple(map(CubicCurve._make, value["curves"].tolist())),
        places=tuple(map(tuple, value["places"].tolist())),
        edges=list(edges),
        spans=tuple(map(slice, edges, edges[1:])),
        along=points[0],
        residuals=points[1],
        keep=keep,
        curved=value["curved"] > 0,
        equations=(value["matrices"], value["right"]),
        counts=value["counts"].astype(np.intp),
        middles=tuple(value["middles"].tolist()),
        variance_inflation=float(value["inflation"][0]),
        straight=value["straight"] if finished else None,
        **{name: value[name] for name in ("corners", "sigmas", "inverse", "weight")},
    )
