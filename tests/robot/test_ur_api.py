"""The client library's whole control interface against the loopback controller."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ur_cell import HOME, KINEMATICS, address

from tjscan.core import pose_vector
from tjscan.robot.loopback.process import LoopbackProcess

pytest.importorskip("rtde_control")

HOME_POSE = pose_vector.pose_to_vector(KINEMATICS.forward(HOME))

EXPECTED: dict[str, Any] = {
    "movePath": [True, pytest.approx(0.04, abs=2e-3)],
    **{name: [True, True] for name in ("speedJ", "speedL", "servoJ", "servoL", "jogStart")},
    "poseTrans": pytest.approx(HOME_POSE, abs=1e-4),
    "getForwardKinematics": pytest.approx(HOME_POSE, abs=1e-4),
    "getInverseKinematics": pytest.approx(HOME, abs=1e-4),
    "getTargetWaypoint": pytest.approx(HOME_POSE, abs=1e-4),
    "stopContactDetection": False,
    "getTCPOffset": pytest.approx([0, 0, 0.1, 0, 0, 0], abs=1e-9),
    "setSpeedSlider": [True, True],
    "outputs": 0b100100,
}
"""What a method gives, where that is not True."""


def test_every_method_does_what_it_says_or_ends_the_program_by_name() -> None:
    program = Path(__file__).parents[1] / "support" / "ur_api.py"
    with LoopbackProcess(address(), "--fast") as loopback:
        done = subprocess.run(
            [sys.executable, str(program), loopback.host],
            capture_output=True,
            text=True,
            check=True,
        )
        told = "\n".join(loopback.unread_output())
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    assert len(rows) > 50
    for name, value, goes_on in rows:
        if goes_on:
            assert value == EXPECTED.get(name, True), name
        else:
            assert f"this controller has no {name}" in told, name
    assert np.count_nonzero([not goes_on for *_, goes_on in rows]) == 14
