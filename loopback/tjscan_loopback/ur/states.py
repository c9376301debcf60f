"""States of the controller, as RTDE numbers them."""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class RobotPower(IntEnum):
    """Power of the robot, as RTDE numbers it."""

    POWER_OFF = 3
    IDLE = 5
    RUNNING = 7


class SafetyState(IntEnum):
    """State of the safety system, as RTDE numbers it."""

    NORMAL = 1
    PROTECTIVE_STOP = 3
    ROBOT_EMERGENCY_STOP = 7


class ProgramState(IntEnum):
    """State of the program, as RTDE numbers it."""

    STOPPED = 1
    PLAYING = 2
    PAUSED = 4


SAFETY_BITS: Final = {
    SafetyState.NORMAL: 1 << 0,
    SafetyState.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyState.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
}
