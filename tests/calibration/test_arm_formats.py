"""Poses as FANUC, KUKA, ABB and UR write them, against rotations written out by hand."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.calibration.pose_files import (
    ORIENTATION_CONVENTIONS,
    poses_of_fanuc_program,
    poses_of_kuka_data,
    read_flange_poses,
)
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array

BY_COLUMNS = {convention.columns: convention.matrix for convention in ORIENTATION_CONVENTIONS}
angles = st.tuples(*[st.floats(-3.1, 3.1)] * 3).map(np.array)


def about(axis: str, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def rodrigues(vector: Array) -> Array:
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)


def of_quaternion(w: float, x: float, y: float, z: float) -> Array:
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@given(n=angles)
@settings(max_examples=40, deadline=None)
def test_angles_and_vectors_mean_what_their_makers_say(n: Array) -> None:
    closed: dict[tuple[str, ...], Callable[[], Array]] = {
        ("w", "p", "r"): lambda: about("z", n[2]) @ about("y", n[1]) @ about("x", n[0]),
        ("a", "b", "c"): lambda: about("z", n[0]) @ about("y", n[1]) @ about("x", n[2]),
    }
    if np.linalg.norm(n) > 1e-3:
        closed["rx", "ry", "rz"] = lambda: rodrigues(n)
    for columns, expected in closed.items():
        np.testing.assert_allclose(BY_COLUMNS[columns](n), expected(), atol=1e-12)


@given(n=st.tuples(*[st.floats(-1, 1)] * 4).map(np.array).filter(lambda q: q @ q > 0.01))
@settings(max_examples=40, deadline=None)
def test_quaternions_mean_what_their_makers_say(n: Array) -> None:
    w, x, y, z = n / np.linalg.norm(n)
    expected = of_quaternion(w, x, y, z)
    first, last = ("q1", "q2", "q3", "q4"), ("qx", "qy", "qz", "qw")
    np.testing.assert_allclose(BY_COLUMNS[first](np.array((w, x, y, z))), expected, atol=1e-12)
    np.testing.assert_allclose(BY_COLUMNS[last](np.array((x, y, z, w))), expected, atol=1e-12)


POSITION = (411.912, 331.036, 331.032)
FANUC_LS = """/PROG  SCAN
/MN
   1:L P[1] 100mm/sec FINE    ;
/POS
P[1:"first"]{
   GP1:
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =   411.912  mm,\tY =   331.036  mm,\tZ =   331.032  mm,
\tW =  -177.169 deg,\tP =    -1.812 deg,\tR =   176.443 deg
};
P[2]{
   GP1:
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =   -11.900  mm,\tY =      .5  mm,\tZ =   331.000  mm,
\tW =     0.000 deg,\tP =     0.000 deg,\tR =    90.000 deg
};
/END
"""
KUKA_DAT = """&ACCESS RVP
DEFDAT SCAN
DECL E6POS XP1={X 411.912,Y 331.036,Z 331.032,A 176.443,B -1.812,C -177.169,S 6,T 50,E1 0.0,E2 0.0}
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}
DECL E6POS XP2={X -11.9,Y 0.5,Z 331.0,A 90.0,B 0.0,C 0.0}
DECL E6AXIS XHOME={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0}
ENDDAT
"""


def test_a_fanuc_program_and_a_kuka_list_of_the_same_poses_agree(tmp_path: Path) -> None:
    (tmp_path / "scan.ls").write_text(FANUC_LS, encoding="utf-8")
    (tmp_path / "scan.dat").write_text(KUKA_DAT, encoding="utf-8")
    fanuc, kuka = (read_flange_poses(tmp_path / f"scan.{end}") for end in ("ls", "dat"))
    assert list(fanuc.T_b_f) == list(kuka.T_b_f) == ["1", "2"]
    for key in ("1", "2"):
        np.testing.assert_allclose(fanuc.T_b_f[key], kuka.T_b_f[key], atol=1e-12)
    np.testing.assert_allclose(1e3 * fanuc.T_b_f["1"][:3, 3], POSITION)
    np.testing.assert_allclose(fanuc.T_b_f["2"][:3, :3], about("z", np.pi / 2), atol=1e-12)
    assert "FANUC" in fanuc.convention
    assert "KUKA" in kuka.convention
    assert fanuc.with_key


@pytest.mark.parametrize(
    ("header", "row", "name"),
    [
        ("X,Y,Z,W,P,R", "411.912,331.036,331.032,0,0,90", "FANUC"),
        ("X,Y,Z,A,B,C", "411.912,331.036,331.032,90,0,0", "KUKA"),
        ("x,y,z,q1,q2,q3,q4", "411.912,331.036,331.032,0.70710678,0,0,0.70710678", "ABB"),
        ("x,y,z,rx,ry,rz", "0.411912,0.331036,0.331032,0,0,1.5707963268", "UR"),
        ("x_m,y_m,z_m,w_rad,p_rad,r_rad", "0.411912,0.331036,0.331032,0,0,1.5707963268", "FANUC"),
    ],
)
def test_columns_of_makers_need_no_units(tmp_path: Path, header: str, row: str, name: str) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(f"{header}\n{row}\n", encoding="utf-8")
    found = read_flange_poses(file)
    assert name in found.convention
    np.testing.assert_allclose(1e3 * found.T_b_f["1"][:3, 3], POSITION)
    np.testing.assert_allclose(found.T_b_f["1"][:3, :3], about("z", np.pi / 2), atol=1e-8)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("/POS\n/END\n", "no positions"),
        ("P[1]{\n GP1:\n UF : 0, UT : 1,\n J1= 1.0 deg, J2= 2.0 deg\n};", "Cartesian"),
        (FANUC_LS.replace("UT : 1", "UT : 2", 1), "several frames"),
        (FANUC_LS.replace("GP1:", "GP1:\n GP2:", 1), "several motion groups"),
    ],
)
def test_a_program_that_can_not_be_read_says_why(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "scan.LS"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=said):
        read_flange_poses(file)
    with pytest.raises(ValueError, match=said):
        poses_of_fanuc_program(text)


def test_a_kuka_list_without_poses_is_refused() -> None:
    with pytest.raises(ValueError, match="no positions"):
        poses_of_kuka_data("DECL E6AXIS XHOME={A1 0.0}\n")
    with pytest.raises(ValueError, match="two positions"):
        poses_of_kuka_data(KUKA_DAT.replace("XP2", "YP1"))
