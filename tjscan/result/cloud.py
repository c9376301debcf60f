"""``groove.ply``: every point of every finished section, in mm, in the frame of the result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tjscan.core.frames import Array, transform
from tjscan.result.frame import ResultFrame
from tjscan.scanning.section import ScannedSection


def groove_points(sections: Sequence[ScannedSection], frame: ResultFrame) -> Array:
    """All profile points of the sections, shape (n, 3), metres, in the result's frame."""
    return np.concatenate(
        [transform(frame.T_r_b @ scan.view.T_b_s, scan.view.profile.points_s) for scan in sections]
    )


def write_cloud(file: Path, points: Array) -> None:
    """Write points, shape (n, 3) in metres, as PLY in mm."""
    import trimesh

    file.write_bytes(trimesh.PointCloud(1e3 * points).export(file_type="ply"))
