"""What the client's process reports of a controller, and the faults that it shows."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from tjscan.core import errors

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


NOT_SUPERVISED: Final = "the move was not supervised"
"""The client's answer to every request after it had to stop an unsupervised move."""

WATCHDOG_PERIOD: Final = 1.0
"""Seconds: a controller that hears nothing for so long stops the arm and ends the program."""

PROGRAM_PLAYING = 2
"""Runtime state of a program that runs."""

PROGRAM_WAITING: Final = (4, 5)
"""Runtime states of one that is paused, as by a popup that waits for a person, or resumes."""


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
    outputs : int
        Digital outputs, a bit each.
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
    outputs: int
    operation: int
    moving: bool
    unheard: float
    unseen: float
    payload: float | None
    centre_of_gravity: tuple[float, ...] | None


LONG_SILENCE_SECONDS: Final = 0.7 * WATCHDOG_PERIOD
"""Seconds of silence that may be why a program ended; the rest was lost on the way there."""

_REMOTE_MESSAGE: Final = (
    "the arm is in local control. Choose remote control at the upper right of its pendant, "
    "then start again."
)


def fault_of_safety_mode(mode: str) -> errors.ArmFault | None:
    """Fault that a safety mode means, None if it means none; by the dashboard's name."""
    if "EMERGENCY" in mode:
        return errors.EmergencyStop(
            "an emergency stop is pressed. Release it, switch the arm on, then start again."
        )
    if mode == "PROTECTIVE_STOP":
        return errors.ProtectiveStop(
            "the arm made a protective stop. Find out what stopped it and clear the way, wait five "
            "seconds, unlock it on its pendant, then start again."
        )
    if "SAFEGUARD" in mode:
        return errors.ProtectiveStop(
            "a safeguard input stops the arm. Close the guard, then start again."
        )
    if mode in ("VIOLATION", "FAULT", "RECOVERY"):
        return errors.ProtectiveStop(
            f"the arm's safety system is in {mode.lower()}. Follow its pendant, then start again."
        )
    return None


def fault_of_robot_mode(mode: str) -> errors.ArmFault | None:
    """Fault that a robot mode means, None if it means none; by the dashboard's name."""
    if mode == RobotMode.RUNNING.name:
        return None
    return errors.ArmNotPowered(
        f"the arm is not ready to move (its mode is {mode}). Switch it on and release its brakes "
        "on the pendant, then start again."
    )


def fault_of_local_control(answer: str) -> errors.ArmFault | None:
    """Fault if the dashboard reports that the arm is not in remote control."""
    return errors.ArmNotInRemoteMode(_REMOTE_MESSAGE) if answer.lower() == "false" else None


def fault_of_ended_program(now: ControllerState) -> errors.ArmFault:
    """Fault of a program that does not run any more, by which side fell silent before, if one did.

    A computer that was held up saw nothing either: that nothing was sent is reported first.
    """
    if now.unheard >= LONG_SILENCE_SECONDS:
        return errors.MoveSupervisionLost(
            f"this computer was held up, and sent the arm's controller nothing for "
            f"{now.unheard:.1f} s: most likely that is why the controller stopped the arm and "
            f"ended its program, as it does when it hears nothing for {WATCHDOG_PERIOD:g} s. See "
            "that the way is clear and that nothing else keeps this computer busy, then start "
            "again."
        )
    if now.unseen >= LONG_SILENCE_SECONDS:
        return errors.ArmConnectionLost(
            f"nothing came from the arm's controller for {now.unseen:.1f} s, and its program has "
            "ended: most likely the network between the two was interrupted, or the controller "
            "hung. See that the arm is at rest and its network cable sits, then start again."
        )
    return errors.ProgramStopped(
        "the program on the arm's controller was stopped or paused, and neither by this program "
        "nor by a silence between the two: by a person at its pendant or over the network, or by "
        "the controller itself, whose log then states why. Make sure that no one works at the arm, "
        "then start again."
    )


def fault_from_state(now: ControllerState) -> errors.ArmFault | None:
    """Fault that a snapshot of the controller's state shows, the cause before its consequences."""
    if not now.connected:
        return errors.ArmConnectionLost(
            "the connection to the arm's controller broke. See that the arm is at rest and its "
            "network cable sits, then start again."
        )
    return (
        fault_of_safety_mode(_mode_name(SafetyMode, now.safety_mode))
        or fault_of_robot_mode(_mode_name(RobotMode, now.robot_mode))
        or (None if now.runtime_state == PROGRAM_PLAYING else fault_of_ended_program(now))
    )


def connection_fault(host: str, words: str) -> errors.ArmFault:
    """Fault that kept the client library from connecting, from the library's own words."""
    if "already in use" in words:
        return errors.RegistersInUse(
            "another client writes the RTDE inputs of the arm's controller. Switch off "
            "EtherNet/IP, PROFINET and MODBUS on its pendant and end other programs that use it, "
            "then start again."
        )
    if "remote control" in words:
        return errors.ArmNotInRemoteMode(_REMOTE_MESSAGE)
    return errors.ArmNotConnected(
        f"the controller at {host} does not take this program's commands ({words}). See that its "
        "network services RTDE, dashboard and the interfaces 30001 to 30004 are enabled."
    )


def _mode_name(modes: type[RobotMode] | type[SafetyMode], number: int) -> str:
    return modes(number).name if number in list(modes) else str(number)
