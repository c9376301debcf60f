"""Find the sides of a groove of any model in a profile, or refuse to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import atan2, degrees, nan, pi, radians, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.background import PointRuns, find_runs
from tjscan.groove.bead import add_root_bead, attached_faces, fit_bead
from tjscan.groove.budget import SEARCH_BUDGETS, SearchBudget
from tjscan.groove.curves import CubicCurve
from tjscan.groove.facets import with_knee
from tjscan.groove.fitted_profile import (
    FittedProfile,
    OrderedProfilePoints,
    corners_between_sides,
)
from tjscan.groove.hypotheses import (
    MOST_REFINED,
    RIVAL_MARGIN,
    PolylineHypothesis,
    bearing_tangents,
    best_hypotheses,
    outer_side_pairs,
)
from tjscan.groove.models import LEAST_SIDES, GrooveModel, TurnBounds
from tjscan.groove.refinement import SAME_FIT_DISTANCE, refine_fit
from tjscan.groove.rivals import (
    form_probability,
    left_out_covariance,
    reflection_covariance,
    rival_covariance,
    sides_that_meet,
)
from tjscan.groove.segments import CurvedSegments, add_halves_at_gaps, find_segments
from tjscan.groove.settings import DEFAULT_SETTINGS, GrooveSettings
from tjscan.groove.shape import points_lead_away_from_side, undulation_sigmas
from tjscan.groove.uncertainty import corner_estimates
from tjscan.groove.without_root import least_loss_without_root
from tjscan.laser.profile import Profile

FEWEST_POINTS_ON_SIDE: Final = 4
"""Fewest points on a side."""

PARTIAL_GROOVE_SHARE: Final = 0.25
"""A part of a groove that leaves no greater share of the points unexplained is one."""

LENGTH_SLACK: Final = 0.8
"""A fitted side may be shorter than the model's shortest, or longer than its longest, by this
factor."""

SAME_START_DISTANCE: Final = 0.3e-3
"""A hypothesis whose corners differ by less, in metres, from those of another one, or of what
came of it, is not refined again."""

TURN_SLACK: Final = radians(3)
"""How far the fitted turns may lie outside the model's."""

STRAYED_SHARE: Final = 0.05
"""A refined hypothesis that explains fewer points than before, by this share, has strayed."""

SIDE_COST: Final = 5.0
"""What a model's every side costs, in outliers: BIC's penalty for a line and its end where some
ninety points of a profile are independent."""

UNEXPLAINED_SHARES: Final = (0.3, 0.45, 1.0)
"""Share of the points that a fit may leave unexplained for each budget and need no other one."""

REFIT_GAIN: Final = 6.0
"""More points than this, beyond those that its sides explain as they are, no refit of a fit
explains."""

NEAR_SIDE_TOLERANCES: Final = 3.0
"""Points this near a side, in tolerances, are of its surface or of what sticks to it, as scale."""

REFLECTED_SHARE: Final = 0.08
"""Share of the points that a fit may leave to reflections if all others are near its sides."""

CORNER_REACH: Final = 1.5e-3
"""Points of both sides lie this near a corner that is seen, in metres."""

FEWEST_AT_CORNER: Final = 2
"""Points of a side that show its corner."""

DETACHED_COST: Final = 2.0
"""What a side whose points end before its corner costs, in outliers: reflections often do."""

SEEN_SHARE: Final = 0.25
"""Share of a side's points that must lie on it if no other form is to be tried."""

STRAIGHT_UNDULATION: Final = 0.08e-3
"""A side that undulates by more, in metres, may be two."""

RECOVERABLE_SHARE: Final = 0.5
"""Share of the points a hypothesis leaves unexplained that other outer sides may yet explain."""


