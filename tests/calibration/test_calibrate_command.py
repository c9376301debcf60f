"""``tjscan calibrate`` on recorded profiles: what it reads, writes, refuses and ends with."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from _targets import TargetSimulator
from calibration_stage import (
    HAND,
    MM,
    NOISE,
    PLACES,
    PLANE,
    T_F_S,
    WINDOW,
    circle,
    error,
    looking,
    raised,
    shots,
    varied,
)
from cells import EXAMPLES
from command import tjscan
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from tjscan.calibration.file import read_calibration
from tjscan.core.frames import Array, inverse_pose, pose
from tjscan.core.pose_vector import boxminus
from tjscan.laser.profile import Profile

OPENLMD = Path(__file__).resolve().parents[3] / "shared" / "data" / "openlmd-lines"
KNOWN = {"target": "plane", "plane_mm": [float(v) for v in (*PLANE.u, 1e3 * PLANE.u0)]}
UNKNOWN = {"target": "plane"}
GOOD = (0.5 * MM, np.radians(0.1))
"""Bounds on position and rotation: several times what twelve lines leave uncertain."""


def write_rows(file: Path, header: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(header)
        writer.writerows(rows)
    return file


def write_lines(folder: Path, profiles: Sequence[Profile]) -> Path:
    rows = [
        (i, 1e3 * x, 1e3 * z)
        for i, profile in enumerate(profiles, start=1)
        for x, z in zip(profile.x_s, profile.z_s, strict=True)
    ]
    return write_rows(folder / "lines.csv", ("profile", "x_mm", "z_mm"), rows)


NOTATIONS: dict[str, tuple[tuple[str, ...], Callable[[Rotation], Array]]] = {
    "quaternion": (("qx", "qy", "qz", "qw"), lambda R: R.as_quat()),
    "rotation vector": (("rx_rad", "ry_rad", "rz_rad"), lambda R: R.as_rotvec()),
    "Euler angles": (("a_deg", "b_deg", "c_deg"), lambda R: R.as_euler("ZYX", degrees=True)),
}


def write_poses(folder: Path, poses: Array, notation: str = "quaternion") -> Path:
    names, write = NOTATIONS[notation]
    rows = [
        (i, *(1e3 * T[:3, 3]), *write(Rotation.from_matrix(T[:3, :3])))
        for i, T in enumerate(poses, start=1)
    ]
    return write_rows(folder / "poses.csv", ("profile", "x_mm", "y_mm", "z_mm", *names), rows)


def record(folder: Path, poses: Array, seed: int = 0) -> dict[str, object]:
    """Keys that name the files of a recording."""
    profiles = shots(poses, HAND, np.random.default_rng(seed))
    lines, places = write_lines(folder, profiles), write_poses(folder, poses)
    return {"profiles": str(lines), "poses": str(places)}


def write_job(folder: Path, *sets: Mapping[str, object], **tables: Mapping[str, object]) -> Path:
    """A job of recorded sets, with other tables beside them."""
    file = folder / "job.toml"
    file.write_text(tomli_w.dumps({**tables, "recorded": sets}), encoding="utf-8")
    return file


def test_all_notations_of_a_pose_give_the_same_calibration(tmp_path: Path) -> None:
    poses, found = circle(30), []
    record(tmp_path, poses)
    for notation in NOTATIONS:
        places = write_poses(tmp_path, poses, notation)
        out = tmp_path / notation
        files: dict[str, object] = {
            "profiles": "lines.csv",
            "poses": places.name,
        }  # from the job's folder
        assert tjscan("calibrate", write_job(tmp_path, files | KNOWN), "--out", out) == 0
        found.append(read_calibration(out / "calibration.toml").T_f_s)
    for T_f_s in found[1:]:
        np.testing.assert_allclose(T_f_s, found[0], atol=1e-9)
    off = error(found[0])
    assert np.linalg.norm(off[:3]) < GOOD[0]
    assert np.linalg.norm(off[3:]) < GOOD[1]


def with_decimal_commas(file: Path, mark: str, before: str) -> None:
    """Write a table again as a spreadsheet in Europe does."""
    text = file.read_text(encoding="utf-8").replace(",", mark).replace(".", ",")
    file.write_text(before + text, encoding="utf-8-sig", newline="")


@pytest.mark.parametrize("mark", [";", "\t", " ; "])
@pytest.mark.parametrize("before", ["", "# exported by hand; 12 poses\n\n", "# "])
def test_semicolons_and_decimal_commas_make_no_difference(
    tmp_path: Path, mark: str, before: str
) -> None:
    touched = HAND.touches(PLACES, np.random.default_rng(7))
    rows = (1e3 * touched).tolist()
    write_rows(tmp_path / "touched.csv", ("x_mm", "y_mm", "z_mm"), rows)
    files = record(tmp_path, varied(np.random.default_rng(3), 12))
    job = write_job(tmp_path, files | UNKNOWN | {"touched": "touched.csv"})
    assert tjscan("calibrate", job, "--out", tmp_path / "plain") == 0
    for name in ("poses.csv", "touched.csv"):
        with_decimal_commas(tmp_path / name, mark, before)
    with_decimal_commas(tmp_path / "lines.csv", mark, before.removesuffix("# "))
    assert tjscan("calibrate", job, "--out", tmp_path / "commas") == 0
    plain, commas = (
        read_calibration(tmp_path / run / "calibration.toml").T_f_s for run in ("plain", "commas")
    )
    np.testing.assert_array_equal(plain, commas)


@pytest.mark.parametrize("target", ["plane", "touched", "unknown plane"])
def test_a_board_is_stated_touched_or_unknown(tmp_path: Path, target: str) -> None:
    touched = HAND.touches(PLACES, np.random.default_rng(7))
    write_rows(tmp_path / "touched.csv", ("x_mm", "y_mm", "z_mm"), (1e3 * touched).tolist())
    keys: dict[str, dict[str, object]] = {
        "plane": {**KNOWN},
        "touched": {**UNKNOWN, "touched": "touched.csv"},
        "unknown plane": {**UNKNOWN},
    }
    files = record(tmp_path, varied(np.random.default_rng(3), 14))
    devices = {"arm": {"id": "ur10e"}, "laser": {"id": "simulated"}}
    job = write_job(tmp_path, files | keys[target], **devices)
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 0
    found = read_calibration(tmp_path / "run" / "calibration.toml", arm="ur10e", laser="simulated")
    assert np.linalg.norm(error(found.T_f_s)[:3]) < 2 * GOOD[0]
    assert found.method == ("plane unknown" if target == "unknown plane" else "plane touched")


def test_poses_and_rows_of_a_matrix_go_together_by_their_order(tmp_path: Path) -> None:
    """A matrix has columns a pitch apart: lines are cut at them."""
    poses, pitch = varied(np.random.default_rng(3), 12), 0.4 * MM
    x = pitch * (np.arange(120) - 59.5)
    rows = []
    for profile in shots(poses, HAND, np.random.default_rng(0)):
        seen = profile.points_s
        z = np.interp(x, seen[:, 0], seen[:, 2], left=np.nan, right=np.nan)
        rows.append([f"{1e3 * value:.4f}" if np.isfinite(value) else "-1" for value in z])
    lines = tmp_path / "lines.csv"
    lines.write_text("\n".join(",".join(row) for row in rows), encoding="utf-8")
    places = write_poses(tmp_path, poses)
    files = {"profiles": str(lines), "poses": str(places)}
    form = {"units": "mm", "pitch": 0.4, "invalid": [-1.0]}
    job = write_job(tmp_path, {**files, **form, **KNOWN})
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 0
    found = read_calibration(tmp_path / "run" / "calibration.toml")
    assert np.linalg.norm(error(found.T_f_s)[:3]) < GOOD[0]


def test_json_tells_it_all_and_words_name_the_bad_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    profiles = shots(circle(30), HAND, np.random.default_rng(0))
    profiles[4] = raised(profiles[4], 2 * MM)
    profiles[7] = Profile(profiles[7].x_s, np.full(len(profiles[7]), np.nan))
    lines, places = write_lines(tmp_path, profiles), write_poses(tmp_path, circle(30))
    job = write_job(tmp_path, {"profiles": str(lines), "poses": str(places), **KNOWN})
    assert tjscan("calibrate", job, "--json", "--out", tmp_path / "run") == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    np.testing.assert_allclose(np.array(found["T_f_s_mm"])[:3, 3], 1e3 * T_F_S[:3, 3], atol=0.5)
    assert [r["name"] for r in found["residuals"] if not r["used"]] == ["profile 5"]
    words = " ".join(told.err.split())
    assert "contradicting the others: profile 5" in words
    assert "profile 8 is left out: no line seen" in words
    assert "arm.id" in words


def test_a_missing_motion_is_named_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = np.stack([looking(0, a) for a in np.linspace(-30, 30, 10)])
    job = write_job(tmp_path, record(tmp_path, poses) | KNOWN)
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "turns about one axis only" in told
    assert "missing: tilt about" in told
    assert not (tmp_path / "run").exists()


def test_four_lines_are_too_few(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    job = write_job(tmp_path, record(tmp_path, circle(30, 4)) | UNKNOWN)
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 1
    assert "too few lines" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"target": None}, ["recorded number 1", "recorded.0.target", "required"]),
        ({"target": "cube"}, ["recorded.0.target", "'cube' is none of"]),
        ({**KNOWN, "touched": "p.csv"}, ["either stated by plane_mm or touched"]),
        ({**KNOWN, "target": "roof"}, ["of a target that is a plane"]),
        ({"target": "ball", "touched": "p.csv"}, ["of a target that is a plane"]),
        ({**UNKNOWN, "radius_mm": 30.0}, ["radius_mm is of a target that is a ball"]),
        ({**UNKNOWN, "plane_mm": [1.0, 2.0, 3.0]}, ["recorded.0.plane_mm"]),
        ({**UNKNOWN, "plane_mm": [0.0, 0.0, 0.0, 1.0]}, ["normal"]),
        ({"target": "ball", "radius_mm": 0.0}, ["radius_mm", "greater than 0"]),
        ({"target": "ball", "radius_mm": -3.0}, ["radius_mm", "greater than 0"]),
        ({**UNKNOWN, "touched": "nosuch.csv"}, ["nosuch.csv", "no such file"]),
        ({**KNOWN, "poses": "nosuch.csv"}, ["nosuch.csv", "no such file"]),
        ({**KNOWN, "profiles": "nosuch.csv"}, ["nosuch.csv", "no such file"]),
        ({**KNOWN, "radus_mm": 30.0}, ["unknown key; did you mean: radius_mm?"]),
    ],
)
def test_keys_that_do_not_fit_together_are_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    keys: dict[str, object],
    words: list[str],
) -> None:
    files = record(tmp_path, circle(30, 5)) | keys
    job = write_job(tmp_path, {key: value for key, value in files.items() if value is not None})
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 2
    told = " ".join(capsys.readouterr().err.split())
    for word in words:
        assert word in told
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--noise.range-mm", "0"], ["range_mm", "greater than 0"]),
        (["--unattended"], ["--unattended have no meaning"]),
        (["--dry-run"], ["nothing moves", "--dry-run"]),
        (["--arm"], ["joint angles beside them"]),
        (["--board.lines", "6"], ["board"]),
        (["--resume", "runs/x"], ["either a job file, or --resume"]),
        (
            ["--solve.calibrate-arm", "true", "--solve.fixed-sensor", "true"],
            ["needs a sensor on the arm"],
        ),
    ],
)
def test_options_that_do_not_fit_recorded_profiles_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: list[str]
) -> None:
    job = write_job(tmp_path, record(tmp_path, circle(30, 5)) | KNOWN)
    assert tjscan("calibrate", job, *options, "--out", tmp_path / "run") == 2
    told = " ".join(capsys.readouterr().err.split())
    for word in words:
        assert word in told
    assert not (tmp_path / "run").exists()


def test_something_to_calibrate_is_needed(tmp_path: Path) -> None:
    assert tjscan("calibrate") == 2
    (tmp_path / "job.toml").write_text("recorded = []", encoding="utf-8")
    assert tjscan("calibrate", tmp_path / "job.toml") == 2


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("x_mm", "x", "no columns x_mm"),
        ("qw", "w", "columns of one orientation"),
        ("qx", "a_deg", "columns of one orientation"),
        ("profile", "number", None),
        ("\n1,", "\n77,", "number 1, 77 has a profile or a pose, but not both"),
        ("\n1,", "\n2,", "profile 2 is there twice"),
        ("\n1,", "\n1,1,", "9 columns, the header 8"),
        ("\n1,", "\n1,nan", "pose 1:"),
        ("\n1,", "\n1,x", "pose 1:"),
    ],
)
def test_poses_that_are_none_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str | None
) -> None:
    files = record(tmp_path, circle(30))
    poses = tmp_path / "poses.csv"
    text = poses.read_text(encoding="utf-8").replace("\r\n", "\n")
    assert old in text
    poses.write_text(text.replace(old, new, 1), encoding="utf-8")
    code = tjscan("calibrate", write_job(tmp_path, files | KNOWN), "--out", tmp_path / "run")
    assert code == (0 if words is None else 2)
    if words is not None:
        told = " ".join(capsys.readouterr().err.split())
        assert words in told
        assert "poses.csv" in told


MISTAKEN_COLUMNS: dict[str, tuple[tuple[str, ...], str, Callable[[Rotation], Array]]] = {
    "radians as degrees": (
        ("a_deg", "b_deg", "c_deg"),
        "a_rad, b_rad, c_rad",
        lambda R: R.as_euler("ZYX"),
    ),
    "degrees as radians": (
        ("rx_rad", "ry_rad", "rz_rad"),
        "rx_deg, ry_deg, rz_deg",
        lambda R: R.as_rotvec(degrees=True),
    ),
    "angles swapped": (
        ("a_deg", "b_deg", "c_deg"),
        "w_deg, p_deg, r_deg",
        lambda R: R.as_euler("xyz", degrees=True),
    ),
    "scalar first": (
        ("qx", "qy", "qz", "qw"),
        "q1, q2, q3, q4",
        lambda R: R.as_quat(scalar_first=True),
    ),
    "scalar last": (
        ("q1", "q2", "q3", "q4"),
        "qx, qy, qz, qw",
        lambda R: R.as_quat(),
    ),
    "rotation vector as angles": (
        ("w_deg", "p_deg", "r_deg"),
        "rx_rad, ry_rad, rz_rad",
        lambda R: R.as_rotvec(),
    ),
    "angles as rotation vector": (
        ("rx_deg", "ry_deg", "rz_deg"),
        "w_deg, p_deg, r_deg",
        lambda R: R.as_euler("xyz", degrees=True),
    ),
    "nothing": (("qx", "qy", "qz", "qw"), "qx, qy, qz, qw", lambda R: R.as_quat()),
}
"""Names of columns, those that were meant, and the numbers."""
BALL = TargetSimulator(T_F_S, WINDOW, NOISE, radius=0.0127)


@pytest.mark.parametrize("mistake", MISTAKEN_COLUMNS)
@pytest.mark.parametrize("unit", ["mm", "m"])
def test_a_mistaken_convention_is_named_with_what_to_write(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], mistake: str, unit: str
) -> None:
    """`unit` is that of the numbers, below columns in millimetres."""
    rng = np.random.default_rng(21)
    poses = BALL.poses(rng, 14, "ball")
    lines = write_lines(tmp_path, [BALL.ball_profile(T, rng) for T in poses])
    names, meant, write = MISTAKEN_COLUMNS[mistake]
    scale = {"mm": 1e3, "m": 1.0}[unit]
    rows = [(*(scale * T[:3, 3]), *write(Rotation.from_matrix(T[:3, :3]))) for T in poses]
    places = write_rows(tmp_path / "poses.csv", ("x_mm", "y_mm", "z_mm", *names), rows)
    files = {"profiles": str(lines), "poses": str(places), "target": "ball", "radius_mm": 12.7}
    code = tjscan("calibrate", write_job(tmp_path, files), "--out", tmp_path / "run")
    told = " ".join(capsys.readouterr().err.split())
    if mistake == "nothing" and unit == "mm":
        assert code == 0
        return
    assert code == 1
    assert "read in another way than they were meant" in told
    assert f"name the columns x_{unit}, y_{unit}, z_{unit}, {meant} in" in told


@pytest.mark.parametrize("moved_mm", [0.0, 3.0])
def test_an_old_calibration_is_checked_on_a_few_new_profiles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], moved_mm: float
) -> None:
    job = write_job(tmp_path, record(tmp_path, circle(30)) | KNOWN)
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 0
    rng, poses = np.random.default_rng(31), varied(np.random.default_rng(32), 8)
    moved = T_F_S @ pose(None, 1e-3 * moved_mm * np.array((0.3, 0.0, 0.954)))
    hand = replace(HAND, T_f_s=moved)
    write_lines(tmp_path, [hand.profile(T, rng) for T in poses])
    write_poses(tmp_path, poses)
    code = tjscan("calibrate", job, "--check", tmp_path / "run" / "calibration.toml")
    told = " ".join(capsys.readouterr().err.split())
    assert code == (1 if moved_mm else 0)
    assert ("it does not hold" if moved_mm else "it holds") in told
    assert "the limit is" in told


def test_profiles_that_show_no_change_check_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = write_job(tmp_path, record(tmp_path, circle(30)) | KNOWN)
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 0
    record(tmp_path, np.stack([looking(0, a) for a in (0, 0, 1, 1, 2)]))
    assert tjscan("calibrate", job, "--check", tmp_path / "run" / "calibration.toml") == 1
    assert "too uncertain" in capsys.readouterr().err


def test_a_quaternion_that_is_none_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = write_lines(tmp_path, shots(circle(30), HAND, np.random.default_rng(0)))
    header = ("x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw")
    poses = write_rows(tmp_path / "poses.csv", header, [(0, 0, 0, 0, 0, 0, 2)] * 12)
    job = write_job(tmp_path, {"profiles": str(lines), "poses": str(poses), **KNOWN})
    assert tjscan("calibrate", job) == 2
    assert "length 2.000, not 1" in capsys.readouterr().err


def test_a_calibration_is_never_overwritten(tmp_path: Path) -> None:
    job = write_job(tmp_path, record(tmp_path, circle(30)) | KNOWN)
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 0
    before = (tmp_path / "run" / "calibration.toml").read_bytes()
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 2
    assert (tmp_path / "run" / "calibration.toml").read_bytes() == before


@pytest.mark.skipif(
    not OPENLMD.is_dir(), reason=f"the recorded lines are no part of the project; none at {OPENLMD}"
)
@pytest.mark.parametrize(("name", "code"), [("root", 0), ("calib4", 1)])
def test_real_lines_are_calibrated_or_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, code: int
) -> None:
    # There, the laser plane's axes are called x and y, and the sensor looks along x.
    lines = np.loadtxt(OPENLMD / f"{name}_profiles.csv", delimiter=",")[:, [0, 4, 3]]
    poses = np.loadtxt(OPENLMD / f"{name}_poses.csv", delimiter=",")
    header = ("frame", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw")
    files = {
        "profiles": str(
            write_rows(tmp_path / "lines.csv", ("frame", "x_mm", "z_mm"), lines.tolist())
        ),
        "poses": str(write_rows(tmp_path / "poses.csv", header, poses.tolist())),
    }
    noise = {"range_mm": 0.15, "correlation_columns": 60.0}
    job = write_job(tmp_path, files | UNKNOWN, noise=noise)
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == code
    told = " ".join(capsys.readouterr().err.split())
    if code == 0:
        assert "frame 1" in told
        assert read_calibration(tmp_path / "run" / "calibration.toml").lines == len(poses)
    else:
        assert "noise model can't explain" in told


def test_recordings_of_two_targets_are_solved_together(tmp_path: Path) -> None:
    known, unknown = (_recording_in(tmp_path / str(k), seed) for k, seed in enumerate((3, 4)))
    job = write_job(tmp_path, known | KNOWN, unknown | UNKNOWN)
    assert tjscan("calibrate", job, "--out", tmp_path / "run") == 0
    found = read_calibration(tmp_path / "run" / "calibration.toml")
    assert found.method == "plane touched and plane unknown"
    assert found.residuals[0].name == "plane 1, profile 1"
    assert found.geometry_mm == 0.3
    assert np.linalg.norm(error(found.T_f_s)[:3]) < 2 * GOOD[0]


def _recording_in(folder: Path, seed: int) -> dict[str, object]:
    folder.mkdir()
    return record(folder, varied(np.random.default_rng(seed), 8), seed)


def test_a_fixed_sensor_is_kept_in_the_base(tmp_path: Path) -> None:
    """What the arm carried is seen from where the sensor was: base and flange change places."""
    poses = varied(np.random.default_rng(3), 14)
    record(tmp_path, poses)
    places = write_poses(tmp_path, np.stack([inverse_pose(T) for T in poses]))
    files = {"profiles": "lines.csv", "poses": str(places), **UNKNOWN}
    run = tmp_path / "run"
    job = write_job(tmp_path, files, solve={"fixed_sensor": True})
    assert tjscan("calibrate", job, "--out", run) == 0
    found = read_calibration(run / "calibration.toml")
    assert found.T_f_s_mm is None
    assert found.T_b_s_mm is not None
    off = np.array(found.T_b_s_mm)[:3, 3] - 1e3 * T_F_S[:3, 3]
    assert np.linalg.norm(off) < 4e3 * GOOD[0]


def write_ball_files(folder: Path, unit: str = "mm", sign: int = 1) -> None:
    """A recording with a file a profile, and poses without units."""
    rng, scale = np.random.default_rng(21), {"mm": 1e3, "m": 1.0}[unit]
    poses = BALL.poses(rng, 14, "ball")
    for k, T in enumerate(poses, start=1):
        profile = BALL.ball_profile(T, rng)
        columns = scale * np.column_stack((sign * profile.z_s, profile.x_s))
        np.savetxt(folder / f"shot_{k}.csv", columns, delimiter=",", header="range,position")
    rows = [(*(scale * T[:3, 3]), *Rotation.from_matrix(T[:3, :3]).as_quat()) for T in poses]
    write_rows(folder / "robot.csv", ("x", "y", "z", "qx", "qy", "qz", "qw"), rows)


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_a_folder_of_profiles_and_poses_is_calibrated_and_checked_without_a_job(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str
) -> None:
    """The tenth file is the tenth pose's; units and axes are assumed, and said."""
    write_ball_files(tmp_path, unit)
    run, words = tmp_path / "run", ("--target", "ball", "--radius-mm", 12.7)
    assert (
        tjscan("calibrate", tmp_path, *words, "--out", run, "--arm.id", "a", "--laser.id", "b") == 0
    )
    told = " ".join(capsys.readouterr().err.split())
    for said in (f"{unit} is assumed", "column 2 is taken for x", "name the devices"):
        assert (said in told) == (said != "name the devices")
    found = read_calibration(run / "calibration.toml", arm="a", laser="b")
    off = boxminus(T_F_S, found.T_f_s)
    assert off @ np.linalg.solve(found.covariance_si, off) < chdtri(6, 1e-3)
    assert np.linalg.norm(off[:3]) < GOOD[0]
    assert tjscan("calibrate", tmp_path, *words, "--check", run / "calibration.toml") == 0


