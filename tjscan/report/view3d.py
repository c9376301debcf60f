"""The data of the view that turns: sections, corner lines, points and the designed joint."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from tjscan.comparison.distance import DeviationDistances
from tjscan.comparison.maps import deviation_scale_mm
from tjscan.core.frames import Array
from tjscan.joint.definition import JointDefinition
from tjscan.report.charts import indices_near_groove
from tjscan.report.data import ReportData
from tjscan.report.dimensions import clock_text
from tjscan.report.findings import find_section_gaps, is_closed
from tjscan.result.section import UNIT_SYMBOLS, absent_corners, measure_columns
from tjscan.result.wireframe import joint_ghost_mesh, joint_wireframe

MOST_SHOWN_POINTS: Final = 40_000
"""A page of more would be slow, and too large."""

SEQUENTIAL_COLOURS, DIVERGING_COLOURS = "viridis", "coolwarm"
SCALE_SHADES: Final = 9
"""Between which the page mixes colours."""

MEASURES_COLOURED_BY: Final = ("groove_angle", "root_width", "depth")
"""Measures that the groove is coloured by."""


def groove_view_data(data: ReportData) -> dict[str, Any]:
    """All that the view draws and shows, in millimetres and degrees, for JSON.

    Parameters
    ----------
    data : ReportData
        The run.
    """
    corners = np.array([section.points for section in data.sections])
    absent = absent_corners(data.sections)
    azimuths = data.unwrapped_azimuths
    stations = () if data.stitching is None else data.stitching.stations
    points, deviation = _encoded_points(data)
    quantities = [*_section_quantities(data)]
    if deviation is not None:
        quantities.append(_point_deviation_quantity(deviation))
    middle = np.nan_to_num(data.sections[len(data.sections) // 2].azimuth)
    return {
        "frame": data.summary.frame,
        "azimuth": round(float(middle), 3),
        "sections": [
            {
                "label": str(section.index),
                "name": data.section_number(section),
                "where": "" if azimuths is None else f"at {clock_text(azimuths[k])} o'clock",
                "conditions": list(section.conditions),
                "corners": _rounded_mm(corners[k], 3),
                "seen": [True, *(~absent[k]).tolist(), True],
            }
            for k, section in enumerate(data.sections)
        ],
        "joined": _neighbours_without_gap(data),
        "quantities": quantities,
        "points": points,
        "ghost": _ghost_of_joint(data.joint),
        "stations": [{"name": one.name, "at": list(one.position_mm)} for one in stations],
    }


def _neighbours_without_gap(data: ReportData) -> list[list[int]]:
    """Pairs of neighbouring sections between which the groove was seen."""
    n, wide = len(data.sections), find_section_gaps(data)
    pairs = [[k, k + 1] for k in range(n - 1) if k not in wide]
    return [*pairs, [n - 1, 0]] if is_closed(data) else pairs


def _section_quantities(data: ReportData) -> Iterator[dict[str, Any]]:
    """What sections are coloured by: a value and its standard deviation for each."""
    for deviation in () if data.comparison is None else data.comparison.deviations:
        if deviation.kind.startswith("corners"):
            rows = np.nan_to_num(1e3 * deviation.distances.reshape(-1, 3), nan=-1).max(axis=1)
            yield _section_quantity(deviation.kind, "mm", np.where(rows < 0, np.nan, rows))
    for field, values, sigmas in measure_columns(data.sections):
        if field.name in MEASURES_COLOURED_BY:
            symbol = UNIT_SYMBOLS.get(field.unit.suffix, field.unit.suffix)
            yield _section_quantity(field.name_in_words, symbol, values, sigmas)
    opening = 1e3 * np.array([section.root_opening for section in data.sections])
    if not np.isnan(opening).all():
        edges = 1e3 * np.array([section.own_corner_sigmas[1] for section in data.sections])
        yield _section_quantity("root opening", "mm", opening, edges)
    sigmas = 1e3 * np.array([section.corner_sigmas.max() for section in data.sections])
    yield _section_quantity("standard deviation of the corners", "mm", sigmas)


def _section_quantity(
    name: str, unit: str, values: Array, sigmas: Array | None = None
) -> dict[str, Any]:
    known = values[~np.isnan(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    limits = (round(low, 4), round(max(high, low + 1e-3), 4))
    return _quantity_with_scale(name, unit, limits, SEQUENTIAL_COLOURS) | {
        "values": [None if np.isnan(value) else round(float(value), 4) for value in values],
        "sigmas": None if sigmas is None else [round(float(sigma), 4) for sigma in sigmas],
    }


def _quantity_with_scale(
    name: str, unit: str, limits: tuple[float, float], colours: str
) -> dict[str, Any]:
    """A quantity without values, and its scale of colours."""
    shades = [to_hex(colour) for colour in colormaps[colours](np.linspace(0, 1, SCALE_SHADES))]
    scale = {"low": limits[0], "high": limits[1], "colours": shades}
    return {"name": name, "unit": unit, **scale, "values": None, "sigmas": None}


def _point_deviation_quantity(deviation: DeviationDistances) -> dict[str, Any]:
    """What points are coloured by."""
    scale = round(deviation_scale_mm(deviation), 3)
    limits = (-scale if deviation.signed else 0.0, scale)
    colours = DIVERGING_COLOURS if deviation.signed else SEQUENTIAL_COLOURS
    return _quantity_with_scale(f"deviation, {deviation.kind}", "mm", limits, colours)


def _encoded_points(data: ReportData) -> tuple[dict[str, Any], DeviationDistances | None]:
    """Points near the groove as 16-bit numbers, and the deviations that they carry."""
    cloud = data.cloud
    chosen = indices_near_groove(data.sections, cloud)
    chosen = chosen[:: -(-len(chosen) // MOST_SHOWN_POINTS) or 1]
    points = 1e3 * cloud[chosen]
    carried = None if data.comparison is None else data.comparison.deviations[0]
    if carried is not None and len(carried.distances) != len(cloud):
        carried = None  # corners alone were compared
    values = np.empty(0) if carried is None else 1e6 * carried.distances[chosen]
    middle = points.mean(axis=0) if len(points) else np.zeros(3)
    reach = float(np.abs(points - middle).max(initial=1.0))
    unit = reach / np.iinfo(np.int16).max
    return {
        "middle": np.round(middle, 3).tolist(),
        "unit": unit,
        "at": _base64_of_int16((points - np.round(middle, 3)) / unit),
        "micrometres": _base64_of_int16(values),
    }, carried


def _base64_of_int16(numbers: Array) -> str:
    """Numbers rounded to 16 bits, little-endian; what is beyond ends there."""
    limits = np.iinfo(np.int16)
    rounded = np.clip(np.nan_to_num(np.round(numbers)), limits.min + 1, limits.max)
    return b64encode(rounded.astype("<i2").tobytes()).decode("ascii")


def _ghost_of_joint(joint: JointDefinition | None) -> dict[str, Any] | None:
    """The joint as designed, if known: triangles, and the lines of its edges and rings."""
    if joint is None:
        return None
    vertices, triangles = joint_ghost_mesh(joint)
    lines = [_rounded_mm(line[::3], 1) for line in joint_wireframe(joint) if len(line) > 2]
    return {"vertices": _rounded_mm(vertices, 1), "triangles": triangles.tolist(), "lines": lines}


def _rounded_mm(points: Array, decimals: int) -> list[list[float]]:
    rounded: list[list[float]] = np.round(1e3 * points, decimals).tolist()
    return rounded