@dataclass(frozen=True, slots=True, eq=False)
class GrooveCandidate:
    """A groove fitted to a profile, with its cost and what speaks against it.

    Parameters
    ----------
    model : GrooveModel
        The likeliest of the groove's forms.
    fitted : FittedProfile
        Its sides and corners.
    cost : float
        What all points and sides pay, in outliers.
    seen : ndarray of bool, shape (k - 1, 2)
        Whether points lie beside each corner on the side before and on the side after it:
        reflections seldom reach the surfaces that they seem to meet.
    objection : str, optional
        Why the points do not bear it out.
    rivals : float or ndarray, shape (2 k, 2 k)
        What other readings add to the covariance of its corners and of its outer sides' angles.
    probability : float
        That the groove has this form, not another one.
    """

    model: GrooveModel
    fitted: FittedProfile
    cost: float
    seen: NDArray[np.bool_]
    objection: str | None = None
    rivals: Array | float = 0.0
    probability: float = nan


def fit_groove_to_profile(
    profile: Profile, settings: GrooveSettings = DEFAULT_SETTINGS
) -> tuple[OrderedProfilePoints, FittedProfile]:
    """Fit the sides and corners of a groove of any model to a profile.

    Parameters and errors are those of `find_groove`; the points come ordered from the first
    side to the last.
    """
    row, found = find_best_candidate(profile, settings)
    corners, covariance = corner_estimates(row, found.fitted, found.model)
    variances = np.diag(covariance)[:-2].reshape(-1, 2).max(axis=1)
    # What is not seen well has its uncertainty; one of the tops has to be known.
    check_corner_uncertainty(row, float(variances[[0, -1]].min()), settings)
    return row, replace(found.fitted, corners=corners)


def check_corner_uncertainty(
    row: OrderedProfilePoints, variance: float, settings: GrooveSettings
) -> None:
    """Refuse a groove whose corners are too uncertain.

    Parameters
    ----------
    row : OrderedProfilePoints
    variance : float
        Of a coordinate that has to be known, in m².
    settings : GrooveSettings

    Raises
    ------
    GrooveNotFound
        If a standard deviation exceeds what the settings allow.
    """
    sigma = sqrt(variance)
    if sigma > settings.largest_sigma:
        raise GrooveNotFound(
            "ambiguous",
            f"a corner is known to {1e3 * sigma:.2f} mm (one standard deviation) only: too little "
            "of its sides is seen. Look at the groove more squarely.",
            row.points,
        )


def find_best_candidate(
    profile: Profile, settings: GrooveSettings
) -> tuple[OrderedProfilePoints, GrooveCandidate]:
    """Find the likeliest fit that its points support, however uncertain its corners.

    Parameters and errors are those of `find_groove`.
    """
    # Many sensors write a zero where they see nothing; and nothing is seen behind them.
    valid = profile.valid & (profile.z_s > 0)
    # Coordinates lie one after the other in memory: sums over all points are quicker.
    points = np.array((profile.x_s[valid], profile.z_s[valid])).T
    if len(points) < settings.minimum_points:
        raise GrooveNotFound(
            "too few points",
            f"{len(points)} of {len(profile)} columns hold a point, {settings.minimum_points} "
            "are needed. Is the surface inside the sensor's range, and the laser on?",
            points,
        )
    tangents = bearing_tangents(points)
    order = np.argsort(tangents, kind="stable")
    row = OrderedProfilePoints(
        points.T[:, order].T, tangents[order], np.flatnonzero(valid)[order], len(profile)
    )
    return row, _search(row, settings)


def _search(row: OrderedProfilePoints, settings: GrooveSettings) -> GrooveCandidate:
    """Look for a fit, harder until one convinces."""
    search = _Search(row, settings)
    model, others = settings.model, settings.model.alternatives
    stages = ((model,), others) if others and not model.seldom else ((model, *others),)
    for budget, left_out in zip(SEARCH_BUDGETS, UNEXPLAINED_SHARES, strict=True):
        segments = find_segments(row.points, settings.support_tolerance, budget)
        for forms in stages:
            for form in forms:
                if len(form.sides) <= len(model.sides) and not search.rules_out(form):
                    own = replace(settings, model=form)
                    search.add(form, _hypotheses(row, segments, own, budget))
            every = forms is stages[-1]
            if every and others:
                search.derive()
            sound = [c for c in search.found if c.objection is None]
            if not sound:
                continue
            best = min(sound, key=lambda c: c.cost)
            enough = every and budget is not SEARCH_BUDGETS[0]
            explained = best.cost < left_out * len(row.points) or _leaves_few_points(best, settings)
            if explained and (enough or _convincing(best, compared=every)):
                return _with_rivals(row, best, sound)
    if sound:
        return _with_rivals(row, best, sound)
    if search.found:
        best = min(search.found, key=lambda c: c.cost)
        raise GrooveNotFound("ambiguous", str(best.objection), row.points)
    raise _why_not(row, segments, settings, SEARCH_BUDGETS[-1])


