"""Find the sides of a groove of any model in a profile, or refuse to.

A groove is looked for quickly first, harder if nothing convincing comes of it. Each search
proposes polylines, refines the likeliest, tries the other forms that these suggest, and compares
what the points support by what all points pay.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from math import atan2, degrees, pi, radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.alternatives import (
    WIDER_TOLERANCE_COST,
    add_faces_along_neighbours,
    add_root_arc,
    bound_cost_of_removing_root,
    divide_side_at_knee,
    fit_parabola_to_bead,
    remove_root_face,
)
from tjscan.groove.hypotheses import (
    MOST_HYPOTHESES_REFINED,
    RIVAL_COST_MARGIN,
    best_hypotheses,
    outer_side_pairs,
)
from tjscan.groove.refinement import SAME_FIT_DISTANCE, refine_fit, undulation_sigmas
from tjscan.groove.reflections import find_runs, sides_that_meet, with_other_readings
from tjscan.groove.segments import CurvedSegments, add_halves_at_gaps, find_segments
from tjscan.groove.settings import (
    LEAST_SIDES,
    SEARCH_BUDGETS,
    GrooveModel,
    GrooveSettings,
    SearchBudget,
    TurnBounds,
)
from tjscan.groove.shape import points_lead_away_from_side
from tjscan.groove.sides import CubicCurve, FittedProfile, GrooveFit, OrderedProfilePoints, Polyline

FEWEST_POINTS_ON_SIDE: Final = 4
"""Fewest points on a side."""

PARTIAL_GROOVE_SHARE: Final = 0.25
"""A part of a groove that leaves no greater share of the points unexplained is one."""

SIDE_LENGTH_SLACK: Final = 0.8
"""A fitted side may be shorter than the model's shortest, or longer than its longest, by this
factor."""

SAME_START_DISTANCE: Final = 0.3e-3
"""A hypothesis whose corners differ by less, in metres, from those of another one, or of what
came of it, is not refined again."""

SIDE_TURN_SLACK: Final = radians(3)
"""How far the fitted turns may lie outside the model's."""

STRAYED_SUPPORT_SHARE: Final = 0.05
"""A refined hypothesis that explains fewer points than before, by this share, has strayed."""

SIDE_COST: Final = 5.0
"""What a model's every side costs, in outliers: BIC's penalty for a line and its end where some
ninety points of a profile are independent."""

UNEXPLAINED_SHARES: Final = (0.3, 0.45, 1.0)
"""Share of the points that a fit may leave unexplained for each budget and need no other one."""

MOST_REFIT_GAIN: Final = 6.0
"""More points than this, beyond those that its sides explain as they are, no refit of a fit
explains."""

NEAR_SIDE_TOLERANCES: Final = 3.0
"""Points this near a side, in tolerances, are of its surface or of what sticks to it, as scale."""

REFLECTED_SHARE: Final = 0.08
"""Share of the points that a fit may leave to reflections if all others are near its sides."""

CORNER_POINT_DISTANCE: Final = 1.5e-3
"""Points of both sides lie this near a corner that is seen, in metres."""

FEWEST_AT_CORNER: Final = 2
"""Points of a side that show its corner."""

UNREACHED_CORNER_COST: Final = 2.0
"""What a side whose points end before its corner costs, in outliers: reflections often do."""

LEAST_SEEN_SHARE: Final = 0.25
"""Share of a side's points that must lie on it if no other form is to be tried."""

STRAIGHT_UNDULATION: Final = 0.08e-3
"""A side that undulates by more, in metres, may be two."""

RECOVERABLE_SHARE: Final = 0.5
"""Share of the points a hypothesis leaves unexplained that other outer sides may yet explain."""


def find_best_fit(row: OrderedProfilePoints, settings: GrooveSettings) -> GrooveFit:
    """Find the likeliest fit that its points support, however uncertain its corners.

    Parameters
    ----------
    row : OrderedProfilePoints
    settings : GrooveSettings

    Raises
    ------
    GrooveNotFound
        If the points support none.
    """
    search = _FitSearch(row, settings)
    model, others = settings.model, settings.model.alternatives
    stages = ((model,), others) if others and not model.likely_another else ((model, *others),)
    for budget, left_out in zip(SEARCH_BUDGETS, UNEXPLAINED_SHARES, strict=True):
        segments = find_segments(row.points, search.tolerance, budget)
        for forms in stages:
            for form in forms:
                if len(form.sides) <= len(model.sides) and not search.is_hopeless(form):
                    search.add(
                        form, _hypotheses_of_form(row, segments, form, search.tolerance, budget)
                    )
            every = forms is stages[-1]
            if every and others:
                search.try_suggested_forms()
            sound = search.sound
            if not sound:
                continue
            best = min(sound, key=lambda fit: fit.cost)
            enough = every and budget is not SEARCH_BUDGETS[0]
            explained = best.cost < left_out * len(row.points) or search.explains_most_points(best)
            if explained and (enough or _is_convincing(best, compared=every)):
                return with_other_readings(best, [fit for fit in sound if fit is not best])
    if sound:
        return with_other_readings(best, [fit for fit in sound if fit is not best])
    if search.found:
        best = min(search.found, key=lambda fit: fit.cost)
        raise GrooveNotFound("ambiguous", str(best.objection), row.points)
    raise _explain_missing_groove(row, segments, model, search.tolerance)


