"""``groove.ply``: points, normals that stand on the true surfaces, and a colour for each side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from cells import PAPER, scan_example

from tjscan.core.frames import inverse_pose, transform_points
from tjscan.core.provenance import Provenance
from tjscan.job.files import read_scan_job
from tjscan.result.table import SIDE_COLOURS, GrooveCloud, write_cloud_ply
from tjscan.runs.scan.results import cloud_of_sections
from tjscan.runs.scan.run import result_frame_of_job

BRACE_RADIUS, LEG_RADIUS = 0.2286, 0.3
ON_SURFACE = 0.5e-3
LARGEST_ANGLE = np.radians(6)
"""Of the median normal: of a side that is an arc of 60 mm one normal is that of its chord."""


@pytest.fixture(scope="module")
def cloud() -> GrooveCloud:
    job = read_scan_job(PAPER)
    return cloud_of_sections(scan_example({}).sections, result_frame_of_job(job))


def test_normals_stand_on_brace_and_leg(cloud: GrooveCloud) -> None:
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1, atol=1e-9)
    for side, radius, axes in ((0, BRACE_RADIUS, [0, 1]), (3, LEG_RADIUS, [1, 2])):
        own = cloud.sides == side
        across = cloud.points[own][:, axes]
        distance = np.linalg.norm(across, axis=1)
        on = np.abs(distance - radius) < ON_SURFACE
        assert on.mean() > 0.8
        outward = across[on] / distance[on, None]
        cosines = (cloud.normals[own][on][:, axes] * outward).sum(axis=1)
        assert np.median(cosines) > np.cos(LARGEST_ANGLE)


def test_other_programs_read_points_normals_and_colours(cloud: GrooveCloud, tmp_path: Path) -> None:
    file = tmp_path / "groove.ply"
    write_cloud_ply(file, cloud, Provenance.for_file_written_now("job", "j"))
    read = trimesh.load(file)
    assert isinstance(read, trimesh.PointCloud)
    np.testing.assert_allclose(read.vertices, 1e3 * cloud.points, atol=1e-3)
    np.testing.assert_array_equal(read.colors[:, :3], SIDE_COLOURS[cloud.sides])
    data = read.metadata["_ply_raw"]["vertex"]["data"]
    normals = np.column_stack([data[f"n{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(normals, cloud.normals, atol=1e-6)


def test_a_cloud_moves_with_its_frame(cloud: GrooveCloud) -> None:
    job = read_scan_job(PAPER)
    frame = result_frame_of_job(job)
    in_base = cloud_of_sections(scan_example({}).sections, type(frame)())
    T = inverse_pose(frame.T_r_b)
    np.testing.assert_allclose(transform_points(T, cloud.points), in_base.points, atol=1e-9)
    np.testing.assert_allclose(cloud.normals @ T[:3, :3].T, in_base.normals, atol=1e-9)
