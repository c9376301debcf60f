"""The groove: its four edges as smooth curves through measured corners, and its root."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, Mask, cross, stretches_of_true_values
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.root import OPEN_ROOT, ROOT_NOT_SEEN, WELD_IN_GROOVE
from tjscan.groove.section import TACK_WELD
from tjscan.planning.smoothing import SmoothCurve

FEWEST_SECTIONS: Final = 4
"""Sections that a cubic needs."""

LEAST_CORNER_SIGMA: Final = 1e-6
"""Metres: no corner counts as known better."""

AREA_MATCHING_ROUNDS: Final = 8
"""Rounds in which the line between the toes of a weld is moved to where the area agrees."""

EDGE_CORNER_NAMES: Final = ("p3", "p4", "g", "p2")

RootKind = Literal["closed", "open", "welded"]
"""Closed by a bead or by the faces themselves, open, or under passes that are welded."""

Span = tuple[float, float]
"""Begin and end along the groove, metres; if it closes, any number of turns on."""

HIDDEN_ROOT_CONDITIONS: Final = (TACK_WELD, ROOT_NOT_SEEN)
"""Conditions of a section that does not show whether its root is open."""


@dataclass(frozen=True, slots=True, eq=False)
class RootAlongGroove:
    """The root at places along a groove.

    Parameters
    ----------
    s : ndarray, shape (k,)
        Lengths along the groove, metres.
    openness : ndarray, shape (k,)
        1 for open and 0 for closed; between both if a section does not show it and its neighbours
        differ.
    tacked : ndarray of bool, shape (k,)
        Whether a tack weld covers it.
    length : float
        Of the groove, metres.
    closed : bool
        Whether the groove closes.
    """

    s: Array
    openness: Array
    tacked: Mask
    length: float
    closed: bool

    def openness_at(self, s: Array) -> Array:
        """The same at lengths (m,), changing smoothly between sections.

        A corner in it would be one in the beads' paths, which no finer sampling would straighten.
        """
        period = self.length if self.closed else None
        linear = np.interp(s, self.s, self.openness, period=period)
        return np.asarray(linear**2 * (3 - 2 * linear))

    def is_open_between(self, begin: float, end: float) -> bool:
        """Whether the root is open anywhere between two lengths."""
        inside = self.s[(self.s > begin) & (self.s < end)]
        return bool((self.openness_at(np.concatenate(((begin,), inside, (end,)))) > 0).any())

    def tack_spans(self, tack_length: float) -> tuple[Span, ...]:
        """From where to where tacks may reach, metres: half their length beyond where they show."""
        reach = 0.5 * tack_length
        return tuple(
            (float(self.s[a] - reach), float(self.s[b - 1] + reach))
            for a, b in zip(*stretches_of_true_values(self.tacked), strict=True)
        )


@dataclass(frozen=True, slots=True, eq=False)
class GrooveEdges:
    """Curves of p3, p4, g and p2 over the length s of the chain of p3.

    Parameters
    ----------
    length : float
        Of the chain, back to its start if the groove closes; metres.
    closed : bool
        Whether the groove closes.
    sections : ndarray, shape (k,)
        Lengths of the measured sections, metres.
    correlation : ndarray, shape (k,)
        Standard deviation of each section's area as a share of what it would be if its corners
        erred independently.
    curves : tuple of SmoothCurve
        Of p3, p4, g and p2.
    root : RootAlongGroove
        Open, closed, tacked.
    shared_area_sigma : float
        Standard deviation by which the areas of all sections err alike, m².
    leg_radius : float or None
        Of the leg's cylinder that bounds the sections, metres; None if straight lines do.
    """

    length: float
    closed: bool
    sections: Array
    correlation: Array
    curves: tuple[SmoothCurve, ...]
    root: RootAlongGroove
    shared_area_sigma: float = 0.0
    leg_radius: float | None = None
    _together: SmoothCurve = field(init=False, repr=False)

    def __post_init__(self) -> None:
        together = copy(self.curves[0])
        together.weights = np.hstack([curve.weights for curve in self.curves])
        together.trend = np.hstack([curve.trend for curve in self.curves])
        object.__setattr__(self, "_together", together)

    def corners(self, s: Array) -> Array:
        """p3, p4, g and p2 at lengths (m,), shape (m, 4, 3), metres."""
        return self._together.values(s).reshape(-1, len(EDGE_CORNER_NAMES), 3)

    def derivatives(self, s: Array) -> Array:
        """Their derivatives by s, shape (m, 4, 3)."""
        return self._together.derivatives(s).reshape(-1, len(EDGE_CORNER_NAMES), 3)

    def root_opening(self, s: Array) -> Array:
        """Distance of p3 and p4, times the openness of the root, shape (m,), metres."""
        corners = self.corners(s)
        gaps = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        return np.asarray(gaps * self.root.openness_at(s))

    def relative_area_sigma(self, s: Array) -> Array:
        """Standard deviation of the area as a share of it, shape (m,), between sections as well."""
        corners = self.corners(s)
        spread = np.stack([curve.sigmas(s) for curve in self.curves], axis=1)
        period = self.length if self.closed else None
        scale = np.interp(s, self.sections, self.correlation, period=period)
        own = scale * _area_sigma_of_corners(corners, spread)
        return np.asarray(np.hypot(own, self.shared_area_sigma) / _quad_areas(corners))


def fit_groove_edges(
    sections: Sequence[MeasuredSection], longest_step: float, shared_area_sigma: float = 0.0
) -> GrooveEdges:
    """Fit smoothing splines to the corners of sections, weighted by their covariance.

    Weighted is what is each section's own, not what all sections of a scan share. g, where the
    lines along wall and leg meet, has no covariance of its own: see `_corner_sigmas`.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In their order along the groove.
    longest_step : float
        Sections further apart are refused, metres.
    shared_area_sigma : float
        Part of the standard deviations of their areas by which they all err alike, m².

    Raises
    ------
    ConfigurationError
        If there are too few, they are out of order, one is missing, or a stretch shows no root.
    """
    if len(sections) < FEWEST_SECTIONS:
        raise ConfigurationError(f"{FEWEST_SECTIONS} sections or more are needed", key="sections")
    points = np.array([s.points for s in sections])
    origins = np.array([s.T_r_g[:3, 3] for s in sections])
    corners = np.stack((points[:, 2], points[:, 3], origins, points[:, 1]), axis=1)
    areas = np.array([section.measures[3] for section in sections])
    if not (areas > 0).all():
        raise ConfigurationError(
            f"section number {int(np.argmin(areas > 0)) + 1} of the table has no area to fill: "
            "scan it again, or leave it out",
            key="sections",
        )
    welded = np.array([WELD_IN_GROOVE in section.conditions for section in sections])
    corners[welded] = _move_toes_to_area(corners[welded], areas[welded])
    sigmas = np.array([section.sigmas[3] for section in sections])
    own = np.sqrt(np.maximum(sigmas**2 - shared_area_sigma**2, 0.0))
    edges = fit_edges_to_corners(corners, _corner_sigmas(sections), own / areas, longest_step)
    _check_root_is_seen(sections, edges, longest_step)
    root = root_state_along_sections(sections, edges.sections, edges.length, closed=edges.closed)
    return replace(edges, shared_area_sigma=shared_area_sigma, root=root)


def _check_root_is_seen(
    sections: Sequence[MeasuredSection], edges: GrooveEdges, longest_step: float
) -> None:
    """Refuse a stretch of groove whose root was inferred, and not seen, in metres."""
    s, length = edges.sections, edges.length
    seen = np.flatnonzero([ROOT_NOT_SEEN not in section.conditions for section in sections])
    if len(seen):
        # Around a closed groove the first section that shows its root follows the last one.
        ends = (s[seen[-1]] - length, s[seen[0]] + length) if edges.closed else (s[0], s[-1])
        stops = np.concatenate((ends[:1], s[seen], ends[1:]))
        longest = float(np.diff(stops).max())
        begin = float(stops[np.diff(stops).argmax()]) % length
    else:
        begin, longest = 0.0, length
    if longest > longest_step or not len(seen):
        raise ConfigurationError(
            f"from {1e3 * begin:.0f} mm along the groove on no root is seen for "
            f"{1e3 * longest:.0f} mm, more than sequence.longest_step_mm: a plan would rest on "
            "guessed corners. Scan that stretch again, more squarely or from nearer",
            key="sections",
        )


def _move_toes_to_area(corners: Array, areas: Array) -> Array:
    """Corners, shape (m, 4, 3), with p3 and p4 moved along their flanks until the area is given.

    The line between the toes of a weld is raised, or lowered, to where it bounds the area that is
    left over the weld's surface, shape (m,), in m².
    """
    moved, share = corners.copy(), np.zeros(len(corners))
    towards = corners[:, [3, 2]] - corners[:, :2]  # from p3 to p2, and from p4 to g
    for _ in range(AREA_MATCHING_ROUNDS):
        # The area is nearly in proportion to what is left of the way.
        share = 1 - (1 - share) * areas / _quad_areas(moved)
        moved[:, :2] = corners[:, :2] + share[:, None, None] * towards
    return moved


def root_state_along_sections(
    sections: Sequence[MeasuredSection], s: Array, length: float, *, closed: bool
) -> RootAlongGroove:
    """The root as sections show it; for one that does not, the sections beside it count.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In their order along the groove.
    s : ndarray, shape (k,)
        Their lengths along the groove, metres.
    length : float
        Of the groove, metres.
    closed : bool
        Whether it closes.
    """
    tacked = np.array([TACK_WELD in section.conditions for section in sections])
    shown = np.array(
        [not set(HIDDEN_ROOT_CONDITIONS) & set(section.conditions) for section in sections]
    )
    openness = np.array([float(OPEN_ROOT in section.conditions) for section in sections])
    if shown.any():
        period = length if closed else None
        openness = np.interp(s, s[shown], openness[shown], period=period)
    return RootAlongGroove(s, openness, tacked, length, closed)


def fit_edges_to_corners(
    corners: Array, sigmas: Array, area_sigma: Array, longest_step: float
) -> GrooveEdges:
    """Fit the edges to corners.

    Parameters
    ----------
    corners : ndarray, shape (k, 4, 3)
        p3, p4, g and p2 of each section, metres.
    sigmas : ndarray, shape (k, 4)
        Their standard deviations, metres.
    area_sigma : ndarray, shape (k,)
        Standard deviation of each area as a share of it.
    longest_step : float
        Metres.

    Raises
    ------
    ConfigurationError
        If the sections are out of order or one is missing.
    """
    steps = np.diff(corners[:, 0], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    back = np.sum(steps[1:] * steps[:-1], axis=1) <= 0
    if lengths.min() <= 0 or back.any():
        i = int(np.argmax(back)) + 1 if back.any() else int(np.argmin(lengths))
        raise ConfigurationError(
            f"section number {i + 1} of the table and the one after it are out of order: the "
            "groove would run back there",
            key="sections",
        )
    gap = float(np.linalg.norm(corners[-1, 0] - corners[0, 0]))
    closed = len(corners) > FEWEST_SECTIONS and gap <= 2 * float(np.median(lengths))
    if (lengths > longest_step).any():
        i = int(np.argmax(lengths))
        raise ConfigurationError(
            f"sections number {i + 1} and {i + 2} of the table are {1e3 * lengths[i]:.0f} mm "
            "apart: one is missing between them, or the key is too small",
            key="sequence.longest_step_mm",
        )
    s = np.concatenate(([0.0], lengths.cumsum()))
    length = float(s[-1]) + (gap if closed else 0.0)
    # The noise of a corner has two directions; its sigma holds both together.
    spread = np.maximum(sigmas, LEAST_CORNER_SIGMA) / np.sqrt(2)
    curves = tuple(
        SmoothCurve(s, corners[:, j], spread[:, j], length, closed=closed) for j in range(4)
    )
    correlation = area_sigma * _quad_areas(corners) / _area_sigma_of_corners(corners, spread)
    none = np.zeros(len(s))
    root = RootAlongGroove(s, none, none.astype(bool), length, closed)
    return GrooveEdges(length, closed, s, correlation, curves, root)


def _quad_areas(corners: Array) -> Array:
    """Areas of quadrilaterals, shape (m, 4, 3), that are about flat; shape (m,)."""
    diagonals = corners[:, 2:] - corners[:, :2]
    return np.asarray(0.5 * np.linalg.norm(cross(diagonals[:, 0], diagonals[:, 1]), axis=1))


def _area_sigma_of_corners(corners: Array, spread: Array) -> Array:
    """Standard deviation of areas whose corners err independently, by `spread` in each direction.

    A corner moves the area by half the diagonal between its two neighbours.
    """
    diagonals = np.linalg.norm(corners[:, 2:] - corners[:, :2], axis=2)
    levers = 0.5 * diagonals[:, [1, 0, 1, 0]]
    return np.asarray(np.sqrt(np.sum((levers * spread) ** 2, axis=1)))


def _corner_sigmas(sections: Sequence[MeasuredSection]) -> Array:
    """Standard deviations of p3, p4, g and p2 by what is each section's own, shape (k, 4).

    The sigma of g is not measured: it is at least p2's and p4's together, and at least what the
    area's standard deviation allows for, since g moves the area by half its distance from p2 to p4.
    """
    p2, p3, p4 = np.array([section.own_corner_sigmas for section in sections]).T
    lever = np.array([0.5 * np.linalg.norm(s.points[1] - s.points[3]) for s in sections])
    area = np.array([section.sigmas[3] for section in sections])
    return np.stack((p3, p4, np.maximum(np.hypot(p2, p4), area / lever), p2), axis=1)
