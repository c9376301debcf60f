"""Read the groove off a profile, or refuse to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.errors import GrooveNotFound
from tjscan.frames import Array
from tjscan.groove.chain import (
    DISTINCT,
    IN_FRONT,
    PAIRS,
    PATIENT_PAIRS,
    RIVAL_MARGIN,
    RIVALS,
    Chain,
    bearing,
    best_chains,
    outer_pairs,
)
from tjscan.groove.curves import Curve
from tjscan.groove.models import TEE, GrooveModel
from tjscan.groove.refinement import (
    Outline,
    Row,
    coefficient_covariances,
    noise_of,
    refine,
    spread_of,
)
from tjscan.groove.section import GrooveSection, section_from_points
from tjscan.groove.segments import Segments, find_segments
from tjscan.laser.profile import Profile


@dataclass(frozen=True, slots=True)
class GrooveSettings:
    """How a groove is looked for.

    Parameters
    ----------
    model : GrooveModel
        What it looks like.
    noise : float
        Largest standard deviation of the range that is expected, in metres.
    minimum_points : int
        Fewest points of a profile that are worth a search.
    largest_sigma : float
        Largest standard deviation of a corner that is still an answer, in metres.
    largest_rms : float
        Largest deviation of the points from the fitted sides, in metres (rms).
    inlier_share : float
        Least share of a side's points that must lie on it.
    """

    model: GrooveModel = TEE
    noise: float = 0.05e-3
    minimum_points: int = 80
    largest_sigma: float = 0.4e-3
    largest_rms: float = 0.15e-3
    inlier_share: float = 0.1


DEFAULT = GrooveSettings()

FEWEST = 4
"""Fewest points on a side."""

MOST_BEFORE = 2
BEFORE_SHARE = 0.05
"""Most points before a side, and more for every point on it: spatter, but no reflections."""

CORNER = 1e-3
"""Points fly within this distance of a corner, in metres."""

LEAST_LEAD = 3.0
"""By how many points a reading has to be better than any other."""

STRAYED = 0.05
"""A refined hypothesis that explains fewer points than before, by this share, has strayed."""

MADE_UP = 0.5
"""Share of the points a chain leaves unexplained that other outer sides may yet explain."""

TOLERANCE = 4.0
"""Points within this many expected standard deviations of a hypothesis support it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A refined hypothesis."""

    outline: Outline
    price: float


def find_groove(profile: Profile, settings: GrooveSettings = DEFAULT) -> GrooveSection:
    """Read the groove's section off a profile.

    Parameters
    ----------
    profile : Profile
        In frame s with x_s up the brace; the columns may run either way.
    settings : GrooveSettings
        With a model of three long sides and a root, such as `TEE`.

    Raises
    ------
    GrooveNotFound
        If there are too few points, no groove, more than one reading, or one that is too
        uncertain.
    ValueError
        If the model has no such section.
    """
    if len(settings.model.sides) != 4:
        raise ValueError(f"model {settings.model.name!r} has no section of five points")
    row, outline = find_outline(profile, settings)
    section = _section(row, outline, settings.model)
    sigma = float(np.sqrt(np.diag(section.covariance_s).max()))
    if sigma > settings.largest_sigma:
        raise GrooveNotFound(
            "ambiguous",
            f"a corner is known to {1e3 * sigma:.2f} mm (one standard deviation) only: too little "
            "of its sides is seen. Look at the groove more squarely.",
            row.points,
        )
    return section


def find_outline(profile: Profile, settings: GrooveSettings = DEFAULT) -> tuple[Row, Outline]:
    """Find the sides and corners of a groove of any model; see `find_groove`."""
    valid = profile.valid
    points = np.column_stack((profile.x_s[valid], profile.z_s[valid]))
    if len(points) < settings.minimum_points:
        raise GrooveNotFound(
            "too few points",
            f"{len(points)} of {len(profile)} columns hold a point, {settings.minimum_points} "
            "are needed. Is the surface inside the sensor's range, and the laser on?",
            points,
        )
    tangents = bearing(points)
    order = np.argsort(tangents, kind="stable")
    row = Row(points[order], tangents[order], np.flatnonzero(valid)[order], len(profile))
    tolerance = TOLERANCE * settings.noise
    for patient in (False, True):
        segments = find_segments(row.points, tolerance, patient=patient)
        chains = _chains(row, segments, settings, PATIENT_PAIRS if patient else PAIRS)
        if chains:
            break
    else:
        raise GrooveNotFound("no bevel", _shape(segments, settings.model), points)
    chains.sort(key=lambda c: c.price)
    chains = [c for c in chains[:RIVALS] if c.price <= chains[0].price + RIVAL_MARGIN]
    candidates = [c for h in chains if (c := _candidate(row, h, settings)) is not None]
    if not candidates:
        raise GrooveNotFound("no bevel", "no sides fit the points together", points)
    best = min(candidates, key=lambda c: c.price)
    _check(row, best, candidates, settings)
    return row, best.outline


def _chains(row: Row, segments: Segments, settings: GrooveSettings, most: int) -> list[Chain]:
    """Chains between the likeliest outer sides."""
    chains: list[Chain] = []
    cheapest, likeliest = np.inf, -np.inf
    for i, j, score in outer_pairs(segments, settings.model, len(row.points), most):
        # Only points still unexplained can make up for what this pair explains less.
        if likeliest - score > MADE_UP * cheapest:
            break
        chains += best_chains(
            settings.model,
            row.points,
            row.tangents,
            (_curve(segments, i), _curve(segments, j)),
            int(segments.last[i]),
            int(segments.first[j]),
            TOLERANCE * settings.noise,
        )
        if chains:
            cheapest = min(c.price for c in chains)
            likeliest = max(likeliest, score)
    return chains


def _curve(segments: Segments, k: int) -> Curve:
    """A segment as plain numbers."""
    return Curve(
        *(float(v) for v in (*segments.centre[k], *segments.direction[k], *segments.curve[k]))
    )


def _shape(segments: Segments, model: GrooveModel) -> str:
    names = ", ".join(side.name for side in model.sides)
    return f"{len(segments)} long stretches, but no {names} that meet one after the other"


def _candidate(row: Row, chain: Chain, settings: GrooveSettings) -> _Candidate | None:
    """Refine a hypothesis and price it again."""
    tolerance = TOLERANCE * settings.noise
    best: _Candidate | None = None
    for annealed in (True, False):
        outline = refine(
            row,
            chain.sides,
            chain.corners,
            settings.model.sides,
            tolerance,
            annealed=annealed,
        )
        if outline is not None:
            scaled = outline.residuals / tolerance
            price = np.minimum(scaled * scaled, 1)
            price[scaled < -1] = IN_FRONT
            total = float(price.sum())
            if best is None or total < best.price:
                best = _Candidate(outline, total)
        if best is not None and best.price < chain.price + STRAYED * len(row.points):
            break
    return best


def _before(row: Row, outline: Outline, tolerance: float) -> list[int]:
    """Number of points clearly before each side."""
    before = outline.residuals < -1.5 * tolerance
    for corner in outline.corners:
        before &= np.abs(row.points - corner).max(axis=1) > CORNER
    counts: list[int] = np.bincount(outline.owner[before], minlength=len(outline.curves)).tolist()
    return counts


def _check(
    row: Row, best: _Candidate, candidates: list[_Candidate], settings: GrooveSettings
) -> None:
    """Refuse an outline that its points don't bear out."""
    outline = best.outline

    def doubt(detail: str) -> GrooveNotFound:
        return GrooveNotFound("ambiguous", detail, row.points)

    before = _before(row, outline, TOLERANCE * settings.noise)
    sides = zip(settings.model.sides, outline.counts, outline.shares, before, strict=True)
    for side, count, share, front in sides:
        if share < settings.inlier_share or count < FEWEST:
            raise doubt(
                f"only {count} points, {share:.0%} of those seen there, lie on the {side.name}"
            )
        if front > MOST_BEFORE + BEFORE_SHARE * count:
            raise doubt(
                f"{front} points lie before the {side.name}, which {count} points lie on: "
                "it may be a reflection"
            )
    for rival in candidates:
        apart = float(np.abs(rival.outline.corners - outline.corners).max())
        if apart > DISTINCT and rival.price < best.price + LEAST_LEAD:
            raise doubt(
                f"another reading, {1e3 * apart:.1f} mm away, explains the points about as well"
            )
    rms = float(np.sqrt(np.mean(outline.residuals[outline.keep] ** 2)))
    if rms > settings.largest_rms:
        raise doubt(f"the points lie {1e3 * rms:.2f} mm (rms) off the sides fitted to them")


