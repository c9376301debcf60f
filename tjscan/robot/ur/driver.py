"""A Universal Robots arm as a driver that a job can name."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from tjscan.robot.drivers import ARMS, ArmDriverFactory, ArmDriverInputs
from tjscan.robot.ur.settings import UrSettings

if TYPE_CHECKING:
    from tjscan.robot.ur.arm import UrArm

CLIENT: Final = "rtde_control"
"""Module of the package ur-rtde."""


def _make(context: ArmDriverInputs, settings: UrSettings) -> UrArm:
    from tjscan.robot.ur.arm import UrArm

    # The client library is loaded in a process of its own alone, so look whether it is there.
    if find_spec(CLIENT) is None:
        raise ARMS.missing_package_error("ur", CLIENT)
    return UrArm(context.kinematics, settings, context.limits)


DRIVER: Final = ArmDriverFactory(_make, UrSettings)
