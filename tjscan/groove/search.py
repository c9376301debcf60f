"""Find the sides of a groove of any model in a profile, or refuse to.

Every form of the groove lays its cheapest chains over the curves that the profile proposes. Those
that cost little more than the cheapest of all are refined, cheapest first, and compared by what
their points and sides cost.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt
from typing import Final

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.candidates import (
    ROUGH_REACH_SIGMAS,
    find_pieces,
    project_points,
    propose_candidates,
)
from tjscan.groove.chains import (
    RIVAL_COST_MARGIN,
    SIDE_LENGTH_SLACK,
    WIDER_TOLERANCE_COST,
    ChainSearch,
)
from tjscan.groove.refinement import SAME_FIT_DISTANCE, model_values, refine_fit
from tjscan.groove.reflections import (
    PointRuns,
    count_points_seen_through_face,
    find_runs,
    stretches_off_surface,
)
from tjscan.groove.settings import (
    LEAST_SIDES,
    GrooveModel,
    GrooveSettings,
    TurnBounds,
)
from tjscan.groove.sides import FittedProfile, GrooveFit, Polyline
from tjscan.laser.profile import Profile

FEWEST_POINTS_ON_SIDE: Final = 4
"""Fewest points on a side."""

PARTIAL_GROOVE_SHARE: Final = 0.25
"""A part of a groove that leaves no greater share of the points unexplained is one."""

STRAYED_SUPPORT_SHARE: Final = 0.05
"""A refined hypothesis that explains fewer points than before, by this share, has strayed."""

COST_PER_SIDE: Final = 5.0
"""What a model's every side costs, in outliers: BIC's penalty for a line and its end where some
ninety points of a profile are independent."""

MOST_CHAINS_PER_FORM: Final = 3
"""Most chains of one form that are refined."""

FEWEST_STEEL_POINTS, UNEXPLAINED_STEEL_COST = 15, 1.0
"""What each point costs more, in outliers, in a stretch of so many at least that lies off the sides
and goes over into them without a jump: it is steel, and no spatter either, which is smaller."""

SEEN_THROUGH_COST: Final = 1.0
"""What each point costs more, in outliers, that shows a side beside a bead to go on behind its
face: nothing is seen through steel, and reflections hardly lie there."""

MOST_OF_OUTLIERS: Final = 0.5
"""Share of the points off the sides from which steel is what they are."""


def find_supported_fits(row: Profile, settings: GrooveSettings) -> list[GrooveFit]:
    """Find the fits that their points support, the likeliest first, however uncertain its corners.

    Chains that are not much dearer than the cheapest one of any form are refined.

    Parameters
    ----------
    row : Profile
    settings : GrooveSettings

    Raises
    ------
    GrooveNotFound
        If the points support none.
    """
    runs, model = find_runs(row), settings.model
    tolerance = settings.support_tolerance
    points = project_points(row, settings.noise)
    pieces = find_pieces(points, runs)
    if not len(pieces.first):
        raise GrooveNotFound(
            "no bevel",
            "all points lie on a few rays: they show no surface. Look at the groove more "
            "squarely, or check the sensor's columns.",
            row.points,
        )
    candidates = propose_candidates(points, pieces)
    curves, search = candidates.as_curves(), ChainSearch(points, candidates, runs, tolerance)
    starts = [
        (chain.cost + COST_PER_SIDE * len(form.sides), form, chain)
        for form in (model, *model.alternatives)
        for chain in search.cheapest_chains(form, MOST_CHAINS_PER_FORM)
    ]
    starts.sort(key=lambda start: start[0])
    found: list[GrooveFit] = []
    for cost, form, chain in starts:
        if cost <= starts[0][0] + RIVAL_COST_MARGIN or all(fit.objection for fit in found):
            start = Polyline(tuple(curves[k] for k in chain.sides), chain.corners, chain.cost)
            known = [fit.fitted.corners for fit in found if fit.model is form]
            fit = _refine_chain(row, runs, form, start, tolerance, known)
            if fit is not None:
                found.append(replace(fit, objection=_reason_to_reject(fit, settings)))
    if not found:
        raise _explain_missing_groove(search, model, row.points)
    supported = [fit for fit in found if not fit.objection]
    if not supported:
        likeliest = min(found, key=lambda fit: fit.cost)
        raise GrooveNotFound("ambiguous", str(likeliest.objection), row.points)
    if any(fit.model.sides[-2].roughness for fit in supported):
        supported = [_charge_for_steel(fit, runs, tolerance) for fit in supported]
    return sorted(supported, key=lambda fit: fit.cost)


def _charge_for_steel(fit: GrooveFit, runs: PointRuns, tolerance: float) -> GrooveFit:
    """A fit with what the steel costs that it leaves unexplained.

    Beside many reflections some join the surface by chance: then nothing is charged.
    """
    off = _costs_of_points_on_sides(fit.fitted, fit.model, tolerance) >= 1
    first, stop, joins = stretches_off_surface(runs, off)
    length = (stop - first)[joins.all(axis=0)]
    steel = float(length[length >= FEWEST_STEEL_POINTS].sum())
    charged = steel > MOST_OF_OUTLIERS * np.count_nonzero(off)
    return replace(fit, cost=fit.cost + UNEXPLAINED_STEEL_COST * steel * charged)


def _refine_chain(
    row: Profile,
    runs: PointRuns,
    model: GrooveModel,
    start: Polyline,
    tolerance: float,
    known: list[Array],
) -> GrooveFit | None:
    """Refine a chain; None if its sides fit no points together, or if its corners are known."""
    best: FittedProfile | None = None
    costs = np.full(len(row.points), np.inf)
    for annealed in (True, False):
        fitted = refine_fit(row, start, model.sides, tolerance, annealed=annealed, known=known)
        if fitted is not None:
            pays = _costs_of_points_on_sides(fitted, model, tolerance)
            # Reflections count in full: beside many it is fitted in both ways.
            if pays.sum() < costs.sum():
                best, costs = fitted, pays
        if costs.sum() < start.cost + STRAYED_SUPPORT_SHARE * len(costs):
            break
    if best is None or any(
        np.abs(best.corners - other).max() < SAME_FIT_DISTANCE for other in known
    ):
        return None
    cost = float(runs.total_cost(costs)) + COST_PER_SIDE * len(model.sides)
    for k, side in enumerate(model.sides):
        if side.bead:
            cost += SEEN_THROUGH_COST * count_points_seen_through_face(row, best, k)
    return GrooveFit(row, model, best, cost)


def _explain_missing_groove(
    search: ChainSearch, model: GrooveModel, points: Array
) -> GrooveNotFound:
    """What a profile without a groove of this model shows instead."""
    first, last = model.sides[0].name, model.sides[-1].name
    for kept, hidden, way in ((slice(1, None), first, "up"), (slice(None, -1), last, "down")):
        if len(model.sides) == LEAST_SIDES:
            break
        anywhere = TurnBounds(-pi, pi)
        sides, turns = model.sides[kept], model.turns[kept]
        part = replace(model, sides=sides, turns=turns, across=anywhere)
        chains = search.cheapest_chains(part, 1)
        if not chains or chains[0].cost > PARTIAL_GROOVE_SHARE * len(points):
            continue
        # What is left of the side beside the hidden one is no longer than it may be.
        end, corner = (points[0], 0) if way == "up" else (points[-1], -1)
        length = float(np.linalg.norm(end - chains[0].corners[corner]))
        if length < sides[corner].longest / SIDE_LENGTH_SLACK:
            return GrooveNotFound(
                "out of range",
                f"no {hidden} is seen beside the rest of the groove: move the sensor {way}",
                points,
            )
    names = ", ".join(side.name for side in model.sides)
    return GrooveNotFound(
        "no bevel",
        f"no {names} that meet one after the other (with x_s up, the {first} is at high x_s)",
        points,
    )


def _costs_of_points_on_sides(fitted: FittedProfile, model: GrooveModel, tolerance: float) -> Array:
    """What each point pays for its distance from its side, shape (n,), in outliers.

    A side that may be rough explains its points less precisely, which costs them, too.
    """
    if kernel.compiled is not None:
        costs, values = np.empty(len(fitted.keep)), model_values(model.sides)
        own = fitted.residuals, np.array(fitted.edges), fitted.sigmas, values, costs
        kernel.compiled.costs_of_points(*own, tolerance)
        return costs
    rough = [max(side.roughness, tolerance) for side in model.sides]
    reach = np.clip(ROUGH_REACH_SIGMAS * fitted.sigmas, tolerance, rough)
    less = WIDER_TOLERANCE_COST * np.log(reach / tolerance)
    reach, less = np.array((reach, less)).repeat(np.diff(fitted.edges), axis=1)
    scaled = fitted.residuals / reach
    return np.asarray(np.minimum(scaled * scaled + less, 1))


def _reason_to_reject(fit: GrooveFit, settings: GrooveSettings) -> str | None:
    """Why the points do not bear a fit out; None if they do."""
    fitted, sides = fit.fitted, fit.model.sides
    sizes, lengths = np.diff(fitted.edges), np.linalg.norm(np.diff(fitted.corners, axis=0), axis=1)
    for side, count, size in zip(sides, fitted.counts.tolist(), sizes.tolist(), strict=True):
        share = count / size
        if share < settings.inlier_share or count < FEWEST_POINTS_ON_SIDE:
            return f"only {count} points, {share:.0%} of those seen there, are on the {side.name}"
    for side, length in zip(sides[1:-1], lengths.tolist(), strict=True):
        if not SIDE_LENGTH_SLACK * side.shortest < length < side.longest / SIDE_LENGTH_SLACK:
            return f"the {side.name} is {1e3 * length:.1f} mm long"
    smooth = fitted.keep.copy()
    for side, own in zip(sides, fitted.spans, strict=True):
        smooth[own] &= not side.roughness
    off = fitted.residuals[smooth]
    rms = sqrt(float(off @ off) / len(off))
    if rms > settings.largest_rms:
        return f"the points are {1e3 * rms:.2f} mm (rms) off the sides fitted to them"
    return None
