"""A Universal Robots arm as a driver that a job can name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from tjscan.robot.drivers import ArmDriverFactory, ArmDriverInputs
from tjscan.robot.ur.settings import UrSettings

if TYPE_CHECKING:
    from tjscan.robot.ur.arm import UrArm


def _make(inputs: ArmDriverInputs, settings: UrSettings) -> UrArm:
    from tjscan.robot.ur.arm import UrArm

    return UrArm(inputs.kinematics, settings, inputs.limits)


UR_DRIVER: Final = ArmDriverFactory(_make, UrSettings)
