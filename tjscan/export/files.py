"""A groove's document as CSV, PLY and JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from typing import Final

import numpy as np

from tjscan.export.document import GrooveDocument, Section

CORNERS: Final = ("p1", "p2", "p3", "p4", "p5")
NORMAL_AT: Final = ("wall", "wall", "bevel", "leg", "leg")
"""Whose normal a point is given: that of the surface it belongs to."""

_PLY_TYPES: Final = {
    "x": "double",
    "y": "double",
    "z": "double",
    "nx": "float",
    "ny": "float",
    "nz": "float",
    "tangent_x": "float",
    "tangent_y": "float",
    "tangent_z": "float",
    "azimuth": "float",
    "sigma": "float",
    "section": "int",
    "corner": "uchar",
}


def to_json(document: GrooveDocument) -> bytes:
    """JSON after the schema of `GrooveDocument`."""
    return (document.model_dump_json(indent=1) + "\n").encode()


def to_csv(document: GrooveDocument) -> bytes:
    """A flat table, a row per section; units stand in the names of the columns."""
    unit = document.units.length
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    rows = [_flat(section, document.frame, unit) for section in document.sections]
    writer.writerow(rows[0])
    writer.writerows(row.values() for row in rows)
    return stream.getvalue().encode()


def to_ply(document: GrooveDocument) -> bytes:
    """The five points of every section, as text, with normals, tangents and sigmas.

    `section` and `corner` (1 to 5) say which point it is; `sigma` is the standard deviation of
    its place, all directions together, NaN for p1 and p5, which are where the profile ends.
    """
    rows = [_vertex(section, k) for section in document.sections for k in range(5)]
    head = [
        "ply",
        "format ascii 1.0",
        f"comment tjscan groove, version {document.version}, run {_one_line(document.run)}",
        f"comment units {document.units.length}, angles deg",
        f"comment frame {document.frame}: {document.frame_meaning}",
        f"element vertex {len(rows)}",
        *(f"property {kind} {name}" for name, kind in _PLY_TYPES.items()),
        "end_header",
    ]
    lines = [" ".join(f"{value:.10g}" for value in row) for row in rows]
    return "\n".join([*head, *lines, ""]).encode("ascii", errors="replace")


FORMATS: Final[dict[str, Callable[[GrooveDocument], bytes]]] = {
    "csv": to_csv,
    "ply": to_ply,
    "json": to_json,
}
"""What writes a document without an extra package."""


def _flat(section: Section, frame: str, unit: str) -> dict[str, object]:
    row: dict[str, object] = {
        "frame": frame,
        "index": section.index,
        "azimuth_deg": "" if section.azimuth is None else section.azimuth,
        f"s_{unit}": section.s,
        "station": section.station,
        "scan_index": section.scan_index,
    }
    for name, point in zip(CORNERS, section.points, strict=True):
        row |= {f"{name}{axis}_{unit}": v for axis, v in zip("xyz", point, strict=True)}
    normals = section.normals
    directions = {
        "tangent": section.tangent,
        "wall_normal": normals.wall,
        "bevel_normal": normals.bevel,
        "leg_normal": normals.leg,
    }
    for name, vector in directions.items():
        row |= {f"{name}_{axis}": v for axis, v in zip("xyz", vector, strict=True)}
    row |= {f"sigma_p{k}_{unit}": _sigma(section, k - 1) for k in (2, 3, 4)}
    for prefix, values in (("", section.measures), ("sigma_", section.sigmas)):
        row |= {
            f"{prefix}groove_angle_deg": values.groove_angle,
            f"{prefix}root_width_{unit}": values.root_width,
            f"{prefix}depth_{unit}": values.depth,
            f"{prefix}area_{unit}2": values.area,
        }
    return row | {"work_angle_deg": section.work_angle, f"rms_{unit}": section.rms}


def _vertex(section: Section, k: int) -> list[float]:
    normal = getattr(section.normals, NORMAL_AT[k])
    azimuth = float("nan") if section.azimuth is None else section.azimuth
    place = (azimuth, _sigma(section, k), section.index, k + 1)
    return [*section.points[k], *normal, *section.tangent, *place]


def _sigma(section: Section, k: int) -> float:
    """Standard deviation of a point's place, all directions together; NaN for p1 and p5."""
    if k not in (1, 2, 3):
        return float("nan")
    trace = np.trace(np.array(section.corner_covariances[k - 1]))
    return float(f"{np.sqrt(trace):.6g}")


def _one_line(text: str) -> str:
    return " ".join(text.split())
