"""Read the groove off a profile, or refuse to."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tjscan.errors import GrooveNotFound
from tjscan.frames import Array
from tjscan.groove.chain import RIVAL_MARGIN, RIVALS, Chain, bearing, best_chains, outer_pairs
from tjscan.groove.curves import Curve
from tjscan.groove.models import TEE, GrooveModel
from tjscan.groove.refinement import (
    Outline,
    Row,
    coefficient_covariances,
    noise_of,
    refine,
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
    largest_sigma: float = 0.25e-3
    largest_rms: float = 0.15e-3
    inlier_share: float = 0.1


DEFAULT = GrooveSettings()

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
    return _section(row, outline)


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
    segments = find_segments(row.points, tolerance)
    chains: list[Chain] = []
    for i, j in outer_pairs(segments, settings.model):
        chains += best_chains(
            settings.model,
            row.points,
            row.tangents,
            (_curve(segments, i), _curve(segments, j)),
            int(segments.last[i]),
            int(segments.first[j]),
            tolerance,
        )
    if not chains:
        raise GrooveNotFound("no bevel", _shape(segments, settings.model), points)
    chains.sort(key=lambda c: c.price)
    chains = [c for c in chains[:RIVALS] if c.price <= chains[0].price + RIVAL_MARGIN]
    candidates = [c for h in chains if (c := _candidate(row, h, settings)) is not None]
    if not candidates:
        raise GrooveNotFound("no bevel", "no sides fit the points together", points)
    best = min(candidates, key=lambda c: c.price)
    _check(row, best, candidates, settings)
    return row, best.outline


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
    curved = [side.curved for side in settings.model.sides]
    outline = refine(row, list(chain.sides), curved, tolerance)
    if outline is None:
        return None
    price = 0.0
    for f in outline.fits:
        scaled = f.residuals / tolerance
        price += float(np.minimum(scaled * scaled, 1).sum())
    return _Candidate(outline, price)


def _check(
    row: Row, best: _Candidate, candidates: list[_Candidate], settings: GrooveSettings
) -> None:
    """Refuse what is not convincing."""
    for f, (s0, s1) in zip(best.outline.fits, pairwise(best.outline.edges), strict=True):
        share = np.count_nonzero(f.keep) / max(s1 - s0, 1)
        if share < settings.inlier_share:
            raise GrooveNotFound(
                "ambiguous", f"only {share:.0%} of a side's points lie on it", row.points
            )


def _section(row: Row, outline: Outline) -> GrooveSection:
    """Section of an outline of four sides."""
    wall, leg = outline.fits[0], outline.fits[-1]
    first = wall.curve.at(float(wall.basis[1][wall.keep].min()))
    last = leg.curve.at(float(leg.basis[1][leg.keep].max()))
    points = np.zeros((5, 3))
    points[0, [0, 2]] = first
    points[1:4, [0, 2]] = outline.corners
    points[4, [0, 2]] = last
    t1 = wall.curve.tangent(outline.places[0][0])
    t4 = leg.curve.tangent(outline.places[-1][1])
    residuals = np.concatenate([f.residuals[f.keep] for f in outline.fits])
    return section_from_points(
        points,
        wall_s=(t1[0], 0.0, t1[1]),
        leg_s=(t4[0], 0.0, t4[1]),
        rms=float(np.sqrt(np.mean(residuals**2))),
        covariance=_covariance(row, outline),
    )


def _covariance(row: Row, outline: Outline) -> Array:
    """Covariance of corners and end tangents, shape (2 k, 2 k) for k sides.

    Each corner X lies on both its sides, so for either ``m · dX = b · dc`` with m the side's
    normal there and b the derivatives of its height by its coefficients c.
    """
    noise = noise_of(row, outline)
    spread = coefficient_covariances(row, outline, noise)
    starts = np.cumsum([0] + [len(c) for c in spread])
    sigma = np.zeros((starts[-1], starts[-1]))
    for k, c in enumerate(spread):
        sigma[starts[k] : starts[k + 1], starts[k] : starts[k + 1]] = c
    corners = len(outline.corners)
    jacobian = np.zeros((2 * corners + 2, starts[-1]))
    for k, (sa, sb) in enumerate(outline.places):
        m, rhs = np.empty((2, 2)), np.zeros((2, starts[-1]))
        for row_, (side, s) in enumerate(((k, sa), (k + 1, sb))):
            curve = outline.fits[side].curve
            _, slope = curve.height(s)
            m[row_] = (curve.tz - slope * curve.tx, -curve.tx - slope * curve.tz)
            rhs[row_, starts[side] : starts[side + 1]] = (1.0, s, s * s)[: len(spread[side])]
        jacobian[2 * k : 2 * k + 2] = np.linalg.solve(m, rhs)
    for end, (side, k, s) in enumerate(
        ((0, 0, outline.places[0][0]), (len(outline.fits) - 1, corners - 1, outline.places[-1][1]))
    ):
        curve = outline.fits[side].curve
        # The slope turns the tangent from t towards the normal (tz, -tx): against atan2(z, x).
        _, slope = curve.height(s)
        scale = -1.0 / (1.0 + slope * slope)
        bend = 2 * curve.c2 * np.array([curve.tx, curve.tz])
        at = slice(starts[side], starts[side + 1])
        jacobian[2 * corners + end, at] = scale * np.array((0.0, 1.0, 2 * s))[: len(spread[side])]
        jacobian[2 * corners + end] += scale * bend @ jacobian[2 * k : 2 * k + 2]
    return np.asarray(jacobian @ sigma @ jacobian.T)
