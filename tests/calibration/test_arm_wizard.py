"""``tjscan calibrate --arm`` on a simulated cell whose arm is not as its model has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cells import EXAMPLES
from command import tjscan

from tjscan.calibration.file import read_calibration
from tjscan.calibration.wizard.operator import DefaultAnswerOperator, Question
from tjscan.job.files import read_calibration_job, read_scan_job
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.calibration.run import resume_calibration, start_calibration
from tjscan.runs.scan.run import ScanContext

JOB = EXAMPLES / "calibrate.toml"
KEYS = {
    "board.touches": 4,
    "board.lines": 5,
    # An arm that is off by some tenths makes lines that are off by as much.
    "board.noise.position_mm": 0.15,
    "board.noise.rotation_deg": 0.03,
    "board.noise.touch_mm": 0.15,
    "ball.poses": 20,
    "ball.held_out": 6,
    "simulation.arm.errors.seed": 5,
}


class Leaving(DefaultAnswerOperator):
    """An operator who leaves at the n-th question, and keeps what was reported."""

    present = True

    def __init__(self, at: int) -> None:
        self._left = at
        self.told: list[str] = []

    def confirm(self, question: Question) -> bool:
        self._left -= 1
        if self._left == 0:
            raise KeyboardInterrupt
        return question.default

    def report(self, message: str) -> None:
        self.told.append(message)


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A run that was interrupted among the postures, and gone on with."""
    out = tmp_path_factory.mktemp("arm") / "run"
    with pytest.raises(KeyboardInterrupt):
        start_calibration(read_calibration_job(JOB, KEYS), JOB, out, Leaving(30), arm=True)
    watcher = Leaving(-1)
    resume_calibration(out, watcher)
    return out, watcher.told


def test_it_finds_the_arm_and_says_what_it_can_not_tell(
    calibrated: tuple[Path, list[str]],
) -> None:
    out, told = calibrated
    found = read_calibration(out / "calibration.toml").kinematics
    assert found is not None
    assert found.held_out_poses == 6
    assert 2 * found.held_out_after_mm < found.held_out_before_mm
    assert any("6 postures that took no part" in line for line in told)
    assert any(line.startswith("joint 1: length x") for line in told)
    assert list(found.left_as_stated) == [line for line in told if line.startswith("joint")]


def test_a_scan_that_takes_it_reports_poses_by_what_was_found(
    calibrated: tuple[Path, list[str]],
) -> None:
    file = calibrated[0] / "calibration.toml"
    paper = EXAMPLES / "paper.toml"
    found = read_calibration(file).kinematics
    assert found is not None
    arm = deviate_joint_frames(Kinematics.load("ur10e"), found.deviations_si)
    job = read_scan_job(paper, {"calibration.file": str(file)})
    with ScanContext(job, paper).make_cell() as cell:
        state = cell.arm.state()
        np.testing.assert_allclose(state.T_b_f, arm.forward(state.q), rtol=0, atol=1e-12)
        up = np.array(state.T_b_f)
        up[2, 3] += 0.05
        np.testing.assert_allclose(cell.arm.move_linear(up).T_b_f, up, rtol=0, atol=1e-6)


def test_another_model_of_arm_is_refused(
    calibrated: tuple[Path, list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--calibration.file", calibrated[0] / "calibration.toml"]
    other = ["--arm.model", "ur20", "--arm.id", "ur10e"]
    paper = EXAMPLES / "paper.toml"
    assert tjscan("scan", paper, *options, *other, "--out", tmp_path / "run") == 2
    assert "kinematics of a 'ur10e'" in " ".join(capsys.readouterr().err.split())


def test_without_a_ball_it_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = JOB.read_text(encoding="utf-8")
    job = tmp_path / "job.toml"
    start, end = text.index("# About where a ball is"), text.index("[simulation]")
    job.write_text((text[:start] + text[end:]).split("[simulation.ball]")[0], encoding="utf-8")
    assert tjscan("calibrate", job, "--arm", "--unattended", "--out", tmp_path / "run") == 2
    assert "needs a table [ball]" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()
