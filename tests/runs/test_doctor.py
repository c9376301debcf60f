"""The doctor names what is wrong, and moves nothing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cells import CLOCKWISE, EXAMPLES, PAPER
from command import tjscan

from tjscan.runs.doctor import check_job_and_cell


@pytest.mark.parametrize("file", [PAPER, CLOCKWISE, EXAMPLES / "ur10e.toml"])
def test_a_sound_cell_has_a_line_for_everything(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("doctor", file) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(line.startswith("ok ") for line in lines)
    looked_at = [line.split(":")[0].removeprefix("ok").strip() for line in lines]
    assert looked_at == [
        "versions",
        "job",
        "joint",
        "calibration",
        "clearance",
        "arm",
        "laser",
        "model",
        "stance",
        "profile",
        "first pose",
        "second pose",
        "groove",
    ]


@pytest.mark.parametrize(
    ("options", "what", "hint", "code"),
    [
        (("--scan.step_mm", "1"), "job", "greater than or equal to 5", 2),
        (("--joint.file", "nowhere.toml"), "joint", "no such file", 2),
        (("--calibration.file", "nowhere.toml"), "calibration", "no such file", 2),
        (("--arm.model", "ur10"), "clearance", "did you mean: ur10e?", 2),
        (("--clearance.ignore", '[["forarm_link", "tool"]]'), "clearance", "forearm_link", 2),
        (("--simulation.arm.home_deg", "[0, 0]"), "cell", "6 joints", 2),
        (("--scan.first.position_mm", "[5000, 0, 0]"), "first pose", "out of reach", 4),
        (("--scan.second.position_mm", "[522, 903, 300]"), "second pose", "run into", 4),
        (("--clearance.margin_mm", "100"), "second pose", "where 100 mm are asked for", 4),
    ],
)
def test_what_is_wrong_is_named_with_its_remedy(
    options: tuple[str, str],
    what: str,
    hint: str,
    code: int,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert tjscan("doctor", PAPER, "--json", *options) == code
    findings = {row["what"]: row for row in json.loads(capsys.readouterr().out)}
    assert not findings[what]["sound"]
    assert hint in findings[what]["detail"]


def test_every_finding_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert tjscan("doctor", PAPER, "--scan.first.position_mm", "[5000, 0, 0]") == 4
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if not line.startswith("ok")] == ["WRONG"] * 2


def test_an_arm_that_stands_at_a_start_pose_sees_its_groove() -> None:
    # Close to the first pose: the doctor tells what the laser sees from where the arm stands.
    from taught import standing

    from tjscan.job.files import read_scan_job

    T = read_scan_job(PAPER).start_poses[0].T
    home = [float(word) for word in standing(T).strip("[]").split(",")]
    findings = {f.what: f for f in check_job_and_cell(PAPER, {"simulation.arm.home_deg": home})}
    assert "and a groove" in findings["profile"].detail


def test_a_laser_that_has_to_stream_is_asked_whether_it_can(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert tjscan("doctor", PAPER, "--scan.mode", "continuous") == 0
    assert "laser's stream" in capsys.readouterr().out
