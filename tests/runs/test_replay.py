"""Old data through the whole chain after the sensor: what was found is found again."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from cells import PAPER
from command import tjscan
from written import content

from tjscan.core.errors import LaserFault, ViewNotRecorded
from tjscan.core.frames import Array, pose_from_euler_zyx
from tjscan.laser.replay import RecordedPoses
from tjscan.robot.arm import ArmState
from tjscan.robot.replay import ReplayedArm

RESULTS = ("sections.csv", "groove.ply")
SECTIONS = 7


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run, all faults on."""
    directory = tmp_path_factory.mktemp("runs") / "run"
    assert tjscan("scan", PAPER, "--out", directory, "--scan.sections", SECTIONS) == 0
    return directory


def replay(run: Path, out: Path, *options: object, job: Path | None = None) -> int:
    drivers = ("--arm.driver", "replay", "--laser.driver", "replay", "--laser.recording", run)
    replaying = (*drivers, "--out", out)
    return tjscan("scan", job or run / "job.toml", *replaying, *options)


def assert_same_results(run: Path, other: Path) -> None:
    for name in RESULTS:
        assert results_in(run / name) == results_in(other / name)


def results_in(file: Path) -> list[bytes]:
    """The lines of a file, without the comments that say when and from what it was written."""
    lines = file.read_bytes().split(b"\n")
    return [line for line in lines if not line.startswith((b"#", b"comment"))]


def without(text: str, *tables: str) -> str:
    """A job without some of its tables."""
    parts = re.split(r"(?m)^(?=\[)", text)
    return "".join(p for p in parts if not p.lstrip("[").startswith(tables))


def test_a_replay_with_the_same_settings_finds_the_same_to_the_last_digit(
    run: Path, tmp_path: Path
) -> None:
    assert replay(run, tmp_path / "again") == 0
    assert_same_results(run, tmp_path / "again")
    summaries = [json.loads((d / "summary.json").read_text()) for d in (run, tmp_path / "again")]
    assert summaries[0]["motion_time_s"] == summaries[1]["motion_time_s"]


def test_a_replay_is_a_run_that_can_be_replayed(run: Path, tmp_path: Path) -> None:
    assert replay(run / "scan.mcap", tmp_path / "first", job=run / "job.toml") == 0
    assert replay(tmp_path / "first", tmp_path / "second") == 0
    assert_same_results(run, tmp_path / "second")


def test_a_replay_needs_no_simulation_and_no_joint(run: Path, tmp_path: Path) -> None:
    job = tmp_path / "job.toml"
    job.write_text(without((run / "job.toml").read_text(), "simulation", "joint"))
    assert replay(run, tmp_path / "again", job=job) == 0
    assert json.loads((tmp_path / "again" / "summary.json").read_text())["frame"] == "b"


def test_a_cut_and_resumed_scan_replays_as_one(run: Path, tmp_path: Path) -> None:
    cut, again = tmp_path / "cut", tmp_path / "again"
    assert tjscan("scan", run / "job.toml", "--out", cut, "--scan.sections", 4) == 0
    data = (cut / "scan.mcap").read_bytes()
    (cut / "scan.mcap").write_bytes(data[: int(0.8 * len(data))])
    assert tjscan("scan", "--resume", cut, "--scan.sections", SECTIONS) == 0
    assert replay(cut, again, job=run / "job.toml") == 0
    assert_same_results(cut, again)


def test_a_replay_that_is_cut_goes_on(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    assert replay(run, out) == 0
    data = (out / "scan.mcap").read_bytes()
    (out / "scan.mcap").write_bytes(data[: len(data) // 2])
    assert tjscan("scan", "--resume", out) == 0
    assert_same_results(run, out)


def test_other_settings_of_the_groove_find_about_the_same(run: Path, tmp_path: Path) -> None:
    assert replay(run, tmp_path / "again", "--groove.noise-mm", "0.07") == 0
    assert len(content(tmp_path / "again" / "sections.csv")) == 1 + SECTIONS


def test_views_that_were_not_recorded_end_a_replay_in_words(run: Path, tmp_path: Path) -> None:
    assert replay(run, tmp_path / "again", "--scan.step-mm", "20") == 1
    summary = json.loads((tmp_path / "again" / "summary.json").read_text())
    assert "does not hold this view" in summary["detail"]
    assert summary["sections"] == 2


def test_a_taught_pose_that_was_not_recorded_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay(run, tmp_path / "again", "--scan.first.position-mm", "[0, 900, 300]") == 4
    assert "does not hold this view" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--laser.driver", "replay"], "needs a recording"),
        (["--laser.driver", "replay", "--laser.recording", "none"], "there is no recording"),
    ],
)
def test_a_replay_without_a_recording_is_refused(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("scan", PAPER, "--out", tmp_path / "run", *options) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()


def stood(*x: float) -> tuple[RecordedPoses, ReplayedArm]:
    """An arm that stood at places along x, in metres."""
    states = [ArmState(np.zeros(6), at(place), float(i)) for i, place in enumerate(x)]
    poses = RecordedPoses([state.T_b_f for state in states], x, distance=5e-3, angle=0.03)
    return poses, ReplayedArm(poses, states)


def at(x: float) -> Array:
    return pose_from_euler_zyx(np.array((x, 0.0, 0.0)), np.zeros(3))


def test_a_recording_is_gone_through_forwards_and_exact_poses_come_first() -> None:
    _, arm = stood(0.0, 0.1, 0.102, 0.1, 0.2)
    with arm:
        assert arm.move_joint_to_pose(at(0.0)).time == 0
        assert arm.move_linear(at(0.102)).time == 2  # not the nearly equal one before it
        assert arm.move_linear(at(0.101)).time == 3  # the first ahead within the tolerance
        with pytest.raises(ViewNotRecorded, match="nearest one ahead is 100"):
            arm.move_linear(at(0.1))
        assert arm.state().time == 3


def test_a_view_is_taken_once_and_taken_again_where_it_was() -> None:
    poses, arm = stood(0.0, 0.1, 0.1, 0.2)
    with arm:
        T_b_f = arm.move_joint_to_pose(at(0.1)).T_b_f
        assert [poses.take_profile_number(T_b_f), poses.take_profile_number(T_b_f)] == [1, 2]
        with pytest.raises(LaserFault, match="no further profile"):
            poses.take_profile_number(T_b_f)
