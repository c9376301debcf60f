"""From a hypothesis to the most likely fit: sides straight or curved, corners, covariance.

All sides are fitted to the points that their corners leave them, over and over until nothing
moves. A side's section is a straight line or a shallow cubic whose bend and twist are those of
pipes and bevels, whichever the points make the likelier. How residuals of neighbouring columns
correlate decides how much the points show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
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


@lru_cache
def fit_record(k: int) -> Array:
    """Room for what a compiled fit of k sides gives, in its order."""
    corner, side, matrix, vector = (k - 1, 2), (k,), (k, 4, 4), (k, 4)
    shapes = {"curves": (k, 8), "places": corner, "corners": corner, "sigmas": side, "counts": side}
    shapes |= {"middles": side, "straight": side, "curved": side, "matrices": matrix}
    shapes |= {"right": vector, "inverse": matrix, "weight": vector, "inflation": (1,)}
    return np.empty(1, [(name, np.float64, shape) for name, shape in shapes.items()])


@lru_cache
def model_values(model: tuple[SideModel, ...]) -> Array:
    """What a compiled fit knows of each side, shape (k, 6)."""
    values = [
        (s.bend, s.twist, s.expected_bend or 0.0, s.roughness, s.bead, s.expected_bend is not None)
        for s in model
    ]
    return np.array(values) * (SCALING_LENGTH ** np.array((2, 3, 2, 0, 0, 0)))


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
    values = model_values(model)
    if kernel.compiled is not None:
        record, keep = fit_record(len(model)).copy(), np.empty(len(row.x_s), np.bool_)
        points = np.empty((2, len(row.x_s)))
        found = kernel.compiled.refine_fit(
            *(row.x_s, row.z_s, row.columns, np.array(start.sides), start.corners),
            *(values, np.array(known), record.view(np.float64), points, keep),
            *(row.column_count, tolerance, annealed),
        )
        return found and _compiled_fit(record[0], points, keep, *found)
    widths = FIRST_ROUND_TOLERANCES if annealed else ()
    spread, roughness, bead = values[:, :2], values[:, 3], values[:, 4] > 0
    curved, inflation, noise_is_known = spread[:, 0] > 0, _GUESSED_VARIANCE_INFLATION, False
    # What sticks to the long outer sides is wider than their noise.
    reach = np.full(len(model), tolerance)
    reach[[0, -1]] *= OUTER_SIDE_REACH
    sigmas, left_out = np.full(len(model), tolerance / 4), np.zeros(len(row.x_s), dtype=np.bool_)
    fitted: FittedProfile | None = None
    straight: Array | None = None
    for count in range(MOST_REFINEMENT_ROUNDS):
        settled = count >= len(widths)
        limits = np.minimum(OUTLIER_SIGMAS * np.maximum(sigmas, LEAST_NOISE), reach)
        if count < max(len(widths), 1):
            limits = np.where(bead, 1.0, (*widths, 1.0)[count]) * tolerance
        limits = np.maximum(limits, np.maximum(roughness, _face_bluntness(start, bead)))
        if fitted is not None and count < REBASED_ROUNDS:
            # Nearly the same curves, written over their tangents.
            rebased = map(CubicCurve.rebased_at_tangent, start.sides, fitted.middles)
            start = start._replace(sides=tuple(rebased))
        weight = prior_weights(spread, curved, sigmas, inflation)
        clean = settled & ~bead
        fitted = _fit_sides_once(row, start, limits, (weight, values[:, 2]), left_out, clean)
        if fitted is None:
            return None
        fitted = replace(fitted, curved=curved, variance_inflation=inflation, straight=straight)
        if any(np.abs(fitted.corners - other).max() < SAME_FIT_DISTANCE for other in known):
            return replace(fitted, straight=None)
        moved = np.abs(fitted.corners - start.corners).max() if count else np.inf
        start, sigmas = start._replace(sides=fitted.curves, corners=fitted.corners), fitted.sigmas
        if noise_is_known:
            if moved < SETTLED_SIGMAS * max(float(sigmas.mean()), LEAST_NOISE):
                break
        elif (settled and moved < 0.1 * tolerance) or count + 1 >= ROUNDS_BEFORE_CURVATURE_CHOICE:
            keep = fitted.keep
            scaled = fitted.residuals[keep] / np.maximum(sigmas, 1e-9).repeat(fitted.counts)
            parameters = int((2 + curved).sum())
            inflation = estimate_variance_inflation(
                scaled, row.columns[keep], row.column_count, parameters
            )
            fitted = replace(fitted, variance_inflation=inflation)
            straight = _log_odds_of_straight_sides(fitted, values)
            fitted = replace(fitted, straight=straight)
            curved = curved & (straight < np.where(bead, 0.0, STRAIGHT_LOG_ODDS))
            noise_is_known = True
            if not left_out.any() and _leave_out_curled_rims(row, fitted, bead, left_out):
                curved, noise_is_known = curved | bead & (spread[:, 0] > 0), False
    return fitted if noise_is_known else None


def _face_bluntness(line: Polyline, bead: NDArray[np.bool_]) -> Array:
    """How far the face of each bead may lie off a parabola, shape (k,), in metres; else zero."""
    bends = np.abs([side.c2 for side in line.sides[1:-1]])
    chords = np.square(np.diff(line.corners, axis=0)).sum(axis=1)
    return np.asarray(bead * np.pad(FACE_BLUNTNESS * bends * chords / 4, 1))


def prior_weights(
    spread: Array, curved: NDArray[np.bool_], sigmas: Array, inflation: float
) -> Array:
    """What the prior adds to the diagonal of the normal matrices, shape (k, 4)."""
    weight = np.pad(np.full(spread.shape, FIXED_WEIGHT), ((0, 0), (2, 0)))
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
    left_out: NDArray[np.bool_],
    clean: NDArray[np.bool_],
) -> FittedProfile | None:
    """Who owns which point, outliers, fits, corners; None if a side has too few points.

    From the sides `clean`, shape (k,), points beside ghosts are dropped.
    """
    cuts = (-row.x_s / row.z_s).searchsorted(-start.corners[:, 0] / start.corners[:, 1])
    edges = [0, *cuts.tolist(), len(row.x_s)]
    spans, keep = tuple(map(slice, edges, edges[1:])), ~left_out
    s, d, sums = np.empty(len(row.x_s)), np.empty(len(row.x_s)), []
    for side, own, limit, is_clean in zip(start.sides, spans, limits, clean, strict=True):
        points = row.points[own]
        s[own], d[own] = side.local_coordinates(points)
        if len(points):
            keep[own] &= _points_on_side(side.signed_distances(points) / limit, is_clean)
        if np.count_nonzero(keep[own]) < FEWEST_SIDE_POINTS:
            return None
        powers = np.vander(s[own][keep[own]] / SCALING_LENGTH, 7, increasing=True)
        sums.append((powers.sum(axis=0), d[own][keep[own]] @ powers[:, :4]))
    moments = np.array([one for one, _ in sums])
    equations, counts = (moments[:, _HANKEL_INDEX], np.array([b for _, b in sums])), moments[:, 0]
    try:
        c, inverse = solve_with_prior(equations, *prior)
    except np.linalg.LinAlgError:
        return None
    curves = tuple(
        CubicCurve(*side[:4], *height)
        for side, height in zip(start.sides, (c / SCALING_LENGTH_POWERS).tolist(), strict=True)
    )
    met = corners_between_sides(curves, start.corners)
    if met is None:
        return None
    residuals = np.concatenate(
        [side.signed_distances(row.points[own]) for side, own in zip(curves, spans, strict=True)]
    )
    near = [np.sort(np.abs(residuals[own][keep[own]])) for own in spans]
    sigmas = _MAD_TO_SIGMA * np.array([side[len(side) // 2] for side in near])
    pooled = POOLED_NOISE_POINTS * (sigmas @ counts) / counts.sum()
    sigmas = (counts * sigmas + pooled) / (counts + POOLED_NOISE_POINTS)
    middles = tuple((SCALING_LENGTH * moments[:, 1] / counts).tolist())
    return FittedProfile(
        *(curves, met[1], met[0], edges, spans, s, residuals, keep, sigmas, clean),
        *(equations, inverse, prior[0], counts.astype(np.intp), middles),
    )


_HANKEL_INDEX: Final = np.add.outer(np.arange(4), np.arange(4))


def _points_on_side(off: Array, is_clean: bool) -> NDArray[np.bool_]:
    """Points within their limit; none that lead over from a clean side to a run of outliers.

    A bead's face is not clean: what leads over there is often a part of the bead.
    """
    on, beside = np.abs(off) < 1, np.sign(off) * (np.abs(off) * OUTLIER_SIGMAS > GHOST_SIGMAS)
    starts = np.flatnonzero(np.diff(beside, prepend=np.nan))
    if is_clean and len(starts) > 1:
        leads_over = np.add.reduceat(~on, starts, dtype=np.intp) >= FEWEST_POINTS_OF_GHOST
        on &= ~leads_over.repeat(np.diff(starts, append=len(on)))
    return on


def _leave_out_curled_rims(
    row: Profile, fitted: FittedProfile, bead: NDArray[np.bool_], left_out: NDArray[np.bool_]
) -> bool:
    """Leave out points beside holes, if the surface seems to curl there; whether it does.

    The long sides show whether it does, on most rims, and how far from a hole; the face of a
    bead may follow what curls.
    """
    holes = np.flatnonzero(np.abs(np.diff(row.columns)) > LEAST_COLUMNS_OF_HOLE)[:, None]
    steps = np.arange(RIM_POINTS)
    rims = np.clip(np.concatenate((holes - steps, holes + 1 + steps)), 0, len(row.x_s) - 1)
    owner = np.searchsorted(fitted.edges[1:-1], rims, side="right")
    off = np.abs(fitted.residuals[rims])
    long = ~bead[owner[:, 0]] & (off[:, 0] < LARGEST_CURL)
    curled = (off / np.maximum(fitted.sigmas, LEAST_NOISE)[owner])[long] > LEAST_CURL_SIGMAS
    first = np.count_nonzero(curled[:, 0])
    if first < FEWEST_CURLED_RIMS or 2 * first <= len(curled):
        return False
    width = 1 + int(np.logical_and.accumulate(curled, axis=1).sum(axis=1).max())
    left_out[rims[:, :width]] = True
    return True


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


def _log_odds_of_straight_sides(fitted: FittedProfile, values: Array) -> Array:
    """Logarithm of the odds that each side is straight, not curved (Savage–Dickey ratio)."""
    covariances = coefficient_covariances(fitted, fitted.inverse, fitted.weight, values[:, :2])
    variance = np.maximum(covariances[:, 2, 2], 1e-30)
    bend = np.array([c.c2 for c in fitted.curves]) * SCALING_LENGTH**2
    prior = np.maximum(values[:, 0], 1e-15)
    odds = np.log(prior) - 0.5 * np.log(variance) - bend**2 / (2 * variance)
    return np.where(values[:, 5] > 0, -np.inf, odds)


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
