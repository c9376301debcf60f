"""Values that the main process and the client's process exchange."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

SixNumbers = tuple[float, float, float, float, float, float]
"""Joint angles, or a position and a rotation vector."""


class RobotMode(IntEnum):
    """Power, as RTDE numbers it. A mode that is not here is none to move in."""

    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    RUNNING = 7


class SafetyMode(IntEnum):
    """State of the safety system, as RTDE numbers it."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9


HOST_GONE: Final = "the move was not supervised"
"""The client's answer to every request after it had to stop an unsupervised move."""

WATCHDOG_PERIOD: Final = 1.0
"""Seconds: a controller that hears nothing for so long stops the arm and ends the program."""

PROGRAM_PLAYING = 2
"""Runtime state of a program that runs."""


@dataclass(frozen=True, slots=True)
class ControllerState:
    """State of the controller at one moment: joints, TCP, modes and operation.

    Parameters
    ----------
    connected : bool
        Whether both RTDE links are up.
    time : float
        Seconds on the controller's clock.
    q, speed : tuple of float
        Joint angles in radians and joint speeds in rad/s.
    tcp : tuple of float
        Pose of the active TCP in frame b: metres and a rotation vector.
    robot_mode, safety_mode, runtime_state : int
        As RTDE numbers them.
    operation : int
        Number of the latest asynchronous move.
    moving : bool
        Whether that move is under way.
    unheard : float
        Longest time lately for which this computer sent the controller no sign of life, seconds.
    unseen : float
        Longest time lately for which nothing new came from the controller, seconds.
    payload, centre_of_gravity : float, tuple of float
        The active payload in kilograms and metres; None if the controller does not report it.
    """

    connected: bool
    time: float
    q: SixNumbers
    speed: SixNumbers
    tcp: SixNumbers
    robot_mode: int
    safety_mode: int
    runtime_state: int
    operation: int
    moving: bool
    unheard: float
    unseen: float
    payload: float | None
    centre_of_gravity: tuple[float, ...] | None
