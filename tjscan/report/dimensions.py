"""What a drawing of the groove states: measured, how sure, as designed, and what is allowed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, isnan, nan, pi
from typing import Any, Final, Literal

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, inverse_pose, transform_points, unit_vector
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.section import section_from_points
from tjscan.joint.definition import NO_IMPERFECTIONS, NO_TOLERANCE_STATED, JointDefinition
from tjscan.joint.edges import ClosedPolyline, feature_edges
from tjscan.joint.geometry import radial_direction
from tjscan.report.data import ReportData
from tjscan.report.findings import is_closed
from tjscan.result.section import absent_corners, lengths_along_groove

DEGREES_PER_HOUR: Final = 30.0


def clock_text(azimuth: float) -> str:
    """A clock position in hours and minutes, such as 2:30 for 75°.

    Parameters
    ----------
    azimuth : float
        About the brace's axis from the crown, degrees.
    """
    minutes = round(60 * azimuth / DEGREES_PER_HOUR) % 720
    return f"{minutes // 60 or 12}:{minutes % 60:02d}"


CORNER_SEARCH_DISTANCE: Final = 30e-3
"""Metres from a measured corner within which its designed one is sought."""

COVERAGE_SIGMAS: Final = 2.0
"""Standard deviations of an uncertainty after ±."""

CLOCK_POSITIONS: Final = 12
DRAWN_SECTIONS_WITHOUT_CLOCK: Final = 6
"""Sections that are drawn if no clock position is known, evenly chosen."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """One dimension of a section, in degrees or millimetres.

    Parameters
    ----------
    name : str
        In words.
    unit : str
        ``°`` or ``mm``.
    value, sigma : float
        As measured, and its standard deviation; NaN if it is not seen.
    designed : float
        NaN if it is not known.
    tolerance : float
        Largest difference from the design that is allowed; infinite if none is stated.
    """

    name: str
    unit: str
    value: float
    sigma: float
    designed: float = nan
    tolerance: float = inf

    @property
    def verdict(self) -> Literal["", "within", "outside", "unsure"]:
        """Whether it keeps its tolerance with all of its uncertainty, see ISO 14253-1."""
        off, band = abs(self.value - self.designed), COVERAGE_SIGMAS * self.sigma
        if not isfinite(self.tolerance) or isnan(off) or isnan(band):
            return ""
        if off + band <= self.tolerance:
            return "within"
        return "outside" if off - band > self.tolerance else "unsure"

    @property
    def text(self) -> str:
        """Value and uncertainty, to the digits that the uncertainty allows."""
        if isnan(self.value):
            return "not seen"
        band = COVERAGE_SIGMAS * self.sigma
        digits = 1 if isnan(band) or band >= 0.1 else 2
        degree = "°" if self.unit == "°" else ""
        return f"{self.value:z.{digits}f}{degree} ± {band:.{digits}f}".replace("-", "−")

    @property
    def designed_text(self) -> str:
        """The designed value, with its tolerance if one is stated; empty if not known."""
        if isnan(self.designed):
            return ""
        degree = "°" if self.unit == "°" else ""
        allowed = f" ± {self.tolerance:g}" if isfinite(self.tolerance) else ""
        return f"{self.designed:.1f}{degree}{allowed}"


def sections_by_the_clock(data: ReportData) -> list[int]:
    """Places of the sections nearest to each full hour, evenly chosen ones without a joint."""
    n = len(data.sections)
    azimuths = data.unwrapped_azimuths
    if azimuths is None:
        count = min(DRAWN_SECTIONS_WITHOUT_CLOCK, n)
        return [int((k + 0.5) * n / count) for k in range(count)]
    hours = np.round(azimuths / DEGREES_PER_HOUR)
    off = np.abs(azimuths - hours * DEGREES_PER_HOUR)
    nearest: dict[int, int] = {}
    for k in np.lexsort((azimuths, off)):
        nearest.setdefault(int(hours[k]) % CLOCK_POSITIONS, int(k))
    if is_closed(data):  # all of a joint is counted from 12 o'clock on
        return [nearest[hour] for hour in sorted(nearest)]
    return sorted(nearest.values(), key=lambda k: float(azimuths[k]))


def section_dimensions(
    sections: Sequence[MeasuredSection], joint: JointDefinition | None
) -> list[tuple[Dimension, ...]]:
    """Groove angle, root, root face, depth and high-low of brace and leg of each section.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In frame j if a joint is given.
    joint : JointDefinition or None
        As designed.
    """
    absent = absent_corners(sections)
    design = np.full((len(sections), 4), nan)
    drawing = None if joint is None else joint_as_drawn(joint)
    if drawing is not None:
        design = designed_measures(sections, drawing)
    return [
        tuple(_dimensions_of_section(section, hidden, designed, drawing))
        for section, hidden, designed in zip(sections, absent, design, strict=True)
    ]


def joint_as_drawn(joint: JointDefinition) -> JointDefinition:
    """The joint without what makes it differ from its drawing; an open root stays open."""
    root = replace(NO_IMPERFECTIONS.root, is_open=joint.imperfections.root.is_open)
    return replace(joint, imperfections=replace(NO_IMPERFECTIONS, root=root))


def _dimensions_of_section(
    section: MeasuredSection, hidden: Array, designed: Array, drawing: JointDefinition | None
) -> Iterator[Dimension]:
    allowed = NO_TOLERANCE_STATED if drawing is None else drawing.tolerance
    is_open, rootless = not isnan(section.root_opening), bool(hidden[1:].any())
    measures, sigmas = section.measures, section.sigmas
    angle = measures[0], sigmas[0], designed[0], allowed.groove_angle
    yield _dimension_from_si("groove angle", *angle)
    width = section.root_opening if is_open else measures[1]
    name = "root opening" if is_open else "root bead"
    lost = nan if rootless else 0.0
    yield _dimension_from_si(name, width + lost, sigmas[1], designed[1], allowed.root_opening)
    if drawing is not None:
        # An open root's p3 is the outer edge of its face, which ends at the brace's bore.
        face, sigma = _corner_along(section, 1, _outward_from_brace(section.points[2]))
        unseen = 0.0 if is_open and not hidden[1] else nan
        depth = face - drawing.brace_inner_radius + unseen
        yield _dimension_from_si("root face", depth, sigma, drawing.root_face, allowed.root_face)
    yield _dimension_from_si("depth", measures[2] + lost, sigmas[2], designed[2], allowed.depth)
    if drawing is not None:
        yield from _high_low_dimensions(section, hidden, drawing)


def _high_low_dimensions(
    section: MeasuredSection, hidden: Array, drawing: JointDefinition
) -> Iterator[Dimension]:
    """How far the brace at p2 and the leg at p4 are outside their drawn places."""
    wall, sigma = _corner_along(section, 0, _outward_from_brace(section.points[1]))
    off = wall - drawing.brace_radius + (nan if hidden[0] else 0.0)
    yield _dimension_from_si("high-low, brace", off, sigma, 0.0, drawing.tolerance.high_low)
    leg = drawing.leg_surface
    _, sigma = _corner_along(section, 2, leg.normal(section.points[3]))
    off = float(leg.signed_distances(section.points[3])) + (nan if hidden[2] else 0.0)
    yield _dimension_from_si("high-low, leg", off, sigma, 0.0, drawing.tolerance.high_low)


def _outward_from_brace(point: Array) -> Array:
    """Unit vector out of the brace's wall at a point in frame j."""
    return radial_direction(float(np.arctan2(point[1], point[0])))


