"""Doctor and teaching with a real arm's driver, through the real client library and TCP."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cells import PAPER
from command import tjscan
from taught import HALF_DIGIT, example, standing
from ur_cell import address, client_processes

from tjscan.job.files import read_scan_job
from tjscan_loopback.process import UrLoopbackProcess

pytest.importorskip("rtde_control")


@pytest.fixture(scope="module")
def loopback() -> Iterator[UrLoopbackProcess]:
    """A controller whose arm was led to about the first start pose."""
    angles = standing(read_scan_job(PAPER).start_poses[0].T).strip("[]").split(", ")
    with UrLoopbackProcess(address(), "--fast", "--home-deg", *angles) as process:
        yield process
    assert client_processes() == []


def ur(loopback: UrLoopbackProcess) -> tuple[str, ...]:
    return ("--arm.driver", "ur", "--arm.ur.host", loopback.host)


def test_a_pose_is_taught_from_where_the_arm_stands_and_nothing_moves(
    loopback: UrLoopbackProcess, tmp_path: Path
) -> None:
    job = example(tmp_path)
    loopback.unread_output()
    assert tjscan("teach", job, "--which", "second", *ur(loopback)) == 0
    assert not any(line.startswith("move") for line in loopback.unread_output())
    first, second = (start.T for start in read_scan_job(job).start_poses)
    off = second[:3, 3] - first[:3, 3]
    assert np.abs(off).max() < 2 * HALF_DIGIT[0]


def test_the_doctor_tells_which_arm_it_is_and_what_is_wrong_with_it(
    loopback: UrLoopbackProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    loopback.unread_output()
    assert tjscan("doctor", PAPER, "--json", *ur(loopback)) == 0
    findings = {row["what"]: row for row in json.loads(capsys.readouterr().out)}
    assert "URSoftware" in findings["model"]["detail"]
    assert "and a groove" in findings["profile"]["detail"]
    assert not any(line.startswith("move") for line in loopback.unread_output())
    for fault, hint in (("local-mode", "remote"), ("power-off", "power"), ("protective-stop", "")):
        loopback.schedule_fault(fault)
        assert tjscan("doctor", PAPER, "--json", *ur(loopback)) == 4
        rows = json.loads(capsys.readouterr().out)
        assert [row["what"] for row in rows if not row["sound"]] == ["arm"]
        assert hint in next(row["detail"].lower() for row in rows if row["what"] == "arm")
        loopback.schedule_fault("clear")
