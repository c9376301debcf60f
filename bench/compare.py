"""How fast and how right distances to a mesh are, beside CloudCompare where it is installed."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import manifold3d
import numpy as np
import trimesh
from _table import Row, main

from tjscan.comparison.distance import MeshDistance
from tjscan.core.frames import Array
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh

CAD: Final = Path(__file__).parent.parent / "cad" / "tjoint-600x457.toml"
POINTS, TRIANGLES = 1_000_000, 100_000
SPREAD: Final = 1e-3
"""Standard deviation of the points about the surface, metres."""

REPEATS: Final = 3
CHECKED: Final = 200
"""Points whose distance is computed to every triangle."""


def stage() -> tuple[trimesh.Trimesh, Array]:
    """The example's joint in `TRIANGLES` triangles, and points about it, in mm."""
    built = build_joint_mesh(read_joint(CAD))
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(np.array(built.vertices), built.triangles.astype(np.uint64))
    )
    longest = 1.0
    while (refined := solid.refine_to_length(longest)).num_tri() < TRIANGLES:
        longest *= 0.9
    fine = refined.to_mesh64()
    vertices, faces = 1e3 * fine.vert_properties[:, :3], fine.tri_verts.astype(np.intp)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    rng = np.random.default_rng(1)
    on_it, _ = trimesh.sample.sample_surface(mesh, POINTS, seed=1)
    # In single precision, as CloudCompare reads them.
    points = (on_it + rng.normal(0, 1e3 * SPREAD, on_it.shape)).astype(np.float32)
    return mesh, points.astype(float)


def cloud_compare(mesh: trimesh.Trimesh, points: Array) -> tuple[float, Array]:
    """Seconds that CloudCompare takes, as it says itself, and its distances in mm."""
    program = shutil.which("CloudCompare")
    if program is None:
        raise FileNotFoundError("CloudCompare is not installed (Debian: cloudcompare)")
    with TemporaryDirectory() as name:
        folder = Path(name)
        mesh.export(folder / "mesh.ply")
        (folder / "cloud.ply").write_bytes(trimesh.PointCloud(points).export(file_type="ply"))
        command = "-SILENT -NO_TIMESTAMP -C_EXPORT_FMT PLY -PLY_EXPORT_FMT BINARY_LE"
        command += " -O cloud.ply -O mesh.ply -C2M_DIST"
        environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
        seconds = math.inf
        for _ in range(REPEATS):
            done = subprocess.run(
                [program, *command.split()],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=True,
                timeout=600,
            )
            told = re.findall(r"\[compute\w*\] Time: ([\d.]+) s", done.stdout + done.stderr, re.I)
            if not told:
                raise ValueError("CloudCompare does not say how long it took")
            seconds = min(seconds, sum(map(float, told)))
        head, body = (folder / "cloud_C2M_DIST.ply").read_bytes().split(b"end_header\n", 1)
        columns = [line.split()[2] for line in head.decode().splitlines() if "property" in line]
        table = np.frombuffer(body, dtype=[(name, "<f4") for name in columns])
        return seconds, table[columns[-1]].astype(float)


def brute_force(mesh: trimesh.Trimesh, point: Array) -> float:
    """Distance of one point, shape (3,), from every triangle, the least of them."""
    corners = np.asarray(mesh.vertices)[mesh.faces]
    feet = trimesh.triangles.closest_point(corners, np.broadcast_to(point, (len(corners), 3)))
    return float(np.linalg.norm(feet - point, axis=1).min())


def measure() -> list[Row]:
    mesh, points = stage()
    vertices, faces = 1e-3 * np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.intp)
    seconds, distances = math.inf, np.empty(0)
    for _ in range(REPEATS):
        start = time.perf_counter()
        surface = MeshDistance(vertices, faces)
        built = time.perf_counter()
        distances = 1e3 * surface.signed_distances(1e-3 * points)
        # Ours with the search tree of the mesh, theirs without loading: not to our favour.
        seconds = min(seconds, time.perf_counter() - start)
        print(
            f"{len(faces)} triangles built in {built - start:.2f} s, {len(points)} distances in "
            f"{time.perf_counter() - built:.2f} s",
            file=sys.stderr,
        )
    chosen = np.random.default_rng(2).choice(len(points), CHECKED, replace=False)
    off = max(abs(abs(distances[i]) - brute_force(mesh, points[i])) for i in chosen)
    rows = [
        Row("distances per second, mesh built anew", len(points) / seconds, math.inf, "1/s", 2e5),
        Row(f"distance, most wrong of {CHECKED} against every triangle", off, 1e-3, "mm"),
    ]
    try:
        theirs, reference = cloud_compare(mesh, points)
    except (OSError, ValueError, subprocess.SubprocessError) as reason:
        print(f"CloudCompare left out: {reason}", file=sys.stderr)
        return rows
    apart = float(np.abs(np.abs(distances) - np.abs(reference)).max())
    # Before a sharp edge the nearest triangle's normal, which CloudCompare looks at, may tell the
    # wrong side: these few are no error of ours.
    other = int(np.sum((np.abs(distances) > 1e-3) & (distances * reference < 0)))
    return [
        *rows,
        Row("time over CloudCompare's -C2M_DIST", seconds / theirs, 1.5),
        Row("distance, farthest from CloudCompare's", apart, 1e-3, "mm"),
        Row("points on the other side than CloudCompare says", other, 1e-5 * len(points)),
    ]


if __name__ == "__main__":
    sys.exit(main("Comparison with a mesh", measure, sys.argv[1:]))
