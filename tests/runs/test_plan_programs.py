"""What stations reach of a run's groove; their programs, run on the loopback controller."""

import csv
import json
import re
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest
from command import tjscan
from procedures import EXAMPLE, WPS_TEXT, wps_beside
from ur_cell import address, output_is_on, tell_dashboard

from tjscan.core.frames import Array
from tjscan.core.pose_vector import pose_from_vector
from tjscan.core.signals import interrupt_main_thread
from tjscan.job.files import read_scan_job
from tjscan.planning.wps import read_wps
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.plan.reach import WeldingStation
from tjscan.runs.plan.send import read_job_of_program_arm
from tjscan_loopback.process import UrLoopbackProcess
from tjscan_loopback.ur.controller import LoopbackController

ROOT = Path(__file__).parent.parent.parent
RUN = ROOT / "tests" / "data" / "run-0.1.0"
OUTPUT = 3
HZ = 25.0
OFF_PATH = 0.2e-3
OFF_SPEED = 0.02
ENDS = 10e-3
"""Metres at either end of a bead where the arm gains speed and loses it."""


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run directory of one scan, with its plan."""
    run = tmp_path_factory.mktemp("plan") / "run"
    shutil.copytree(RUN, run)
    options = ("--gravity", 0, 0, -1, "--output", OUTPUT, "--arc")
    assert tjscan("plan", run, "--wps", wps_beside(run), *options) in (0, 3)
    return run


def rows_of(run: Path, number: int) -> list[dict[str, str]]:
    lines = (run / "beads.csv").read_text(encoding="utf-8").splitlines()
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    return [row for row in rows if int(row["bead"]) == number]


def followed(run: Path, number: int) -> tuple[Array, Array]:
    """Tip of the wire in frame b, shape (n, 3), and the output, while a bead's lines are run."""
    lines = (run / "plan.urscript").read_text(encoding="utf-8").splitlines()
    starts = [i for i, line in enumerate(lines) if line.startswith("  # bead")] + [len(lines) - 1]
    head, part = lines[: starts[0]], lines[starts[number - 1] : starts[number]]
    arm, told = Kinematics.load("ur10e"), list[str]()
    tcp = read_wps(EXAMPLE).torch.tcp.T
    (joints,) = (line for line in head if "movej" in line)
    q = np.array([float(x) for x in joints[joints.index("[") + 1 : joints.index("]")].split(",")])
    controller = LoopbackController(arm, q, hz=HZ, fast=False, report_line=told.append)
    controller.start_script("\n".join((*head, *part, "end")))
    tips, outputs = [], []
    while told[-1] != "program stopped":
        controller.advance_one_tick()
        controller.resume_program()  # a layer is released at once
        tips.append((arm.forward(controller.q) @ tcp)[:3, 3])
        outputs.append(bool(controller.digital_outputs >> OUTPUT & 1))
    assert not [line for line in told if "failed" in line]
    return np.array(tips), np.array(outputs)


def test_the_reach_of_the_arm_is_part_of_the_plan(planned: Path) -> None:
    document = json.loads((planned / "plan.json").read_text(encoding="utf-8"))
    (station,) = document["stations"]
    begin, end = station["reached_mm"]
    assert station["program"] == "plan.urscript"
    assert 0 <= begin < end <= document["groove_mm"] + 0.1
    for bead in document["beads"]:
        if bead["station"] == station["name"]:
            assert begin - 0.1 <= bead["begin_mm"] < bead["end_mm"] <= end + 0.1


