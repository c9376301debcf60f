"""Points as PLY: the laser's cloud of a groove, and the five points of every section."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result.section import FIELD_BY_NAME

CORNER_NORMALS: Final = ("wall_normal", "wall_normal", "bevel_normal", "leg_normal", "leg_normal")
"""Whose normal p1 to p5 are given: that of the surface they belong to."""

SECTION_PROPERTIES: Final = (
    *(("double", axis) for axis in "xyz"),
    *(("float", f"n{axis}") for axis in "xyz"),
    *(("float", f"tangent_{axis}") for axis in "xyz"),
    ("float", "azimuth"),
    ("float", "sigma"),
    ("int", "section"),
    ("uchar", "corner"),
)


def write_cloud_ply(file: Path, points: Array, provenance: Provenance) -> None:
    """Write ``groove.ply``: points, shape (n, 3) in metres, as binary PLY in mm."""
    properties = [("float", axis) for axis in "xyz"]
    head = _ply_head("binary_little_endian", provenance, len(points), properties)
    file.write_bytes(head + (1e3 * points).astype("<f4").tobytes())


def sections_to_ply(sections: Sequence[MeasuredSection], provenance: Provenance) -> bytes:
    """The five points of every section as PLY text, with normals, tangents and uncertainty.

    `section` counts the sections from 0 and `corner` is 1 to 5 for p1 to p5. `sigma` is the
    standard deviation of the point's place, all directions together, NaN for p1 and p5, which
    are where the profile ends.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In their order along the groove.
    provenance : Provenance
        Is in the comments; its unit of length is the file's.
    """
    n = len(sections)

    def printed(name: str) -> Array:
        cells = FIELD_BY_NAME[name].formatted_columns(sections, provenance.length)
        return np.array([[float(cell or "nan") for cell in row] for row in cells])

    sigmas = np.full((n, 5), np.nan)
    sigmas[:, 1:4] = printed("corner_sigmas")
    normals = {name: printed(name) for name in dict.fromkeys(CORNER_NORMALS)}
    columns = (
        printed("points").reshape(-1, 3),
        np.stack([normals[name] for name in CORNER_NORMALS], axis=1).reshape(-1, 3),
        np.repeat(printed("tangent"), 5, axis=0),
        np.repeat(printed("azimuth"), 5)[:, None],
        sigmas.reshape(-1, 1),
        np.repeat(np.arange(n), 5)[:, None],
        np.tile(np.arange(1, 6), n)[:, None],
    )
    lines = [" ".join(f"{value:.10g}" for value in row) for row in np.hstack(columns)]
    return (
        _ply_head("ascii", provenance, 5 * n, SECTION_PROPERTIES) + "\n".join([*lines, ""]).encode()
    )


def _ply_head(
    form: str, provenance: Provenance, count: int, properties: Sequence[tuple[str, str]]
) -> bytes:
    lines = [
        "ply",
        f"format {form} 1.0",
        provenance.comment_lines("comment").rstrip("\n"),
        f"element vertex {count}",
        *(f"property {kind} {name}" for kind, name in properties),
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii", errors="replace")
