"""From the state of a controller to the error that states what happened and what to do."""

from __future__ import annotations

from typing import Final

from tjscan.core.errors import (
    ArmConnectionLost,
    ArmFault,
    ArmNotConnected,
    ArmNotInRemoteMode,
    ArmNotPowered,
    EmergencyStop,
    MoveSupervisionLost,
    ProgramStopped,
    ProtectiveStop,
    RegistersInUse,
)
from tjscan.robot.ur.messages import (
    PROGRAM_PLAYING,
    WATCHDOG_PERIOD,
    ControllerState,
    RobotMode,
    SafetyMode,
)

LONG_SILENCE_SECONDS: Final = 0.7 * WATCHDOG_PERIOD
"""Seconds of silence that may be why a program ended; the rest was lost on the way there."""

_REMOTE_MESSAGE: Final = (
    "the arm is in local control. Choose remote control at the upper right of its pendant, "
    "then start again."
)


def safety_fault(mode: str) -> ArmFault | None:
    """Fault that a safety mode means, None if it means none; by the dashboard's name."""
    if "EMERGENCY" in mode:
        return EmergencyStop(
            "an emergency stop is pressed. Release it, switch the arm on, then start again."
        )
    if mode == "PROTECTIVE_STOP":
        return ProtectiveStop(
            "the arm made a protective stop. Find out what stopped it and clear the way, wait five "
            "seconds, unlock it on its pendant, then start again."
        )
    if "SAFEGUARD" in mode:
        return ProtectiveStop("a safeguard input stops the arm. Close the guard, then start again.")
    if mode in ("VIOLATION", "FAULT", "RECOVERY"):
        return ProtectiveStop(
            f"the arm's safety system is in {mode.lower()}. Follow its pendant, then start again."
        )
    return None


def power_fault(mode: str) -> ArmFault | None:
    """Fault that a robot mode means, None if it means none; by the dashboard's name."""
    if mode == RobotMode.RUNNING.name:
        return None
    return ArmNotPowered(
        f"the arm is not ready to move (its mode is {mode}). Switch it on and release its brakes "
        "on the pendant, then start again."
    )


def remote_fault(answer: str) -> ArmFault | None:
    """Fault if the dashboard reports that the arm is not in remote control."""
    return ArmNotInRemoteMode(_REMOTE_MESSAGE) if answer.lower() == "false" else None


def program_fault(now: ControllerState) -> ArmFault:
    """Fault of a program that does not run any more, by which side fell silent before, if one did.

    A computer that was held up saw nothing either: that nothing was sent is reported first.
    """
    if now.unheard >= LONG_SILENCE_SECONDS:
        return MoveSupervisionLost(
            f"this computer was held up, and sent the arm's controller nothing for "
            f"{now.unheard:.1f} s: most likely that is why the controller stopped the arm and "
            f"ended its program, as it does when it hears nothing for {WATCHDOG_PERIOD:g} s. See "
            "that the way is clear and that nothing else keeps this computer busy, then start "
            "again."
        )
    if now.unseen >= LONG_SILENCE_SECONDS:
        return ArmConnectionLost(
            f"nothing came from the arm's controller for {now.unseen:.1f} s, and its program has "
            "ended: most likely the network between the two was interrupted, or the controller "
            "hung. See that the arm is at rest and its network cable sits, then start again."
        )
    return ProgramStopped(
        "the program on the arm's controller was stopped or paused, and neither by this program "
        "nor by a silence between the two: by a person at its pendant or over the network, or by "
        "the controller itself, whose log then states why. Make sure that no one works at the arm, "
        "then start again."
    )


def fault_from_state(now: ControllerState) -> ArmFault | None:
    """Fault that a snapshot of the controller's state shows, the cause before its consequences."""
    if not now.connected:
        return ArmConnectionLost(
            "the connection to the arm's controller broke. See that the arm is at rest and its "
            "network cable sits, then start again."
        )
    return (
        safety_fault(_mode_name(SafetyMode, now.safety_mode))
        or power_fault(_mode_name(RobotMode, now.robot_mode))
        or (None if now.runtime_state == PROGRAM_PLAYING else program_fault(now))
    )


def connection_start_fault(host: str, words: str) -> ArmFault:
    """Fault that kept the client library from connecting, from the library's own words."""
    if "already in use" in words:
        return RegistersInUse(
            "another client writes the RTDE inputs of the arm's controller. Switch off "
            "EtherNet/IP, PROFINET and MODBUS on its pendant and end other programs that use it, "
            "then start again."
        )
    if "remote control" in words:
        return ArmNotInRemoteMode(_REMOTE_MESSAGE)
    return ArmNotConnected(
        f"the controller at {host} does not take this program's commands ({words}). See that its "
        "network services RTDE, dashboard and the interfaces 30001 to 30004 are enabled."
    )


def _mode_name(modes: type[RobotMode] | type[SafetyMode], number: int) -> str:
    return modes(number).name if number in list(modes) else str(number)
