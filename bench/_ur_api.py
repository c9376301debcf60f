"""Calls every method of the client library's control interface: ``python _ur_api.py HOST``.

It prints a line of JSON for each: its name, what it gave, and whether the program runs on. A
process of its own, for the library takes the one it is in down when it loses its controller.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from rtde_control import Path, PathEntry, RTDEControlInterface
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface

SIX = [0.0] * 6
HOST = sys.argv[1]


def main() -> None:
    """Call those that work on one connection, and each that is refused on one of its own."""
    control, receive, io = (
        kind(HOST) for kind in (RTDEControlInterface, RTDEReceiveInterface, RTDEIOInterface)
    )
    q, tcp = receive.getActualQ(), receive.getActualTCPPose()
    aside = [tcp[0] + 0.02, *tcp[1:]]
    path = Path()
    for x, blend in ((0.02, 0.005), (0.04, 0.0)):
        path.addEntry(
            PathEntry(
                PathEntry.MoveL, PathEntry.PositionTcpPose, [tcp[0] + x, *tcp[1:], 0.2, 0.5, blend]
            )
        )

    def drive(begin: Callable[[], Any], end: Callable[[], Any]) -> list[Any]:
        """Begin to drive the arm, wait until it moves, end it, and wait until it rests."""
        before = _where(receive)
        begun = begin()
        _await(lambda: max(abs(a - b) for a, b in zip(_where(receive), before, strict=True)) > 1e-3)
        return [begun, end()]

    def arrived_at(x: float) -> float:
        """How far along x it is; another connection says so, and may say so later."""
        _await(lambda: _where(receive)[0] - tcp[0] > x - 2e-3)
        return float(_where(receive)[0] - tcp[0])

    works: dict[str, Callable[[], Any]] = {
        "moveJ": lambda: control.moveJ([*q[:5], q[5] + 0.1], 1, 2),
        "moveJ_IK": lambda: control.moveJ_IK(tcp, 1, 2),
        "moveL": lambda: control.moveL(aside, 0.25, 1),
        "moveL_FK": lambda: control.moveL_FK(q, 0.25, 1),
        "movePath": lambda: [control.movePath(path, False), arrived_at(0.04)],
        "moveL back": lambda: control.moveL(tcp, 0.25, 1),
        "speedJ": lambda: drive(lambda: control.speedJ([0, 0, 0, 0, 0, 0.5], 2), control.speedStop),
        "speedL": lambda: drive(
            lambda: control.speedL([0, 0, 0.05, 0, 0, 0], 1), control.speedStop
        ),
        "servoJ": lambda: drive(
            lambda: control.servoJ([*q[:5], q[5] + 0.05], 0, 0, 0.01, 0.1, 300), control.servoStop
        ),
        "servoL": lambda: drive(
            lambda: control.servoL(tcp, 0, 0, 0.01, 0.05, 300), control.servoStop
        ),
        "jogStart": lambda: drive(lambda: control.jogStart([0.05, 0, 0, 0, 0, 0]), control.jogStop),
        "moveJ home": lambda: control.moveJ(q, 1, 2),
        "stopJ": lambda: [control.moveL(aside, 0.05, 1, True), control.stopJ(2)][0],
        "stopL": lambda: [control.moveL(tcp, 0.05, 1, True), control.stopL(2)][0],
        "moveL home": lambda: control.moveL(tcp, 0.25, 1),
        "poseTrans": lambda: control.poseTrans(tcp, SIX),
        "getForwardKinematics": lambda: control.getForwardKinematics(q, SIX),
        "getInverseKinematics": lambda: control.getInverseKinematics(tcp, q),
        "getInverseKinematicsHasSolution": lambda: control.getInverseKinematicsHasSolution(tcp, q),
        "isPoseWithinSafetyLimits": lambda: control.isPoseWithinSafetyLimits(tcp),
        "isJointsWithinSafetyLimits": lambda: control.isJointsWithinSafetyLimits(q),
        "getTargetWaypoint": control.getTargetWaypoint,
        "isSteady": control.isSteady,
        "startContactDetection": lambda: control.startContactDetection(SIX),
        "stopContactDetection": control.stopContactDetection,
        "setPayload": lambda: control.setPayload(1.5, [0, 0, 0.1]),
        "setTargetPayload": lambda: control.setTargetPayload(1.5, [0, 0, 0.1], SIX),
        "setGravity": lambda: control.setGravity([0, 0, 9.82]),
        "setTcp": lambda: control.setTcp([0, 0, 0.1, 0, 0, 0]),
        "getTCPOffset": control.getTCPOffset,
        "forceModeSetDamping": lambda: control.forceModeSetDamping(0.1),
        "forceModeSetGainScaling": lambda: control.forceModeSetGainScaling(0.5),
        "sendCustomScriptFunction": lambda: control.sendCustomScriptFunction(
            "switch", "set_standard_digital_out(2, True)\n"
        ),
        "setStandardDigitalOut": lambda: io.setStandardDigitalOut(5, True),
        "setSpeedSlider": lambda: [io.setSpeedSlider(0.5), io.setSpeedSlider(1.0)],
        "setWatchdog": lambda: control.setWatchdog(0.1),
        "kickWatchdog": control.kickWatchdog,
    }
    for name, call in works.items():
        _report(name, call, control)
    _await(lambda: receive.getActualDigitalOutputBits() == 0b100100)
    _report("outputs", receive.getActualDigitalOutputBits, control)
    refused: dict[str, Callable[[Any], Any]] = {
        "force_mode": lambda c: c.forceMode(SIX, [0] * 6, SIX, 2, SIX),
        "zero_ftsensor": lambda c: c.zeroFtSensor(),
        "teach_mode": lambda c: c.teachMode(),
        "end_teach_mode": lambda c: c.endTeachMode(),
        "freedrive_mode": lambda c: c.freedriveMode(),
        "end_freedrive_mode": lambda c: c.endFreedriveMode(),
        "get_freedrive_status": lambda c: c.getFreedriveStatus(),
        "ft_rtde_input_enable": lambda c: c.ftRtdeInputEnable(True),
        "enable_external_ft_sensor": lambda c: c.enableExternalFtSensor(True),
        "get_joint_torques": lambda c: c.getJointTorques(),
        "get_mass_matrix": lambda c: c.getMassMatrix(q),
        "get_coriolis_and_centrifugal_torques": lambda c: c.getCoriolisAndCentrifugalTorques(
            q, SIX
        ),
        "get_target_joint_accelerations": lambda c: c.getTargetJointAccelerations(),
        "get_jacobian_time_derivative": lambda c: c.getJacobianTimeDerivative(q, SIX),
    }
    for name, ask in refused.items():
        control.disconnect()
        control = RTDEControlInterface(HOST)
        _report(name, partial(ask, control), control, ends=True)


def _await(is_so: Callable[[], bool]) -> None:
    """Wait until something is so, half a minute at most: what is reported then tells."""
    deadline = time.monotonic() + 30
    while not is_so() and time.monotonic() < deadline:
        time.sleep(0.001)


def _where(receive: Any) -> list[float]:
    return [*receive.getActualTCPPose(), *receive.getActualQ()]


def _report(name: str, call: Callable[[], Any], control: Any, *, ends: bool = False) -> None:
    value = None
    with suppress(RuntimeError):  # what the library raises of a program that ended
        value = call()
    if ends:
        _await(lambda: not control.isProgramRunning())
    print(json.dumps([name, value, control.isProgramRunning()]), flush=True)


if __name__ == "__main__":
    main()
