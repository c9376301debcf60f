"""A mesh holds what its header says, names nothing that is opened, and unpacks to little more."""

import os
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tjscan.comparison.clouds import read_shape_file
from tjscan.comparison.shapes import UserUnitAndFrame
from tjscan.core.errors import ConfigurationError
from tjscan.core.mesh_files import read_mesh_file

PCD = (
    """VERSION 0.7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
COUNT 1 1 1
WIDTH 8
HEIGHT 1
POINTS 8
DATA ascii
"""
    + "0 0 0\n10 20 30\n" * 4
)
BOX = trimesh.creation.box((10.0, 20.0, 30.0))


@pytest.mark.parametrize("kind", ["ply", "stl", "obj", "3mf"])
def test_a_box_comes_back(tmp_path: Path, kind: str) -> None:
    file = tmp_path / f"box.{kind}"
    BOX.export(file)
    points, triangles = read_mesh_file(file)
    np.testing.assert_allclose(np.ptp(points, axis=0), (10.0, 20.0, 30.0), atol=1e-6)
    assert triangles.shape == (12, 3)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_a_cloud_that_was_cut_off_is_refused(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "cloud.ply"
    cloud = trimesh.PointCloud(np.arange(300.0).reshape(100, 3))
    data = cloud.export(file_type="ply", encoding=encoding)
    for end in range(len(data) - 20, len(data) // 2, -97):
        file.write_bytes(data[:end])
        with pytest.raises((ConfigurationError, ValueError)):
            read_mesh_file(file)


def test_a_texture_that_a_ply_names_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.png")  # reading it would wait for ever
    file = tmp_path / "mesh.ply"
    head = BOX.export(file_type="ply", encoding="ascii")
    file.write_bytes(head.replace(b"\nelement", b"\ncomment TextureFile pipe.png\nelement", 1))
    assert len(read_mesh_file(file)[1]) == 12


def test_an_archive_that_unpacks_to_much_more_than_it_is_is_refused(tmp_path: Path) -> None:
    file, packed = tmp_path / "bomb.3mf", BytesIO()
    BOX.export(packed, file_type="3mf")
    with (
        zipfile.ZipFile(packed) as whole,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for name in whole.namelist():
            room = b" " * 5_000_000 if name.endswith(".model") else b""
            archive.writestr(name, whole.read(name) + room)
    assert file.stat().st_size < 20_000
    with pytest.raises(ConfigurationError, match="unpacks to 5"):
        read_mesh_file(file)


@pytest.mark.parametrize("kind", ["ply", "ascii ply", "stl", "obj", "3mf", "xyz", "csv", "pcd"])
def test_what_takes_too_much_memory_to_read_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    file = tmp_path / f"box.{kind.split()[-1]}"
    if kind == "pcd":
        file.write_text(PCD)
    elif kind in ("xyz", "csv"):
        np.savetxt(file, BOX.vertices, delimiter=",", header="x_mm,y_mm,z_mm", comments="#")
        if kind == "csv":
            file.write_text(file.read_text()[1:])
    elif kind == "ascii ply":
        BOX.export(file, encoding="ascii")
    else:
        BOX.export(file)
    stated = UserUnitAndFrame("mm", "j")
    read_shape_file(file, stated)
    monkeypatch.setattr("tjscan.core.mesh_files.MOST_MEMORY", 600)
    with pytest.raises(ConfigurationError, match="of memory to read, 0 at most: thin it out"):
        read_shape_file(file, stated)
