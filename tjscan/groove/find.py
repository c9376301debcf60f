"""Read the groove off a profile, or refuse to."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tjscan.errors import GrooveNotFound
from tjscan.frames import Array
from tjscan.groove.curves import Curve
from tjscan.groove.matching import Hypothesis, bearing, match
from tjscan.groove.models import TEE, GrooveModel
from tjscan.groove.refinement import (
    Outline,
    Row,
    coefficient_covariances,
    noise_of,
    refine,
)
from tjscan.groove.roots import RootSearch, find_root
from tjscan.groove.section import GrooveSection, section_from_points
from tjscan.groove.segments import Segments, find_segments, thin
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
    inlier_share: float = 0.25


DEFAULT = GrooveSettings()

TOLERANCE = 4.0
"""Points within this many expected standard deviations of a hypothesis support it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A refined hypothesis."""

    outline: Outline
    root: RootSearch
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
    model = settings.model
    if len(model.sides) != 3 or model.corners[1].root is None or model.corners[1].root.optional:
        raise ValueError(f"model {model.name!r} has no section of five points")
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
    hypotheses = match(settings.model, segments, thin(row.points), tolerance)
    if not hypotheses:
        raise GrooveNotFound("no bevel", _shape(segments, settings.model), points)
    candidates = [c for h in hypotheses if (c := _candidate(row, h, settings)) is not None]
    if not candidates:
        raise GrooveNotFound(
            "no bevel", "no sides with a root between them fit the points together", points
        )
    best = min(candidates, key=lambda c: c.price)
    _check(row, best, candidates, settings)
    return row, best.outline


def _shape(segments: Segments, model: GrooveModel) -> str:
    names = ", ".join(side.name for side in model.sides)
    return f"{len(segments)} straight stretches, but no {names} that meet one after the other"


def _candidate(row: Row, hypothesis: Hypothesis, settings: GrooveSettings) -> _Candidate | None:
    """Fit long sides, find the root between them, refine all together."""
    model = settings.model
    tolerance = TOLERANCE * settings.noise
    sides = [
        Curve(*(float(v) for v in (*c, *t, *q)))
        for c, t, q in zip(
            hypothesis.sides.centre,
            hypothesis.sides.direction,
            hypothesis.sides.curve,
            strict=True,
        )
    ]
    curved = [side.curved for side in model.sides]
    full, full_curved = [sides[0]], [curved[0]]
    root = RootSearch(None, np.inf, np.inf)
    for k, corner in enumerate(model.corners):
        if corner.root is not None:
            root = find_root(
                row.points, row.tangents, sides[k], sides[k + 1], corner.root, tolerance
            )
            if root.curve is not None:
                full.append(root.curve)
                full_curved.append(False)
            elif not corner.root.optional:
                return None
        full.append(sides[k + 1])
        full_curved.append(curved[k + 1])
    outline = refine(row, full, full_curved, tolerance)
    if outline is None:
        return None
    price = 0.0
    for f in outline.fits:
        scaled = f.residuals / tolerance
        price += float(np.minimum(scaled * scaled, 1).sum())
    return _Candidate(outline, root, price)


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
    if best.root.gain < 3:
        raise GrooveNotFound("ambiguous", f"root explains {best.root.gain:.1f} points", row.points)


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