def _with_rivals(
    row: OrderedProfilePoints, best: GrooveCandidate, sound: list[GrooveCandidate]
) -> GrooveCandidate:
    """A reading that knows how far others are from it, and which sides may be no surface."""
    others = [(c.cost - best.cost, c.model, c.fitted) for c in sound if c is not best]
    rivals = rival_covariance(best.model, best.fitted, others)
    rivals += reflection_covariance(row, best.model, best.fitted)
    rivals += left_out_covariance(row, best.model, best.fitted)
    forms = [(excess, form) for excess, form, _ in others]
    probability = form_probability(best.model, best.fitted, forms)
    return replace(best, rivals=rivals, probability=probability)


class _Search:
    """What was tried already, and what came of it."""

    def __init__(self, row: OrderedProfilePoints, settings: GrooveSettings) -> None:
        self.found: list[GrooveCandidate] = []
        self._row, self._settings = row, settings
        self._runs = find_runs(row.points, row.columns)
        self._tried: list[tuple[GrooveModel, Array]] = []
        self._derived = 0

    def add(self, model: GrooveModel, hypotheses: list[PolylineHypothesis]) -> None:
        """Refine the likeliest hypotheses of one form that are new."""
        hypotheses.sort(key=lambda c: c.cost)
        for one in hypotheses[:MOST_REFINED]:
            if one.cost <= hypotheses[0].cost + RIVAL_MARGIN:
                self._refine(model, one)

    def rules_out(self, form: GrooveModel) -> bool:
        """Whether a form without the face at the root explains too little to be looked for."""
        sound = [c for c in self.found if c.objection is None and c.model.has_root_bead]
        if not sound or form.has_root_bead:
            return False
        best = min(sound, key=lambda c: c.cost)
        saved = SIDE_COST + DETACHED_COST * np.count_nonzero(~best.seen)
        loss = least_loss_without_root(self._row, best.fitted, self._settings.support_tolerance)
        return bool(loss > saved + REFIT_GAIN)

    def derive(self) -> None:
        """Try what other forms the fits so far suggest."""
        tolerance = self._settings.support_tolerance
        model = self._settings.model
        while self._derived < len(self.found):
            one = self.found[self._derived]
            self._derived += 1
            as_fitted = PolylineHypothesis(one.fitted.curves, one.fitted.corners, one.cost)
            if one.model.has_root_bead:
                again = fit_bead(self._row, self._runs, as_fitted, one.model, tolerance)
                self._refine(one.model, None if again is as_fitted else again)
                if not sides_that_meet(one.fitted)[-2:].any():
                    self._attach(one.model, _without_face(as_fitted))
            for form in (model, *model.alternatives):
                if len(form.sides) != len(one.model.sides) + 1:
                    continue
                # Where bevel and leg end a bead may begin; a second facet is no root's face.
                if form.has_root_bead and (
                    not one.model.has_root_bead
                    or one.objection is not None
                    or not sides_that_meet(one.fitted)[-1]
                ):
                    self._refine(form, add_root_bead(self._row, self._runs, as_fitted, tolerance))
                    self._attach(form, as_fitted)
                if one.model is model:
                    divided = _divided(model, form)
                    self._refine(
                        form, with_knee(self._row, one.fitted, divided, tolerance, SIDE_COST)
                    )

    def _attach(self, form: GrooveModel, hypothesis: PolylineHypothesis | None) -> None:
        """Try faces at the root that go on from bevel or leg."""
        if hypothesis is None:
            return
        tolerance = self._settings.support_tolerance
        for face in attached_faces(self._row, self._runs, hypothesis, tolerance):
            self._refine(form, face)

    def _refine(self, model: GrooveModel, hypothesis: PolylineHypothesis | None) -> None:
        """Refine a hypothesis, if there is one, unless the like of it has been."""
        if hypothesis is None:
            return
        for tried, corners in self._tried:
            if tried is model and np.abs(corners - hypothesis.corners).max() < SAME_START_DISTANCE:
                return
        self._tried.append((model, hypothesis.corners))
        settings = replace(self._settings, model=model)
        known = [c.fitted.corners for c in self.found if c.model is model]
        refined = _candidate(self._row, self._runs, hypothesis, settings, known)
        if refined is not None and not any(
            np.abs(refined.fitted.corners - other).max() < SAME_FIT_DISTANCE for other in known
        ):
            against = reason_to_reject_fit(refined, settings)
            self.found.append(replace(refined, objection=against))
            self._tried.append((model, refined.fitted.corners))


