from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tjscan.core.config import read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.joint.definition import FitUpTolerance
from tjscan.joint.file import JointFile, read_joint

CAD = Path(__file__).parents[2] / "cad"
PAPER = CAD / "tjoint-600x457.toml"
JOINTS = sorted(CAD.glob("*.toml"))


def changed(folder: Path, old: str, new: str) -> Path:
    text = PAPER.read_text(encoding="utf-8")
    assert text.count(old) == 1, "the example no longer holds what this test changes"
    file = folder / "joint.toml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file


def test_the_papers_joint_in_metres_and_radians() -> None:
    joint = read_joint(PAPER)
    assert joint.name == "tjoint-600x457"
    assert (2 * joint.leg_radius, joint.leg_wall) == pytest.approx((0.600, 0.020))
    assert (2 * joint.brace_radius, joint.brace_wall) == pytest.approx((0.4572, 0.0254))
    assert joint.brace_inner_radius == pytest.approx(0.2032)
    assert joint.angle == pytest.approx(np.pi / 2)
    assert joint.root_opening == pytest.approx(0.004)


def test_groove_angle_is_linear_between_pairs_and_flat_beyond() -> None:
    joint = read_joint(PAPER)
    at = np.deg2rad([10, 90, 115, 140, 170])
    np.testing.assert_allclose(
        np.rad2deg(joint.groove_angle_for_dihedral(at)), [50, 50, 57.5, 65, 65]
    )


@pytest.mark.parametrize("file", JOINTS, ids=lambda file: file.stem)
def test_a_file_survives_the_way_in_and_out(file: Path) -> None:
    assert JointFile.from_definition(read_joint(file)) == validate_table(JointFile, read_toml(file))


def test_tolerances_are_stated_or_none(tmp_path: Path) -> None:
    assert read_joint(PAPER).tolerance == FitUpTolerance()
    stated = "[tolerance]\ngroove_angle_deg = 5.0\nroot_opening_mm = 2.0\n[groove]"
    file = changed(tmp_path, "[groove]", stated)
    joint = read_joint(file)
    assert joint.tolerance == FitUpTolerance(groove_angle=np.deg2rad(5.0), root_opening=2e-3)
    assert JointFile.from_definition(joint) == validate_table(JointFile, read_toml(file))


@pytest.mark.parametrize(
    ("old", "new", "key", "says"),
    [
        (
            "outer_diameter_mm = 457.2",
            "outer_diameter_mm = 580.0",
            "brace.outer_diameter_mm",
            "571",
        ),
        (
            "outer_diameter_mm = 457.2",
            "outer_diameter_mm = 700.0",
            "brace.outer_diameter_mm",
            "571",
        ),
        (
            "outer_diameter_mm = 600.0",
            "outer_diameter_mm = -1.0",
            "leg.outer_diameter_mm",
            "greater",
        ),
        ("wall_mm = 20.0", "wall_mm = 300.0", "leg.wall_mm", "295"),
        ("wall_mm = 25.4", "wall_mm = 240.0", "brace.wall_mm", "223"),
        ("angle_deg = 90.0", "angle_deg = 44.0", "brace.angle_deg", "45°"),
        ("angle_deg = 90.0", "angle_deg = 100.0", "brace.angle_deg", "90°"),
        ("length_mm = 1400.0", "length_mm = 460.0", "leg.length_mm", "497"),
        ("length_mm = 650.0", "length_mm = 340.0", "brace.length_mm", "352"),
        ("[90.0, 50.0]", "[90.0, 84.0]", "groove.angle_deg", "smaller"),
        ("[90.0, 50.0]", "[90.0, 95.0]", "groove.angle_deg", "90°"),
        ("[90.0, 50.0]", "[90.0, 5.0]", "groove.angle_deg", "20°"),
        ("[90.0, 50.0]", "[150.0, 50.0]", "groove.angle_deg", "grow"),
        ("[[90.0, 50.0], [140.0, 65.0]]", "[]", "groove.angle_deg", "pair"),
        ("[[90.0, 50.0], [140.0, 65.0]]", "50.0", "groove.angle_deg", "[[90.0, 50.0]]"),
        ("[90.0, 50.0]", "[90.0, 50.0, 1.0]", "groove.angle_deg.0", "at most 2"),
        ("root_opening_mm = 4.0", "root_opening_mm = 30.0", "groove.root_opening_mm", "25.4"),
        ("root_opening_mm = 4.0", "root_opening_mm = nan", "groove.root_opening_mm", "finite"),
        ("root_face_mm = 1.5", "root_face_mm = 25.0", "groove.root_face_mm", "23.4"),
        ("root_bead_mm = 2.0", "root_bead_mm = 25.0", "groove.root_bead_mm", "23.8"),
        ("root_bead_mm = 2.0", 'root_bead_mm = "2"', "groove.root_bead_mm", "number"),
        ("root_opening_mm = 4.0", "root_opening = 4.0", "groove.root_opening", "root_opening_mm"),
    ],
)
def test_a_joint_that_cannot_be_built_is_refused(
    tmp_path: Path, old: str, new: str, key: str, says: str
) -> None:
    file = changed(tmp_path, old, new)
    with pytest.raises(ConfigurationError) as refusal:
        read_joint(file)
    assert refusal.value.file == file
    assert refusal.value.key == key
    assert says in refusal.value.message


def test_a_root_without_gap_and_bead_is_refused(tmp_path: Path) -> None:
    file = changed(tmp_path, "root_opening_mm = 4.0", "root_opening_mm = 0.0")
    file.write_text(file.read_text().replace("root_bead_mm = 2.0", "root_bead_mm = 0.5"))
    with pytest.raises(ConfigurationError, match="root only"):
        read_joint(file)


def test_a_heel_needs_a_groove_table_of_its_own(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="leaves no bevel") as refusal:
        read_joint(changed(tmp_path, "angle_deg = 90.0", "angle_deg = 45.0"))
    assert refusal.value.key == "groove.angle_deg"


def test_the_older_name_of_the_root_opening_is_read(tmp_path: Path) -> None:
    new = changed(tmp_path, "root_opening_mm = 4.0", "root_opening_mm = 3.5")
    stated = new.read_text(encoding="utf-8")
    old = tmp_path / "old.toml"
    old.write_text(stated.replace("root_opening_mm", "root_gap_mm"), encoding="utf-8")
    assert replace(read_joint(old), name="") == replace(read_joint(new), name="")
