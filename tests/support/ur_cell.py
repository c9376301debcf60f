"""Loopback controllers for tests, each on an address of its own."""

import os
import socket
from itertools import count
from pathlib import Path

import numpy as np

from tjscan.core.frames import Array, pose
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.settings import UrSettings

HOME = np.radians([-110, -95, 160, 105, -110, 0])
"""Where the loopback controller starts."""

KINEMATICS = Kinematics.load("ur10e")

_numbers = count(1)


def address() -> str:
    """An address that no other test uses: 127.A.B.C of process and counter."""
    process = os.getpid() % 65536
    return f"127.{64 + process // 256 % 128}.{process % 256}.{next(_numbers) % 250 + 1}"


SLOWLY = MotionLimits(tcp_speed=0.03)
"""Three decimetres take ten seconds: what is to happen on the way does, on a busy machine too."""


def arm_at(host: str, model: Kinematics = KINEMATICS, *, silence: float = 1.0) -> UrArm:
    """The driver for a controller, which may be silent for some seconds."""
    return UrArm(model, UrSettings(host, silence_limit=silence))


def slow_arm_at(host: str) -> UrArm:
    """The driver for a controller, for moves in which something is to happen."""
    return UrArm(KINEMATICS, UrSettings(host), SLOWLY)


def beside_home(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """Flange pose some metres beside where the controller starts."""
    return pose(p=(x, y, z)) @ KINEMATICS.forward(HOME)


def client_processes() -> list[int]:
    """Processes of the client library that this process has left."""
    found = []
    for thread in Path("/proc/self/task").iterdir():
        for pid in (thread / "children").read_text(encoding="ascii").split():
            words = Path(f"/proc/{pid}/cmdline")
            if words.exists() and b"tjscan.robot.ur.client" in words.read_bytes():
                found.append(int(pid))
    return found


def output_is_on(host: str, number: int) -> bool:
    """Whether a standard digital output is on, as another client sees it."""
    from rtde_receive import RTDEReceiveInterface

    link = RTDEReceiveInterface(host, 50.0, ["actual_digital_output_bits"])
    try:
        return bool(link.getDigitalOutState(number))
    finally:
        link.disconnect()


def tell_dashboard(host: str, line: str) -> None:
    """Send a line to the dashboard server, as an operator at the panel does."""
    with socket.create_connection((host, 29999), 5) as link, link.makefile("rw") as words:
        words.readline()
        words.write(f"{line}\n")
        words.flush()
        words.readline()