def test_a_curved_bead_is_followed_with_the_arc_on_on_it_alone(planned: Path) -> None:
    """Point by point against ``beads.csv``: path, speed, output."""
    rows = [row for row in rows_of(planned, 1) if row["station"]]
    points_j = 1e-3 * np.array([[float(row[k]) for k in ("x_mm", "y_mm", "z_mm")] for row in rows])
    speeds = np.array([float(row["speed_mm_min"]) for row in rows]) / 60e3
    tips, on = followed(planned, 1)
    script = (planned / "plan.urscript").read_text(encoding="utf-8").splitlines()
    moves = [line for line in script if "movep" in line][: len(rows) - 1]
    targets = [
        pose_from_vector([float(x) for x in m[m.index("[") + 1 : m.index("]")].split(",")])
        for m in moves
    ]
    points = np.array([T[:3, 3] for T in targets])
    # The program's points are the table's, in another frame.
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(points, axis=0), axis=1),
        np.linalg.norm(np.diff(points_j[1:], axis=0), axis=1),
        atol=1e-6,
    )
    points = np.concatenate((tips[on][:1], points))
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    away, s = distance_and_length(tips[on], points, along)
    assert away.max() <= OFF_PATH
    assert s.min() == pytest.approx(0, abs=OFF_PATH)
    assert s.max() == pytest.approx(along[-1], abs=OFF_PATH)
    even = (s > ENDS) & (s < along[-1] - ENDS)
    speed = HZ * np.diff(s)
    planned_speed = np.interp(s, along, speeds)
    np.testing.assert_allclose(speed[even[1:]], planned_speed[1:][even[1:]], rtol=OFF_SPEED)
    off = distance_and_length(tips[np.logical_not(on)], points, along)[0]
    assert off.max() >= 0.9 * read_wps(EXAMPLE).torch.retract


def distance_and_length(tips: Array, points: Array, along: Array) -> tuple[Array, Array]:
    """Distance of tips from a line of points, and the length along it of the nearest there."""
    chords = np.diff(points, axis=0)
    from_start = tips[:, None] - points[:-1]
    share = np.clip(np.sum(from_start * chords, axis=2) / np.sum(chords**2, axis=1), 0, 1)
    away = np.linalg.norm(from_start - share[..., None] * chords, axis=2)
    i = away.argmin(axis=1)
    j = np.arange(len(tips))
    return away[j, i], along[i] + share[j, i] * np.diff(along)[i]


