"""Loopback controllers of ABB, FANUC and KUKA for tests, each with addresses of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from ur_cell import address

from tjscan.core.frames import Array, pose, rotation_angle_between
from tjscan.robot.abb.settings import AbbSettings
from tjscan.robot.cyclic.arm import CyclicArm
from tjscan.robot.cyclic.settings import CyclicSettings
from tjscan.robot.fanuc.settings import FanucSettings
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.kuka.settings import KukaSettings
from tjscan.robot.path import MotionLimits
from tjscan_loopback.process import ArmLoopbackProcess

ARRIVAL = 1e-5
"""Metres between a goal and the arm: float32 of a FANUC's packets is less."""

ROUNDING = 1e-4
"""Share of a joint's speed that the digits of a packet are."""


@dataclass(frozen=True)
class Maker:
    """An arm's maker: its driver, the model of one arm, and where a loopback has it at first."""

    name: str
    model: str
    home_deg: tuple[float, ...]
    settings: type[CyclicSettings]
    stamp: str

    @cached_property
    def kinematics(self) -> Kinematics:
        """Of the model."""
        return Kinematics.load(self.model)

    @property
    def home(self) -> Array:
        """Where a loopback controller starts, radians."""
        return np.radians(self.home_deg)

    def beside_home(self, x: float = 0.0, z: float = 0.0) -> Array:
        """Flange pose some metres beside where the controller starts."""
        return pose(p=(x, 0.0, z)) @ self.kinematics.forward(self.home)

    @property
    def port(self) -> int:
        """The UDP port on which its driver listens."""
        return self.settings("127.0.0.1").port


ABB = Maker("abb", "irb1600_10_145", (37, 30, -30, 112, -100, 104), AbbSettings, "seqno")
FANUC = Maker("fanuc", "m10ia", (93, 22, -9, -119, 90, 65), FanucSettings, "number")
KUKA = Maker("kuka", "kr5_arc", (-90, -60, 65, 60, 95, 75), KukaSettings, "IPOC")


class MakerCell(ArmLoopbackProcess):
    """A loopback controller with an address of its own, and drivers for it.

    Parameters
    ----------
    maker : Maker
        Whose.
    *options : str
        Of its command; with none a cycle ends with its answer.
    """

    limits: ClassVar[MotionLimits] = MotionLimits()

    def __init__(self, maker: Maker, *options: str) -> None:
        self.maker, self.bind = maker, address()
        sends = () if maker is FANUC else ("--computer", f"{self.bind}:{maker.port}")
        command = f"{maker.name}-loopback"
        super().__init__(command, address(), *sends, *(options or ("--fast",)))

    def settings(self, *, silence: float = 30.0, **changes: Any) -> CyclicSettings:
        """Settings of a driver; a busy machine may be silent for long."""
        return self.maker.settings(self.host, silence_limit=silence, bind=self.bind, **changes)

    def arm(
        self, *, silence: float = 30.0, limits: MotionLimits = limits, **changes: Any
    ) -> CyclicArm:
        """The driver, not yet connected."""
        settings = self.settings(silence=silence, **changes)
        return CyclicArm(self.maker.kinematics, settings, limits)

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


def assert_is_at(cell: MakerCell, T_b_f: Array) -> None:
    there = cell.maker.kinematics.forward(cell.true_q())
    np.testing.assert_allclose(there[:3, 3], T_b_f[:3, 3], rtol=0, atol=ARRIVAL)
    assert rotation_angle_between(there, T_b_f) < np.radians(1e-3)


def assert_was_never_too_fast(cell: MakerCell) -> None:
    truth = cell.ask_for_truth()
    assert truth["fastest"] <= cell.limits.joint_speed * (1 + ROUNDING)
    assert truth["misread"] == 0