class _FitSearch:
    """What was tried already, and what came of it."""

    def __init__(self, row: OrderedProfilePoints, settings: GrooveSettings) -> None:
        self.found: list[GrooveFit] = []
        self.tolerance = settings.support_tolerance
        self._row, self._settings = row, settings
        self._runs = find_runs(row.points, row.columns)
        self._tried: list[tuple[GrooveModel, Array]] = []
        self._derived = 0

    @property
    def sound(self) -> list[GrooveFit]:
        """The fits that the points support."""
        return [fit for fit in self.found if fit.objection is None]

    def add(self, model: GrooveModel, hypotheses: list[Polyline]) -> None:
        """Refine the likeliest hypotheses of one form that are new."""
        hypotheses.sort(key=lambda one: one.cost)
        likely = hypotheses[:MOST_HYPOTHESES_REFINED]
        self._refine(
            model, *(one for one in likely if one.cost <= likely[0].cost + RIVAL_COST_MARGIN)
        )

    def is_hopeless(self, form: GrooveModel) -> bool:
        """Whether a form without the face at the root explains too little to be looked for."""
        sound = [fit for fit in self.sound if fit.model.has_root_bead]
        if not sound or form.has_root_bead:
            return False
        best = min(sound, key=lambda fit: fit.cost)
        saved = SIDE_COST + UNREACHED_CORNER_COST * np.count_nonzero(~best.seen)
        loss = bound_cost_of_removing_root(self._row, best.fitted, self.tolerance)
        return bool(loss > saved + MOST_REFIT_GAIN)

    def explains_most_points(self, fit: GrooveFit) -> bool:
        """Whether nearly all points lie on a side or on what sticks to it."""
        off = np.abs(fit.fitted.residuals) > NEAR_SIDE_TOLERANCES * self.tolerance
        return bool(off.mean() < REFLECTED_SHARE)

    def try_suggested_forms(self) -> None:
        """Try what other forms the fits so far suggest."""
        model = self._settings.model
        while self._derived < len(self.found):
            one = self.found[self._derived]
            self._derived += 1
            as_fitted = Polyline(one.fitted.curves, one.fitted.corners, one.cost)
            if one.model.has_root_bead:
                self._try_other_faces(one, as_fitted)
            for form in (model, *model.alternatives):
                if len(form.sides) == len(one.model.sides) + 1:
                    self._try_larger_form(one, form, as_fitted)

    def _try_other_faces(self, one: GrooveFit, as_fitted: Polyline) -> None:
        """Try other faces at the root of a fit with one."""
        again = fit_parabola_to_bead(self._row, self._runs, as_fitted, one.model, self.tolerance)
        if again is not as_fitted:
            self._refine(one.model, again)
        if not sides_that_meet(one.fitted)[-2:].any() and (bare := remove_root_face(as_fitted)):
            self._try_faces_along_neighbours(one.model, bare)

    def _try_larger_form(self, one: GrooveFit, form: GrooveModel, as_fitted: Polyline) -> None:
        """Try a form with one side more than a fit has: a face at the root, or a knee."""
        # Where bevel and leg end a bead may begin; a second facet is no root's face.
        if form.has_root_bead and (
            not one.model.has_root_bead
            or one.objection is not None
            or not sides_that_meet(one.fitted)[-1]
        ):
            self._refine(form, add_root_arc(self._row, self._runs, as_fitted, self.tolerance))
            self._try_faces_along_neighbours(form, as_fitted)
        model = self._settings.model
        if one.model is model:
            k = next(k for k, side in enumerate(model.sides) if side != form.sides[k])
            self._refine(
                form, divide_side_at_knee(self._row, one.fitted, k, self.tolerance, SIDE_COST)
            )

    def _try_faces_along_neighbours(self, form: GrooveModel, bare: Polyline) -> None:
        """Try faces at the root that go on from bevel or leg."""
        self._refine(form, *add_faces_along_neighbours(self._row, self._runs, bare, self.tolerance))

    def _refine(self, model: GrooveModel, *starts: Polyline | None) -> None:
        """Refine those of some polylines whose like has not been refined."""
        for start in starts:
            if start is None or self._is_tried(model, start.corners):
                continue
            self._tried.append((model, start.corners))
            known = [fit.fitted.corners for fit in self.found if fit.model is model]
            fit = self._fit(model, start, known)
            if fit is None or _is_near(fit.fitted.corners, known, SAME_FIT_DISTANCE):
                continue
            self.found.append(replace(fit, objection=_reason_to_reject(fit, self._settings)))
            self._tried.append((model, fit.fitted.corners))

    def _is_tried(self, model: GrooveModel, corners: Array) -> bool:
        tried = [other for form, other in self._tried if form is model]
        return _is_near(corners, tried, SAME_START_DISTANCE)

    def _fit(self, model: GrooveModel, start: Polyline, known: list[Array]) -> GrooveFit | None:
        """Refine a polyline, unless it leads to a fit whose corners are known.

        None if its sides fit no points together.
        """
        row, runs, tolerance = self._row, self._runs, self.tolerance
        start = fit_parabola_to_bead(row, runs, start, model, tolerance)
        best: FittedProfile | None = None
        least = np.inf
        for sides, annealed in ((model.sides, True), (model.sides, False), (None, False)):
            if sides is None:
                if best is not None or not model.has_root_bead:
                    break
                # Few points of a face may bend it away from its neighbours: it is drawn straight.
                sides = tuple(replace(s, bend=0.0, twist=0.0) if s.bead else s for s in model.sides)
            fitted = refine_fit(row, start, sides, tolerance, annealed=annealed, known=known)
            if fitted is not None:
                pays = _costs_of_points_on_sides(fitted, model, tolerance)
                if (total := float(pays.sum())) < least:
                    best, least, costs = fitted, total, pays
            if least < start.cost + STRAYED_SUPPORT_SHARE * len(row.points):
                break
        if best is None:
            return None
        seen = _points_beside_corners(best)
        cost = float(runs.total_cost(costs))
        cost += SIDE_COST * len(model.sides) + UNREACHED_CORNER_COST * np.count_nonzero(~seen)
        return GrooveFit(row, model, best, cost, seen)


