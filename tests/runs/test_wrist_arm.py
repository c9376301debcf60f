"""An arm with a spherical wrist does what a Universal Robots arm does, by its name alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cells import EXAMPLES, Notes, example_corner_errors
from command import tjscan

from tjscan.calibration.file import read_calibration
from tjscan.job.files import read_scan_job
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.scanning.journal import StopReason

JOB = EXAMPLES / "kr5_arc.toml"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first sections of the example's joint."""
    directory = tmp_path_factory.mktemp("runs") / "run"
    assert tjscan("scan", JOB, "--out", directory, "--scan.sections", 5) == 0
    return directory


def test_a_whole_scan_is_as_good_as_with_the_examples_own_arm() -> None:
    job, notes = read_scan_job(JOB), Notes()
    with ScanContext(job, JOB).make_cell() as cell:
        result = scan_in_cell(cell, job, notes)
    assert result.stop is StopReason.LENGTH
    assert 1e3 * example_corner_errors(result, JOB).mean() < 0.15
    arm = Kinematics.load("kr5_arc")
    q = np.array([view.q for view in notes.views])
    assert ((q >= arm.lower) & (q <= arm.upper)).all()


def test_a_replay_finds_the_same(run: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    drivers = ("--arm.driver", "replay", "--laser.driver", "replay", "--laser.recording", run)
    assert tjscan("scan", run / "job.toml", *drivers, "--out", again) == 0
    found = [(one / "groove.ply").read_bytes().split(b"end_header")[1] for one in (run, again)]
    assert found[0] == found[1]


def test_its_own_geometry_is_calibrated(tmp_path: Path) -> None:
    keys = {
        "ball.poses": 20,
        "ball.held_out": 6,
        "board.touches": 4,
        "board.lines": 5,
        "board.noise.position_mm": 0.15,
        "board.noise.rotation_deg": 0.03,
        "board.noise.touch_mm": 0.15,
        "simulation.arm.errors.seed": 5,
        # Board and ball further away and higher than before the smaller arm of the example.
        "board.position_mm": [900, 175, 200],
        "simulation.board.position_mm": [903, 171, 202.5],
        "ball.position_mm": [800, -300, 400],
        "simulation.ball.position_mm": [804, -297, 402],
        "simulation.arm.home_deg": [0, -90, 90, 0, 90, 0],
    }
    words = [f"--{key.replace('_', '-')}={json.dumps(value)}" for key, value in keys.items()]
    job, out = EXAMPLES / "calibrate.toml", tmp_path / "run"
    arm = ("--arm.model", "kr5_arc", "--arm", "--unattended")
    assert tjscan("calibrate", job, *arm, *words, "--out", out) == 0
    found = read_calibration(out / "calibration.toml").kinematics
    assert found is not None
    assert 2 * found.held_out_after_mm < found.held_out_before_mm
