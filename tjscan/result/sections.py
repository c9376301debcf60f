"""``sections.csv``: a row per section, in mm and degrees, in the frame of the result."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tjscan.frames import transform
from tjscan.result.frame import ResultFrame
from tjscan.scanning.scan import Scan

COLUMNS = (
    "index",
    "station",
    "azimuth_deg",
    "s_mm",
    *(f"p{i}{axis}_mm" for i in range(1, 6) for axis in "xyz"),
    "groove_angle_deg",
    "root_width_mm",
    "depth_mm",
    "area_mm2",
    "work_angle_deg",
    "rms_mm",
)


def rows(sections: Sequence[Scan], frame: ResultFrame) -> Iterator[list[str]]:
    """One row of text per section, in the order of COLUMNS."""
    origins = transform(frame.T_from_b, [scan.T_b_g[:3, 3] for scan in sections])
    s = np.concatenate(([0.0], np.linalg.norm(np.diff(origins, axis=0), axis=1).cumsum()))
    for scan, origin, along in zip(sections, origins, s, strict=True):
        groove = scan.groove
        azimuth = np.degrees(frame.azimuth(origin))
        yield [
            str(scan.view.index),
            "1",
            "" if np.isnan(azimuth) else f"{azimuth:.4f}",
            f"{1e3 * along:.4f}",
            *(f"{1e3 * v:.4f}" for v in transform(frame.T_from_b, scan.points_b).ravel()),
            f"{np.degrees(groove.opening_angle):.4f}",
            f"{1e3 * groove.root_width:.4f}",
            f"{1e3 * groove.depth:.4f}",
            f"{1e6 * groove.area:.3f}",
            f"{np.degrees(groove.work_angle):.4f}",
            f"{1e3 * groove.rms:.4f}",
        ]


def write_sections(file: Path, sections: Sequence[Scan], frame: ResultFrame) -> None:
    """Write ``sections.csv``."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        writer.writerows(rows(sections, frame))
