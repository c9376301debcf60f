"""Sections drawn with their dimensions, as vectors in the page itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.frames import Array, inverse_pose, transform_points, unit_vector
from tjscan.groove.measured import MeasuredSection
from tjscan.joint.geometry import radial_direction
from tjscan.report.data import ReportData
from tjscan.report.dimensions import (
    Dimension,
    clock_text,
    section_dimensions,
    sections_by_the_clock,
)
from tjscan.result.directions import section_directions

LARGEST_DISTANCE_OFF_PLANE: Final = 0.2e-3
"""Metres from a section's plane within which points belong to its profile."""

MOST_PROFILE_DOTS: Final = 250


@dataclass(frozen=True, slots=True)
class DrawnLabel:
    """A dimension as a drawing shows it.

    Parameters
    ----------
    x, y : float
        Of its text, in the drawing's millimetres.
    anchor : str
        ``start``, ``middle`` or ``end``, as SVG has it.
    text, under : str
        As measured, and below it as designed.
    verdict : str
        As of `Dimension`.
    """

    x: float
    y: float
    anchor: str
    text: str
    under: str = ""
    verdict: str = ""


@dataclass(frozen=True, slots=True)
class SectionDrawing:
    """A section as SVG paths, in millimetres: x out of the brace's wall, y down it.

    Parameters
    ----------
    title, alt : str
        Which section it is, and what is measured in it, in words.
    box : str
        What of the plane is shown, as ``viewBox`` has it.
    letters : float
        Height of the texts.
    paths : mapping of str to str
        Solid ``steel``, the measured ``outline``, ``dots`` of the profile, and ``thin`` lines.
    lines : tuple of str
        Paths between the ticks of the dimensions.
    labels : tuple of DrawnLabel
    """

    title: str
    alt: str
    box: str
    letters: float
    paths: Mapping[str, str]
    lines: tuple[str, ...]
    labels: tuple[DrawnLabel, ...]


def draw_sections(data: ReportData) -> list[SectionDrawing]:
    """Draw the sections nearest to the full hours of the clock, see `sections_by_the_clock`.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    chosen = sections_by_the_clock(data)
    sections = [data.sections[k] for k in chosen]
    leg_normals = section_directions(data.sections).leg[chosen]
    azimuths = data.unwrapped_azimuths
    size = 1e3 * float(np.median([np.linalg.norm(s.points[1] - s.points[3]) for s in sections]))
    planes = [_section_plane(*one, size) for one in zip(sections, leg_normals, strict=True)]
    half = 0.5 * max(float(plane.p[3, 1] - plane.p[1, 1]) for plane in planes) + 0.75 * size
    drawings = []
    every = section_dimensions(sections, data.joint)
    for k, section, plane, dimensions in zip(chosen, sections, planes, every, strict=True):
        at = "" if azimuths is None else f"{clock_text(azimuths[k])}, "
        title, bore = f"{at}section {data.section_number(section)}", None
        if data.joint is not None:
            slant = abs(float(section.T_r_g[:3, 2] @ radial_direction(section.azimuth)))
            bore = -1e3 * data.joint.brace_wall / slant
        drawings.append(_draw_section(plane, title, dimensions, bore, half, data.cloud))
    return drawings


@dataclass(frozen=True, slots=True, eq=False)
class _SectionPlane:
    """A section's plane: p1 to p5 in it, (5, 2), unit vectors up the bevel and out on the leg."""

    T_g_r: Array
    p: Array
    seen: tuple[bool, ...]
    bevel: Array
    leg: Array
    size: float

    def flat(self, points: Array) -> Array:
        """Points near the plane, (m, 2), of points (n, 3) in the sections' frame."""
        points_g = transform_points(self.T_g_r, points)
        near = points_g[np.abs(points_g[:, 0]) < LARGEST_DISTANCE_OFF_PLANE]
        return 1e3 * near[:, [2, 1]] * (1, -1)

    @property
    def apex(self) -> Array:
        """Where bevel and leg, drawn on, meet."""
        along = np.linalg.solve(np.column_stack((self.bevel, -self.leg)), self.p[3] - self.p[2])
        return np.asarray(self.p[2] + along[0] * self.bevel)

    @property
    def leg_svg_path(self) -> str:
        """The leg from p4 to p5 as a path, which leaves p4 along its tangent."""
        p4, p5 = self.p[3:]
        half = np.dot(p5 - p4, p5 - p4) / 2 / max(np.dot(p5 - p4, self.leg), 1e-9)
        return f"{_svg_point(p4)}Q{_svg_point(p4 + half * self.leg)} {_svg_point(p5)}"