def _costs_of_points_on_sides(fitted: FittedProfile, model: GrooveModel, tolerance: float) -> Array:
    """What each point pays for its distance from its side, shape (n,), in outliers.

    A side that may be rough explains its points less precisely, which costs them, too.
    """
    reach = np.array([max(side.roughness, tolerance) for side in model.sides])
    less = WIDER_TOLERANCE_COST * np.log(reach / tolerance)
    reach, less = np.array((reach, less)).repeat(np.diff(fitted.edges), axis=1)
    scaled = fitted.residuals / reach
    return np.asarray(np.minimum(scaled * scaled + less, 1))


def _is_near(corners: Array, others: Iterable[Array], distance: float) -> bool:
    """Whether corners differ by less than a distance from some others."""
    return any(np.abs(corners - other).max() < distance for other in others)


def _hypotheses_of_form(
    row: OrderedProfilePoints,
    segments: CurvedSegments,
    model: GrooveModel,
    tolerance: float,
    budget: SearchBudget,
) -> list[Polyline]:
    """Chains between the likeliest outer sides."""
    across = model.across
    if across.least < 0 < across.most:
        segments = add_halves_at_gaps(segments, row.points, tolerance)
    hypotheses: list[Polyline] = []
    cheapest, likeliest = np.inf, -np.inf
    for i, j, score in outer_side_pairs(segments, model, len(row.points), budget.pairs):
        # Only points still unexplained can make up for what this pair explains less.
        if likeliest - score > RECOVERABLE_SHARE * cheapest:
            break
        stretches = int(segments.last[i]), int(segments.first[j])
        outer = _segment_as_curve(segments, i), _segment_as_curve(segments, j)
        hypotheses += best_hypotheses(model, row, outer, stretches, tolerance, budget)
        if hypotheses:
            cheapest = min(one.cost for one in hypotheses)
            likeliest = max(likeliest, score)
    return hypotheses


def _segment_as_curve(segments: CurvedSegments, k: int) -> CubicCurve:
    """A segment as plain numbers."""
    return CubicCurve(
        *(float(v) for v in (*segments.centre[k], *segments.direction[k], *segments.curve[k]))
    )