def _without_face(hypothesis: PolylineHypothesis) -> PolylineHypothesis | None:
    """A hypothesis without the face at the root; None where its neighbours do not meet."""
    sides = (*hypothesis.sides[:-2], hypothesis.sides[-1])
    met = corners_between_sides(sides, hypothesis.corners[:-1])
    return None if met is None else replace(hypothesis, sides=sides, corners=met[0])


def _divided(model: GrooveModel, form: GrooveModel) -> int:
    """The side of a model that a form with one side more has two of."""
    return next(k for k, side in enumerate(model.sides) if side != form.sides[k])


def _hypotheses(
    row: OrderedProfilePoints,
    segments: CurvedSegments,
    settings: GrooveSettings,
    budget: SearchBudget,
) -> list[PolylineHypothesis]:
    """Chains between the likeliest outer sides."""
    across = settings.model.across
    if across.least < 0 < across.most:
        segments = add_halves_at_gaps(segments, row.points, settings.support_tolerance)
    hypotheses: list[PolylineHypothesis] = []
    cheapest, likeliest = np.inf, -np.inf
    for i, j, score in outer_side_pairs(segments, settings.model, len(row.points), budget.pairs):
        # Only points still unexplained can make up for what this pair explains less.
        if likeliest - score > RECOVERABLE_SHARE * cheapest:
            break
        hypotheses += best_hypotheses(
            settings.model,
            row.points,
            row.tangents,
            (_curve(segments, i), _curve(segments, j)),
            int(segments.last[i]),
            int(segments.first[j]),
            settings.support_tolerance,
            budget,
        )
        if hypotheses:
            cheapest = min(c.cost for c in hypotheses)
            likeliest = max(likeliest, score)
    return hypotheses


def _curve(segments: CurvedSegments, k: int) -> CubicCurve:
    """A segment as plain numbers."""
    return CubicCurve(
        *(float(v) for v in (*segments.centre[k], *segments.direction[k], *segments.curve[k]))
    )


def _why_not(
    row: OrderedProfilePoints,
    segments: CurvedSegments,
    settings: GrooveSettings,
    budget: SearchBudget,
) -> GrooveNotFound:
    """What a profile without a groove of this model shows instead."""
    model = settings.model
    anything = TurnBounds(-pi, pi)
    first, last = model.sides[0].name, model.sides[-1].name
    most = PARTIAL_GROOVE_SHARE * len(row.points)
    for part, hidden, way in (
        (
            replace(model, sides=model.sides[1:], turns=model.turns[1:], across=anything),
            first,
            "up",
        ),
        (
            replace(model, sides=model.sides[:-1], turns=model.turns[:-1], across=anything),
            last,
            "down",
        ),
    ):
        if len(part.sides) < LEAST_SIDES:
            continue
        hypotheses = _hypotheses(row, segments, replace(settings, model=part), budget)
        if any(c.cost < most for c in hypotheses):
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


