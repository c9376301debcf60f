from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tjscan.cli.files import joint as joint_command
from tjscan.core.errors import RecordingError
from tjscan.joint.edges import feature_edges
from tjscan.joint.export import JointSidecar, build_and_write_joint
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh

CAD = Path(__file__).parents[2] / "cad"
PAPER = CAD / "tjoint-600x457.toml"
PRINTED = 1e-4
"""Last decimal of edges.csv, in mm; float32 in STL and PLY rounds finer."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("joint") / "made" / "here"
    build_and_write_joint(read_joint(PAPER), folder)
    return folder


def test_nothing_but_the_four_files_is_left(folder: Path) -> None:
    stem = PAPER.stem
    names = {file.name for file in folder.iterdir()}
    assert names == {f"{stem}.stl", f"{stem}.ply", f"{stem}.json", "edges.csv"}


def test_the_sidecar_says_what_was_built(folder: Path) -> None:
    joint = read_joint(PAPER)
    text = (folder / f"{PAPER.stem}.json").read_text(encoding="utf-8")
    sidecar = JointSidecar.model_validate_json(text)
    assert (sidecar.units, sidecar.frame) == ("mm", "j")
    assert sidecar.joint.definition(sidecar.name) == joint
    assert sidecar.triangles == len(build_joint_mesh(joint).triangles)
    assert sidecar.chord_error_mm < 0.005
    assert sidecar.dihedral_deg == pytest.approx((90, 139.6), abs=0.05)
    assert sidecar.intersection_length_mm == pytest.approx(2 * 755, abs=1)


@pytest.mark.parametrize("kind", ["stl", "ply"])
@pytest.mark.parametrize("file", sorted(CAD.glob("*.toml")), ids=lambda file: file.stem)
def test_mesh_files_hold_the_solid_in_millimetres(tmp_path: Path, file: Path, kind: str) -> None:
    joint = read_joint(file)
    build_and_write_joint(joint, tmp_path)
    solid = trimesh.load_mesh(tmp_path / f"{file.stem}.{kind}")
    mesh = build_joint_mesh(joint)
    assert solid.is_watertight
    np.testing.assert_allclose(
        solid.bounds, 1e3 * np.array((mesh.vertices.min(0), mesh.vertices.max(0))), atol=PRINTED
    )


def test_edges_are_written_in_millimetres(folder: Path) -> None:
    edges = feature_edges(read_joint(PAPER))
    with (folder / "edges.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    for name, line in (("p2", edges.p2), ("p3", edges.p3), ("p4", edges.p4)):
        mine = [row for row in rows if row["edge"] == name]
        written = [[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in mine]
        np.testing.assert_allclose(written, 1e3 * line.points_j, atol=PRINTED)
        azimuths = [float(row["azimuth_deg"]) for row in mine]
        np.testing.assert_allclose(azimuths, np.rad2deg(edges.phi), atol=PRINTED)


def test_a_second_build_replaces_the_first(tmp_path: Path) -> None:
    stale = tmp_path / f"{PAPER.stem}.json"
    stale.write_text("stale")
    build_and_write_joint(read_joint(PAPER), tmp_path)
    assert json.loads(stale.read_text())["name"] == PAPER.stem


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RecordingError, match="can't be written"):
        build_and_write_joint(read_joint(PAPER), tmp_path / "file")


def test_the_command_prints_its_result_as_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    joint_command(PAPER, out=tmp_path, json=True)
    assert JointSidecar.model_validate_json(capsys.readouterr().out).name == PAPER.stem


def test_the_command_builds_beside_the_definition(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(PAPER.read_text(encoding="utf-8"), encoding="utf-8")
    joint_command(file)
    assert (tmp_path / "build" / "mine" / "mine.stl").is_file()
    said = capsys.readouterr()
    assert not said.out
    assert "triangles" in said.err