@pytest.mark.parametrize("stated", [False, True])
def test_heights_that_grow_towards_the_sensor_are_told_by_a_ball(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], *, stated: bool
) -> None:
    write_ball_files(tmp_path, sign=-1)
    words = ("--target", "ball", *(("--z-scale", "-1") if stated else ()))
    assert tjscan("calibrate", tmp_path, *words, "--out", tmp_path / "run") == 0
    assert ("state --z-scale -1" in " ".join(capsys.readouterr().err.split())) != stated
    z = read_calibration(tmp_path / "run" / "calibration.toml").T_f_s[:3, 2]
    assert z @ T_F_S[:3, 2] == pytest.approx(1.0 if stated else -1.0, abs=1e-3)


def test_a_recording_without_a_job_is_asked_for_what_can_not_be_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_ball_files(tmp_path)

    def refused(*words: object) -> str:
        assert tjscan("calibrate", *words, "--out", tmp_path / "run") == 2
        return " ".join(capsys.readouterr().err.split())

    assert "--target ball, roof or plane" in refused(tmp_path)
    (tmp_path / "again.csv").write_bytes((tmp_path / "robot.csv").read_bytes())
    assert "(found: again.csv, robot.csv)" in refused(tmp_path, "--target", "ball")
    (tmp_path / "again.csv").unlink()
    (tmp_path / "robot.csv").unlink()
    assert "--poses" in refused(tmp_path, "--target", "ball")
    assert "nothing moves" in refused(tmp_path, "--target", "ball", "--unattended")
    job = write_job(tmp_path, record(tmp_path, circle(30)) | KNOWN)
    for one in (job, EXAMPLES / "calibrate.toml"):
        assert "leave out --radius-mm" in refused(one, "--radius-mm", "3")