def _candidate(
    row: OrderedProfilePoints,
    runs: PointRuns,
    hypothesis: PolylineHypothesis,
    settings: GrooveSettings,
    known: list[Array],
) -> GrooveCandidate | None:
    """Refine a hypothesis, unless it leads to a fit whose corners are known.

    None where its sides fit no points together.
    """
    model, tolerance = settings.model, settings.support_tolerance
    hypothesis = fit_bead(row, runs, hypothesis, model, tolerance)
    best: FittedProfile | None = None
    least = np.inf
    for sides, annealed in ((model.sides, True), (model.sides, False), (None, False)):
        if sides is None:
            if best is not None or not model.has_root_bead:
                break
            # Few points of a face may bend it away from its neighbours: then it is drawn straight.
            sides = tuple(replace(s, bend=0.0, twist=0.0) if s.bead else s for s in model.sides)
        fitted = refine_fit(
            row,
            hypothesis.sides,
            hypothesis.corners,
            sides,
            tolerance,
            annealed=annealed,
            known=known,
        )
        if fitted is not None:
            scaled = fitted.residuals / tolerance
            total = float(np.minimum(scaled * scaled, 1).sum())
            if total < least:
                best, least = fitted, total
        if least < hypothesis.cost + STRAYED_SHARE * len(row.points):
            break
    if best is None:
        return None
    seen = _points_beside_corners(best)
    cost = float(runs.total_cost(np.minimum((best.residuals / tolerance) ** 2, 1)))
    cost += SIDE_COST * len(model.sides) + DETACHED_COST * np.count_nonzero(~seen)
    return GrooveCandidate(model, best, cost, seen)


def _turns(fitted: FittedProfile) -> list[float]:
    """Turn at each corner, positive in a valley."""
    turns = []
    for (a, b), (sa, sb) in zip(pairwise(fitted.curves), fitted.places, strict=True):
        (ax, az), (bx, bz) = a.tangent_at(sa), b.tangent_at(sb)
        turns.append(atan2(ax * bz - az * bx, ax * bx + az * bz))
    return turns


def _leaves_few_points(found: GrooveCandidate, settings: GrooveSettings) -> bool:
    """Whether nearly all points lie on a side or on what sticks to it."""
    off = np.abs(found.fitted.residuals) > NEAR_SIDE_TOLERANCES * settings.support_tolerance
    return bool(off.mean() < REFLECTED_SHARE)


def _convincing(found: GrooveCandidate, *, compared: bool) -> bool:
    """Whether every side is seen well, and none but the root's face bends or leaves the points.

    Unless it has been compared with other forms, every corner must be seen from both sides, too.
    """
    fitted, sides = found.fitted, found.model.sides
    if not (compared or found.seen.all()):
        return False
    if (
        fitted.inlier_shares.min() < SEEN_SHARE
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
        np.less(np.abs(fitted.along - np.repeat(places, sizes)), CORNER_REACH, out=own)
    near &= fitted.keep
    count = np.add.reduceat(near, fitted.edges[:-1], axis=1, dtype=np.intp)
    return np.array((count[0, :-1], count[1, 1:])).T >= FEWEST_AT_CORNER


def reason_to_reject_fit(found: GrooveCandidate, settings: GrooveSettings) -> str | None:
    """Why the points do not bear a fit out; None if they do."""
    fitted, model = found.fitted, found.model
    for side, count, share in zip(model.sides, fitted.counts, fitted.inlier_shares, strict=True):
        if share < settings.inlier_share or count < FEWEST_POINTS_ON_SIDE:
            return f"only {count} points, {share:.0%} of those seen there, lie on the {side.name}"
    for turned, allowed in zip(_turns(fitted), model.turns, strict=True):
        if not allowed.least - TURN_SLACK <= turned <= allowed.most + TURN_SLACK:
            return f"a corner turns by {degrees(turned):.0f}°, which no such groove does"
    lengths = np.linalg.norm(np.diff(fitted.corners, axis=0), axis=1)
    for side, length in zip(model.sides[1:-1], lengths.tolist(), strict=True):
        if not LENGTH_SLACK * side.shortest < length < side.longest / LENGTH_SLACK:
            return f"the {side.name} is {1e3 * length:.1f} mm long"
    rms = float(np.sqrt(np.mean(fitted.residuals[fitted.keep] ** 2)))
    if rms > settings.largest_rms:
        return f"the points lie {1e3 * rms:.2f} mm (rms) off the sides fitted to them"
    return None
