"""Whether a controller does what each method of the client library's control interface says."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from math import isclose
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.pose_vector import pose_to_vector
from tjscan.robot.kinematics import Kinematics
from tjscan_loopback.process import UrLoopbackProcess

HOME: Final = np.radians([-110, -95, 160, 105, -110, 0])
"""Where the loopback controller's arm starts, joint angles in radians."""

HOME_POSE: Final = pose_to_vector(Kinematics.load("ur10e").forward(HOME)).tolist()

GIVES: Final[dict[str, tuple[Any, float]]] = {
    "movePath": ([True, 0.04], 2e-3),
    **{name: ([True, True], 0.0) for name in ("speedJ", "speedL", "servoJ", "servoL", "jogStart")},
    "poseTrans": (HOME_POSE, 1e-4),
    "getForwardKinematics": (HOME_POSE, 1e-4),
    "getInverseKinematics": (HOME.tolist(), 1e-4),
    "getTargetWaypoint": (HOME_POSE, 1e-4),
    "stopContactDetection": (False, 0.0),
    "getTCPOffset": ([0, 0, 0.1, 0, 0, 0], 1e-9),
    "setSpeedSlider": ([True, True], 0.0),
    "outputs": (0b100100, 0.0),
}
"""What a method gives, and by how much that may be off, where it is not True."""


@dataclass(frozen=True, slots=True)
class MethodOutcome:
    """What came of calling one.

    Parameters
    ----------
    name : str
        Of the method; of the controller's own word for it where that is refused.
    right : bool
        Whether it did what it says, or the controller ended its program and named it.
    refused : bool
        Whether the program ended.
    told : str
        What it gave.
    """

    name: str
    right: bool
    refused: bool
    told: str


def call_every_method(host: str) -> list[MethodOutcome]:
    """Call every method of a loopback controller that is started on an address."""
    program = Path(__file__).with_name("_ur_api.py")
    with UrLoopbackProcess(host, "--fast") as loopback:
        done = subprocess.run(
            [sys.executable, str(program), host], capture_output=True, text=True, check=True
        )
        told = "\n".join(loopback.unread_output())
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    return [
        MethodOutcome(
            name,
            _is_near(value, *GIVES.get(name, (True, 0.0)))
            if goes_on
            else f"this controller has no {name}" in told,
            not goes_on,
            f"{name} gave {value}",
        )
        for name, value, goes_on in rows
    ]


def _is_near(value: Any, wanted: Any, off: float) -> bool:
    if isinstance(wanted, list):
        return (
            isinstance(value, list)
            and len(value) == len(wanted)
            and all(_is_near(one, other, off) for one, other in zip(value, wanted, strict=True))
        )
    if isinstance(wanted, bool) or not isinstance(value, int | float):
        return value is wanted
    return isclose(value, wanted, rel_tol=0, abs_tol=off)