def _section(row: Row, outline: Outline, model: GrooveModel) -> GrooveSection:
    """Section of an outline of four sides."""
    wall, leg = outline.curves[0], outline.curves[-1]
    on_wall = outline.along[outline.keep & (outline.owner == 0)]
    on_leg = outline.along[outline.keep & (outline.owner == len(outline.curves) - 1)]
    points = np.zeros((5, 3))
    points[0, [0, 2]] = wall.at(float(on_wall.min()))
    points[1:4, [0, 2]] = outline.corners
    points[4, [0, 2]] = leg.at(float(on_leg.max()))
    t1 = wall.tangent(outline.places[0][0])
    t4 = leg.tangent(outline.places[-1][1])
    return section_from_points(
        points,
        wall_s=(t1[0], 0.0, t1[1]),
        leg_s=(t4[0], 0.0, t4[1]),
        rms=float(np.sqrt(np.mean(outline.residuals[outline.keep] ** 2))),
        covariance=corner_covariance(row, outline, model),
    )


def corner_covariance(row: Row, outline: Outline, model: GrooveModel) -> Array:
    """Covariance of corners and of both end tangents' angles, shape (2 k, 2 k) for k sides.

    Each corner X lies on both its sides, so for either ``m · dX = b · dc`` with m the side's
    normal there and b the derivatives of its height by its coefficients c.
    """
    spread = coefficient_covariances(row, outline, noise_of(row, outline), spread_of(model.sides))
    k = len(outline.curves)
    sigma = np.zeros((4 * k, 4 * k))
    for i in range(k):
        sigma[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] = spread[i]
    jacobian = np.zeros((2 * k, 4 * k))
    for i, place in enumerate(outline.places):
        m, rhs = np.empty((2, 2)), np.zeros((2, 4 * k))
        for j, s in enumerate(place):
            curve = outline.curves[i + j]
            _, slope = curve.height(s)
            m[j] = curve.tz - slope * curve.tx, -curve.tx - slope * curve.tz
            rhs[j, 4 * (i + j) : 4 * (i + j) + 4] = 1.0, s, s * s, s * s * s
        jacobian[2 * i : 2 * i + 2] = np.linalg.inv(m) @ rhs
    ends = ((0, 0, outline.places[0][0]), (k - 1, k - 2, outline.places[-1][1]))
    for row_, (side, corner, s) in enumerate(ends, start=2 * k - 2):
        curve = outline.curves[side]
        _, slope = curve.height(s)
        # A growing slope turns the tangent towards the normal (tz, -tx): against atan2(z, x).
        turned = -1.0 / (1.0 + slope * slope)
        jacobian[row_, 4 * side : 4 * side + 4] = 0.0, turned, 2 * s * turned, 3 * s * s * turned
        bend = turned * (2 * curve.c2 + 6 * s * curve.c3)
        step = bend * np.array((curve.tx, curve.tz))
        jacobian[row_] += step @ jacobian[2 * corner : 2 * corner + 2]
    return np.asarray(jacobian @ sigma @ jacobian.T)
