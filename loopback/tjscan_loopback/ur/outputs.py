"""What the controller shows through RTDE."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tjscan_loopback.ur.controller import LoopbackController
from tjscan_loopback.ur.states import SAFETY_BITS, ProgramState, RobotPower
from tjscan_loopback.ur.wire import Value, zero_output


def read_output(controller: LoopbackController, name: str) -> Value:
    """Read an output variable; those without meaning here are zero."""
    kind, _, number = name.rpartition("_")
    if kind == "output_int_register":
        return controller.output_int[int(number)]
    if kind == "output_double_register":
        return controller.output_double[int(number)]
    if name in _OUTPUT_READERS:
        return _OUTPUT_READERS[name](controller)
    return zero_output(name)


_OUTPUT_READERS: Final[dict[str, Callable[[LoopbackController], Value]]] = {
    "timestamp": lambda c: c.clock + c.time,
    "actual_q": lambda c: c.q.tolist(),
    "target_q": lambda c: c.target.tolist(),
    "actual_qd": lambda c: c.speed.tolist(),
    "target_qd": lambda c: c.speed.tolist(),
    "actual_TCP_pose": lambda c: c.tcp_pose(),
    "target_TCP_pose": lambda c: c.tcp_pose(),
    "robot_mode": lambda c: int(c.mode),
    "safety_mode": lambda c: int(c.safety),
    "runtime_state": lambda c: int(c.runtime),
    "robot_status_bits": lambda c: (
        int(c.mode > RobotPower.POWER_OFF) | int(c.runtime is ProgramState.PLAYING) << 1
    ),
    "safety_status_bits": lambda c: SAFETY_BITS[c.safety],
    "payload": lambda c: c.payload,
    "payload_cog": lambda c: list(c.centre_of_gravity),
    "speed_scaling": lambda c: c.speed_fraction,
    "target_speed_fraction": lambda c: c.speed_fraction,
    "actual_digital_output_bits": lambda c: c.digital_outputs,
    "standard_analog_output0": lambda c: c.analog_outputs[0],
    "standard_analog_output1": lambda c: c.analog_outputs[1],
}
"""What each output shows. The others are zero."""