def test_a_station_is_named_for_an_arm_alone(
    planned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--gravity", 0, 0, -1, "--station", "left")
    assert tjscan("plan", planned, "--wps", wps_beside(planned), *options) == 2
    assert "--station: names the station" in capsys.readouterr().err


def test_without_asking_for_the_reach_there_is_no_program(tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(RUN, run)
    tjscan("plan", run, "--wps", wps_beside(run), "--gravity", 0, 0, -1, "--no-reach")
    assert not (run / "plan.urscript").exists()
    document = json.loads((run / "plan.json").read_text(encoding="utf-8"))
    assert document["stations"] == []
    assert "not asked for" in document["without_stations"]


def test_a_torch_that_reaches_nothing_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, wps = tmp_path / "run", tmp_path / "wps.toml"
    shutil.copytree(RUN, run)
    text = WPS_TEXT.replace("[0.0, 60.0, 340.0]", "[0.0, 60.0, 3400.0]")
    wps.write_text(text, encoding="utf-8")
    assert tjscan("plan", run, "--wps", wps, "--gravity", 0, 0, -1) == 2
    message = capsys.readouterr().err
    assert f"{wps}: torch: no station reaches any of the groove" in message
    assert "out of the arm's reach" in message
    assert not (run / "plan.json").exists()


def job_of_real_arm(run: Path, host: str) -> Path:
    """The run's job, its arm a real one."""
    file = run.parent / "real.toml"
    text = (run / "job.toml").read_text(encoding="utf-8")
    text = text.replace('driver = "simulated"', 'driver = "ur"', 1)
    file.write_text(f'{text}\n[arm.ur]\nhost = "{host}"\n', encoding="utf-8")
    shutil.copy(run / "joint.toml", run.parent / "joint.toml")
    return file


@pytest.mark.usefixtures("ctrl_c_is_heard")
def test_a_program_is_sent_to_an_arm_and_ctrl_c_stops_it(
    planned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rtde_control")
    run, host = planned, address()
    way = (run / "plan.urscript").read_text(encoding="utf-8")
    home = way[way.index("movej([") + 7 : way.index("], a=")]
    degrees = [f"{np.degrees(float(x)):.6f}" for x in home.split(",")]
    with UrLoopbackProcess(host, "--fast", "--home-deg", *degrees) as loopback:
        stopper = threading.Thread(target=_interrupt_once_on, args=(host,))
        stopper.start()
        options = ("--gravity", 0, 0, -1, "--output", OUTPUT, "--arc", "--out", run / "sent")
        job = job_of_real_arm(run, host)
        assert tjscan("plan", run, "--wps", wps_beside(run), *options, "--send-to", job) == 130
        stopper.join()
        assert f"run on {host}, output {OUTPUT} switches the arc" in capsys.readouterr().err
        assert not output_is_on(loopback.host, OUTPUT)


def test_no_arc_is_struck_after_a_plan_that_is_out_of_the_wps(
    planned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, wps = planned, tmp_path / "cold.toml"
    text = WPS_TEXT
    cold = re.sub(r"heat_input_kJ_mm = \[.*?\]", "heat_input_kJ_mm = [0.5, 0.6]", text)
    wps.write_text(cold, encoding="utf-8")
    job = job_of_real_arm(run, address())  # where nobody listens
    options = ("--gravity", 0, 0, -1, "--arc", "--out", run / "cold", "--send-to", job)
    assert tjscan("plan", run, "--wps", wps, *options) == 3
    assert "nothing was sent" in " ".join(capsys.readouterr().err.split())


def _interrupt_once_on(host: str) -> None:
    pause = threading.Event()
    while not output_is_on(host, OUTPUT):
        tell_dashboard(host, "play")  # the wire feed is set
        pause.wait(0.2)
    interrupt_main_thread()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('driver = "ur"', 'driver = "simulated"', "arm.driver: a program goes to a real arm"),
        ('model = "ur10e"', 'model = "ur5e"', "arm.model: is a ur5e"),
        ('file = "joint.toml"', 'file = "other.toml"', "joint.file: is another joint"),
        ("522.0", "542.0", "joint: the arm is elsewhere by the joint"),
    ],
)
def test_a_program_goes_to_no_other_arm_and_joint(
    old: str, new: str, says: str, planned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = job_of_real_arm(planned, "127.0.0.1")
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    other = (planned / "joint.toml").read_text(encoding="utf-8").replace("457.2", "406.4")
    (planned.parent / "other.toml").write_text(other, encoding="utf-8")
    options = ("--gravity", 0, 0, -1, "--send-to", file)
    assert tjscan("plan", planned, "--wps", wps_beside(planned), *options) == 2
    assert says in capsys.readouterr().err


def test_a_joint_is_the_same_under_another_file_name(planned: Path, tmp_path: Path) -> None:
    file = job_of_real_arm(planned, "127.0.0.1")
    text = file.read_text(encoding="utf-8").replace('file = "joint.toml"', 'file = "copied.toml"')
    file.write_text(text, encoding="utf-8")
    shutil.copyfile(planned / "joint.toml", file.parent / "copied.toml")
    assert read_job_of_program_arm(file, None, planned).arm.driver == "ur"


def test_a_calibrated_arm_is_told_what_brings_it_where_it_should_be() -> None:
    model = Kinematics.load("ur10e")
    deviations = 1e-3 * np.random.default_rng(0).standard_normal((6, 6))
    true = deviate_joint_frames(model, deviations)
    job = read_scan_job(RUN / "job.toml")
    station = WeldingStation("arm", job, RUN / "job.toml", model, true, np.eye(4))
    q = np.radians([10, -80, 100, -60, -80, 20])
    told = station.commanded_pose(true.forward(q), q)
    np.testing.assert_allclose(model.inverse(told, near=q + 0.01), q, atol=1e-6)