def _section_plane(section: MeasuredSection, leg_normal: Array, size: float) -> _SectionPlane:
    T_g_r = inverse_pose(section.T_r_g)
    p = 1e3 * transform_points(T_g_r, section.points)[:, [2, 1]] * (1, -1)
    normal = (T_g_r[:3, :3] @ leg_normal)[[2, 1]] * (1, -1)
    along = unit_vector(np.array((-normal[1], normal[0])))
    seen = (True, *(name not in section.absent for name in ("p2", "p3", "p4")), True)
    bevel, leg = unit_vector(p[1] - p[2]), along * np.sign(along[0] or 1.0)
    return _SectionPlane(T_g_r, p, seen, bevel, leg, size)


def _draw_section(
    plane: _SectionPlane,
    title: str,
    dimensions: Sequence[Dimension],
    bore: float | None,
    half: float,
    cloud: Array,
) -> SectionDrawing:
    """Draw a section; `bore` is where the brace's inner wall is drawn, `half` its half height."""
    p, s = plane.p, plane.size
    by_name = {one.name: one for one in dimensions}
    left = min(p[2, 0], p[3, 0], bore or 0.0) - 1.4 * s
    y = (p[1, 1] + p[3, 1]) / 2
    low, high = np.array((left, y - half)), np.array((p[1, 0] + 1.45 * s, y + half))
    dots = plane.flat(cloud)
    dots = dots[((dots > low) & (dots < high)).all(axis=1)]
    marks: list[tuple[str, str, DrawnLabel]] = [_angle_mark(plane, by_name["groove angle"])]
    rooted = all(plane.seen[1:4])
    if rooted:
        width = by_name.get("root opening") or by_name["root bead"]
        marks += [_root_width_mark(plane, width), _depth_mark(plane, by_name["depth"])]
        if bore is not None and not isnan(by_name["root face"].value):
            marks.append(_root_face_mark(plane, by_name["root face"], bore))
    sides = zip(plane.seen[:3], plane.seen[1:4], p, p[1:], strict=False)
    straight = "".join(_svg_path(a, b) for one, other, a, b in sides if one and other)
    names = [
        DrawnLabel(float(x + 0.05 * s), float(y - 0.04 * s), "start", f"p{k}")
        for k, (x, y) in enumerate(p[1:4], start=2)
        if plane.seen[k - 1]
    ]
    spoken = ", ".join(f"{one.name} {one.text}" for one in dimensions)
    return SectionDrawing(
        title,
        f"{title}: {spoken}.",
        " ".join(f"{v:.2f}" for v in (*low, *(high - low))),
        round(0.13 * s, 2),
        {
            "steel": _steel_path(plane, bore, is_open="root opening" in by_name) if rooted else "",
            "outline": straight + ("M" + plane.leg_svg_path if plane.seen[3] else ""),
            "dots": "".join(
                f"M{x:.2f} {y:.2f}h0" for x, y in dots[:: -(-len(dots) // MOST_PROFILE_DOTS) or 1]
            ),
            "thin": "".join(thin for thin, _, _ in marks),
        },
        tuple(line for _, line, _ in marks),
        (*(label for _, _, label in marks), *names),
    )


def _steel_path(plane: _SectionPlane, bore: float | None, *, is_open: bool) -> str:
    """The brace down to its land, or with the bead that closes the root, and some of the leg."""
    p, s, leg = plane.p, plane.size, plane.leg
    inward = p[3] - 3 * s * leg
    deep = 0.35 * s * np.array((-leg[1], leg[0]))
    below = _svg_path(p[4] + deep, p[3] + deep, inward + deep, inward)
    solid = f"M{plane.leg_svg_path}{below.replace('M', 'L')}"
    solid += f"L{_svg_point(p[3])}Z"
    if bore is None:
        return solid
    foot = p[2] if is_open else p[3]
    at_bore = foot - leg * (foot[0] - bore) / leg[0]
    top = p[0, 1] - s
    rest = () if is_open else (p[3],)
    wall = _svg_path(np.array((p[1, 0], top)), p[1], p[2], *rest, at_bore, (bore, top))
    return f"{solid}{wall}Z"


def _angle_mark(plane: _SectionPlane, dimension: Dimension) -> tuple[str, str, DrawnLabel]:
    apex, reach = plane.apex, float(np.linalg.norm(plane.p[1] - plane.apex))
    r = 0.7 * reach
    start, end = apex + r * plane.bevel, apex + r * plane.leg
    beyond = _svg_path(plane.p[3], apex + 1.2 * r * plane.leg)
    thin = _svg_path(plane.p[1], apex, plane.p[3]) + beyond
    arc = f"M{_svg_point(start)}A{r:.2f} {r:.2f} 0 0 1 {_svg_point(end)}"
    at = apex + 1.02 * reach * unit_vector(plane.bevel + plane.leg)
    return thin, arc, _dimension_label(at, "start", dimension)


def _root_width_mark(plane: _SectionPlane, dimension: Dimension) -> tuple[str, str, DrawnLabel]:
    p3, p4, s = plane.p[2], plane.p[3], plane.size
    along = unit_vector(p4 - p3)
    away = np.array((-along[1], along[0]))
    away *= -np.sign(away[0] or 1.0)
    a, b = p3 + 0.3 * s * away, p4 + 0.3 * s * away
    at = np.array((min(a[0], b[0]) - 0.08 * s, p4[1] + 0.1 * s))
    return (
        _svg_path(p3, a + 0.05 * s * away) + _svg_path(p4, b + 0.05 * s * away),
        _svg_path(a, b),
        _dimension_label(at, "end", dimension),
    )


def _depth_mark(plane: _SectionPlane, dimension: Dimension) -> tuple[str, str, DrawnLabel]:
    """From the middle of the root to the line along the brace's wall, which is x = 0."""
    middle, s = (plane.p[2] + plane.p[3]) / 2, plane.size
    y = plane.p[1, 1] - 0.2 * s
    a, b = np.array((middle[0], y)), np.array((0.0, y))
    thin = _svg_path(middle, a - (0, 0.05 * s))
    return thin, _svg_path(a, b), _dimension_label(b - (0.08 * s, 0.22 * s), "end", dimension)


def _root_face_mark(
    plane: _SectionPlane, dimension: Dimension, bore: float
) -> tuple[str, str, DrawnLabel]:
    """From the brace's bore to p3."""
    p3, s = plane.p[2], plane.size
    y = (plane.p[1, 1] + p3[1]) / 2  # away from the root's own dimension
    a, b = np.array((bore, y)), np.array((p3[0], y))
    thin = _svg_path(p3, b - (0, 0.05 * s))
    return thin, _svg_path(a, b), _dimension_label(a - (0.08 * s, 0.05 * s), "end", dimension)


def _dimension_label(at: Array, anchor: str, dimension: Dimension) -> DrawnLabel:
    designed = dimension.designed_text
    under = f"({designed})" if designed else ""
    x, y = (round(float(v), 2) for v in at)
    return DrawnLabel(x, y, anchor, dimension.text, under, dimension.verdict)


def _svg_path(*points: ArrayLike) -> str:
    return "M" + "L".join(_svg_point(point) for point in points)


def _svg_point(point: ArrayLike) -> str:
    x, y = np.asarray(point, dtype=float)
    return f"{x:.2f} {y:.2f}"
