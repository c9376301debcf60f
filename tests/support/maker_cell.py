"""Loopback controllers of ABB and FANUC for tests, each with addresses of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from ur_cell import address

from tjscan.core.frames import Array, pose
from tjscan.robot.abb.settings import AbbSettings
from tjscan.robot.cyclic.arm import CyclicArm
from tjscan.robot.cyclic.settings import CyclicSettings
from tjscan.robot.fanuc.arm import FanucArm
from tjscan.robot.fanuc.settings import FanucSettings
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan_loopback.process import CyclicLoopbackProcess


@dataclass(frozen=True)
class Maker:
    """An arm's maker: its driver, the model of one arm, and where the loopback has it at first."""

    name: str
    model: str
    home_deg: tuple[float, ...]
    arm: type[CyclicArm]
    settings: type[CyclicSettings]
    stamp: str

    @property
    def kinematics(self) -> Kinematics:
        """Of the model."""
        return Kinematics.load(self.model)

    @property
    def home(self) -> Array:
        """Where the loopback controller starts, radians."""
        return np.radians(self.home_deg)

    def beside_home(self, x: float = 0.0, z: float = 0.0) -> Array:
        """Flange pose some metres beside where the controller starts."""
        return pose(p=(x, 0.0, z)) @ self.kinematics.forward(self.home)


ABB = Maker("abb", "irb1600_10_145", (0, 0, 0, 0, 60, 0), CyclicArm, AbbSettings, "seqno")
FANUC = Maker("fanuc", "m10ia", (0, 20, 0, 0, -60, 0), FanucArm, FanucSettings, "number")


class MakerCell(CyclicLoopbackProcess):
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
        sends = ("--computer", f"{self.bind}:6510") if maker is ABB else ()
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
        return self.maker.arm(self.maker.kinematics, settings, limits)

    def true_q(self) -> Array:
        """Joint angles of the simulated arm, radians."""
        return np.asarray(np.radians(self.ask_for_truth()["q_deg"]))