def _corner_along(section: MeasuredSection, corner: int, direction: Array) -> tuple[float, float]:
    """Place of p2, p3 or p4 along a unit vector, and its standard deviation, metres."""
    place = float(section.points[corner + 1] @ direction)
    return place, float(np.sqrt(direction @ section.covariances[corner] @ direction))


def _dimension_from_si(
    name: str, value: float, sigma: float, designed: float, tolerance: float | None
) -> Dimension:
    """A dimension from radians or metres."""
    is_angle, largest = name == "groove angle", inf if tolerance is None else tolerance
    factor = 180 / pi if is_angle else 1e3
    numbers = (float(v) * factor for v in (value, sigma, designed, largest))
    return Dimension(name, "°" if is_angle else "mm", *numbers)


def designed_measures(sections: Sequence[MeasuredSection], joint: JointDefinition) -> Array:
    """Groove angle, root width, depth and area, shape (n, 4); NaN if a plane meets no groove.

    The laser's plane is turned from the groove's normal plane, where a drawing states angles. So
    the designed edges are cut by the plane of each section, and measured like it.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In frame j.
    joint : JointDefinition
        As designed.
    """
    edges = feature_edges(joint)
    lines = (edges.p2, edges.p3, edges.p4)
    return np.array(
        [_designed_measures_of_section(section, lines, joint) for section in sections]
    ).reshape(-1, 4)


