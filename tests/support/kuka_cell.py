"""Loopback KUKA controllers for tests, each with addresses of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from ur_cell import address

from tjscan.core.frames import Array, pose
from tjscan.robot.cyclic.arm import CyclicArm as KukaArm
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.kuka.settings import KukaSettings
from tjscan.robot.path import MotionLimits
from tjscan_loopback.process import KukaLoopbackProcess

KINEMATICS = Kinematics.load("kr5_arc")

HOME = np.radians([-90, -60, 65, 60, 95, 75])
"""Where the loopback controller starts."""

LIMITS = MotionLimits()


def beside_home(x: float = 0.0, y: float = 0.0) -> Array:
    """Flange pose some metres beside where the controller starts."""
    return pose(p=(x, y, 0.0)) @ KINEMATICS.forward(HOME)


class KukaCell(KukaLoopbackProcess):
    """A loopback controller that sends to an address of its own, and drivers that listen there.

    Parameters
    ----------
    *options : str
        Of ``tjscan kuka-loopback``; with none a cycle ends with its answer.
    """

    def __init__(self, *options: str) -> None:
        self.bind = address()
        super().__init__(address(), f"{self.bind}:59152", *(options or ("--fast",)))

    def settings(self, *, silence: float = 30.0, cycle: float = 4e-3) -> KukaSettings:
        """Settings of a driver; a busy machine may be silent for long."""
        return KukaSettings(self.host, silence_limit=silence, bind=self.bind, cycle=cycle)

    def arm(self, *, limits: MotionLimits = LIMITS, silence: float = 30.0) -> KukaArm:
        """The driver, not yet connected."""
        return KukaArm(KINEMATICS, self.settings(silence=silence), limits)

    def true_q(self) -> Array:
        """Joint angles of the simulated arm, radians."""
        return np.asarray(np.radians(self.ask_for_truth()["q_deg"]))


def stream_processes() -> list[int]:
    """Processes that answer controllers for this process."""
    found = []
    for thread in Path("/proc/self/task").iterdir():
        for pid in (thread / "children").read_text(encoding="ascii").split():
            words = Path(f"/proc/{pid}/cmdline")
            if words.exists() and b"tjscan.robot.cyclic.client" in words.read_bytes():
                found.append(int(pid))
    return found
