"""``groove.ply``: every point of every finished section, in mm, in the frame of the result."""

from __future__ import annotations

from pathlib import Path

from tjscan.core.frames import Array


def write_cloud(file: Path, points: Array) -> None:
    """Write points, shape (n, 3) in metres, as PLY in mm."""
    import trimesh

    file.write_bytes(trimesh.PointCloud(1e3 * points).export(file_type="ply"))