def _designed_measures_of_section(
    section: MeasuredSection, lines: Sequence[ClosedPolyline], joint: JointDefinition
) -> Array:
    T_g_j = inverse_pose(section.T_r_g)
    corners = [
        _intersect_line_with_plane(line, T_g_j, corner)
        for line, corner in zip(lines, section.points[1:4], strict=True)
    ]
    if any(corner is None for corner in corners):
        return np.full(4, np.nan)
    p2, p3, p4 = (corner for corner in corners if corner is not None)
    across = T_g_j[:3, :3]
    wall = _direction_in_plane(across @ radial_direction(np.arctan2(p2[1], p2[0])))
    leg = _direction_in_plane(across @ joint.leg_surface.normal(p4))
    points_g = transform_points(T_g_j, [p2, p3, p4])
    # As frame s sees it: x up the wall, z from the sensor into the joint.
    points = np.zeros((5, 3))
    points[1:4, 0], points[1:4, 2] = points_g[:, 1], -points_g[:, 2]
    down, out = (np.array((v[1], 0.0, -v[2])) for v in (-wall, leg))
    points[0], points[4] = points[1] - down, points[3] + out
    try:
        found = section_from_points(points, wall_s=down, leg_s=out)
    except GrooveNotFound:
        return np.full(4, np.nan)
    return np.array((found.groove_angle, found.root_width, found.depth, found.area))


def _direction_in_plane(normal_g: Array) -> Array:
    """Where a surface of that normal goes in the section's plane, up or outwards, in g."""
    direction = unit_vector(np.cross((1.0, 0.0, 0.0), normal_g))
    return np.asarray(direction * np.sign(direction[1] + direction[2]))


def _intersect_line_with_plane(line: ClosedPolyline, T_g_j: Array, near: Array) -> Array | None:
    """Where a line goes through the section's plane, nearest to a point, in frame j."""
    points = line.points_j
    x = points @ T_g_j[0, :3] + T_g_j[0, 3]
    after = np.roll(x, -1)
    starts = np.flatnonzero((x <= 0) != (after <= 0))
    if not starts.size:
        return None
    share = (x[starts] / (x[starts] - after[starts]))[:, None]
    ends = np.roll(points, -1, axis=0)[starts]
    cuts = points[starts] + share * (ends - points[starts])
    apart = np.linalg.norm(cuts - near, axis=1)
    return np.asarray(cuts[apart.argmin()]) if apart.min() < CORNER_SEARCH_DISTANCE else None


def fit_up_table(data: ReportData) -> dict[str, Any]:
    """Make the head and rows of the table of the sections nearest to the full hours.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    chosen = sections_by_the_clock(data)
    azimuths = data.unwrapped_azimuths
    lengths = 1e3 * lengths_along_groove(data.sections)
    sections = [data.sections[k] for k in chosen]
    every = section_dimensions(sections, data.joint)
    names = [one.name for one in every[0]]
    names[1] = " or ".join(dict.fromkeys(row[1].name for row in every))
    head = [f"{name} / {one.unit}" for name, one in zip(names, every[0], strict=True)]
    rows = []
    for k, section, dimensions in zip(chosen, sections, every, strict=True):
        where = f"{lengths[k]:.0f} mm" if azimuths is None else clock_text(azimuths[k])
        rows.append(((where, data.section_number(section)), dimensions))
    has_tolerances = any(one.verdict for row in every for one in row)
    head = ["at", "section", *head]
    return {"head": head, "rows": rows, "sigmas": COVERAGE_SIGMAS, "has_tolerances": has_tolerances}