def _explain_missing_groove(
    row: OrderedProfilePoints, segments: CurvedSegments, model: GrooveModel, tolerance: float
) -> GrooveNotFound:
    """What a profile without a groove of this model shows instead."""
    first, last = model.sides[0].name, model.sides[-1].name
    for kept, hidden, way in ((slice(1, None), first, "up"), (slice(None, -1), last, "down")):
        if len(model.sides) == LEAST_SIDES:
            break
        part = replace(
            model, sides=model.sides[kept], turns=model.turns[kept], across=TurnBounds(-pi, pi)
        )
        hypotheses = _hypotheses_of_form(row, segments, part, tolerance, SEARCH_BUDGETS[-1])
        if any(one.cost < PARTIAL_GROOVE_SHARE * len(row.points) for one in hypotheses):
            return GrooveNotFound(
                "out of range",
                f"no {hidden} is seen beside the rest of the groove: move the sensor {way}",
                row.points,
            )
    names = ", ".join(side.name for side in model.sides)
    return GrooveNotFound(
        "no bevel",
        f"{len(segments)} long stretches, but no {names} that meet one after the other "
        f"(with x_s up, the {first} lies at high x_s)",
        row.points,
    )


def _corner_turns(fitted: FittedProfile) -> list[float]:
    """Turn at each corner, positive in a valley."""
    turns = []
    for (a, b), (sa, sb) in zip(pairwise(fitted.curves), fitted.places, strict=True):
        (ax, az), (bx, bz) = a.tangent_at(sa), b.tangent_at(sb)
        turns.append(atan2(ax * bz - az * bx, ax * bx + az * bz))
    return turns


def _is_convincing(found: GrooveFit, *, compared: bool) -> bool:
    """Whether every side is seen well, and none but the root's face bends or leaves the points.

    Unless it has been compared with other forms, every corner must be seen from both sides, too.
    """
    fitted, sides = found.fitted, found.model.sides
    if not (compared or found.seen.all()):
        return False
    if (
        fitted.inlier_shares.min() < LEAST_SEEN_SHARE
        or undulation_sigmas(fitted)[1:-1].max() > STRAIGHT_UNDULATION
    ):
        return False
    return not any(
        points_lead_away_from_side(fitted, k)
        for k, side in enumerate(sides[1:-1], 1)
        if not side.bead
    )


def _points_beside_corners(fitted: FittedProfile) -> NDArray[np.bool_]:
    """Whether points lie beside each corner on the side before and after it, shape (k - 1, 2)."""
    ends, starts = np.array(fitted.places).T
    sizes = np.diff(fitted.edges)
    near = np.empty((2, len(fitted.keep)), dtype=np.bool_)
    for own, places in zip(near, ((*ends, np.inf), (np.inf, *starts)), strict=True):
        np.less(np.abs(fitted.along - np.repeat(places, sizes)), CORNER_POINT_DISTANCE, out=own)
    near &= fitted.keep
    count = np.add.reduceat(near, fitted.edges[:-1], axis=1, dtype=np.intp)
    return np.array((count[0, :-1], count[1, 1:])).T >= FEWEST_AT_CORNER


def _reason_to_reject(found: GrooveFit, settings: GrooveSettings) -> str | None:
    """Why the points do not bear a fit out; None if they do."""
    fitted, model = found.fitted, found.model
    for side, count, share in zip(model.sides, fitted.counts, fitted.inlier_shares, strict=True):
        if share < settings.inlier_share or count < FEWEST_POINTS_ON_SIDE:
            return f"only {count} points, {share:.0%} of those seen there, lie on the {side.name}"
    for turned, allowed in zip(_corner_turns(fitted), model.turns, strict=True):
        if not allowed.least - SIDE_TURN_SLACK <= turned <= allowed.most + SIDE_TURN_SLACK:
            return f"a corner turns by {degrees(turned):.0f}°, which no such groove does"
    lengths = np.linalg.norm(np.diff(fitted.corners, axis=0), axis=1)
    for side, length in zip(model.sides[1:-1], lengths.tolist(), strict=True):
        if not SIDE_LENGTH_SLACK * side.shortest < length < side.longest / SIDE_LENGTH_SLACK:
            return f"the {side.name} is {1e3 * length:.1f} mm long"
    smooth = np.array([not side.roughness for side in model.sides]).repeat(np.diff(fitted.edges))
    rms = float(np.sqrt(np.mean(fitted.residuals[fitted.keep & smooth] ** 2)))
    if rms > settings.largest_rms:
        return f"the points lie {1e3 * rms:.2f} mm (rms) off the sides fitted to them"
    return None
