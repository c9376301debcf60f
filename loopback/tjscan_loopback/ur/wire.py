"""RTDE on the wire: packages, variables and their types, one session per client.

A package is big-endian: its size as u16, its kind as u8, the payload. The variables are those
that the client library asks for; types are spelt as the controller spells them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite
from struct import Struct, unpack
from typing import Final

PACKAGE_HEADER: Final = Struct(">HB")


class PackageKind(IntEnum):
    """Kinds of package, a letter in ASCII each."""

    VERSION = ord("V")
    CONTROLLER = ord("v")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")
    DATA = ord("U")


Value = float | int | Sequence[float] | Sequence[int]
"""What a variable holds."""

VALUE_FORMATS: Final = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
}

REGISTER_COUNT: Final = 48
"""Of each kind."""

MOST_RECIPES: Final = 255
"""Sets of inputs of one client: their number is a byte."""


def _variables(**kinds: str) -> dict[str, str]:
    return {name: kind for kind, names in kinds.items() for name in names.split()}


OUTPUT_TYPES: Final = {
    **_variables(
        DOUBLE="timestamp actual_execution_time speed_scaling target_speed_fraction "
        "actual_momentum actual_main_voltage actual_robot_voltage actual_robot_current "
        "standard_analog_input0 standard_analog_input1 standard_analog_output0 "
        "standard_analog_output1 payload",
        VECTOR6D="target_q target_qd target_qdd target_current target_moment actual_q actual_qd "
        "actual_current joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force "
        "target_TCP_pose target_TCP_speed joint_temperatures actual_joint_voltage "
        "ft_raw_wrench payload_inertia actual_current_as_torque",
        VECTOR3D="actual_tool_accelerometer payload_cog",
        VECTOR6INT32="joint_mode",
        INT32="robot_mode safety_mode",
        UINT32="runtime_state robot_status_bits safety_status_bits",
        UINT64="actual_digital_input_bits actual_digital_output_bits",
    ),
    **{f"output_int_register_{i}": "INT32" for i in range(REGISTER_COUNT)},
    **{f"output_double_register_{i}": "DOUBLE" for i in range(REGISTER_COUNT)},
}
INPUT_TYPES: Final = {
    **_variables(
        UINT8="standard_digital_output_mask standard_digital_output "
        "configurable_digital_output_mask configurable_digital_output "
        "tool_digital_output_mask tool_digital_output "
        "standard_analog_output_mask standard_analog_output_type",
        UINT32="speed_slider_mask",
        DOUBLE="speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
        VECTOR6D="external_force_torque",
    ),
    **{f"input_int_register_{i}": "INT32" for i in range(REGISTER_COUNT)},
    **{f"input_double_register_{i}": "DOUBLE" for i in range(REGISTER_COUNT)},
}


@dataclass(frozen=True, slots=True)
class RtdeRecipe:
    """RTDE recipe: names and types of the variables that are sent together.

    Parameters
    ----------
    names, kinds : tuple of str
        The variables and their types.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]

    def pack(self, values: Sequence[Value]) -> bytes:
        """Pack the values into bytes, in the order of the names."""
        flat: list[float | int] = []
        for value in values:
            flat.extend(value) if isinstance(value, Sequence) else flat.append(value)
        return Struct(">" + "".join(VALUE_FORMATS[kind] for kind in self.kinds)).pack(*flat)

    def unpack(self, data: bytes) -> list[tuple[str, Value]]:
        """Unpack the values from bytes, which may be fewer than the client announced."""
        found: list[tuple[str, Value]] = []
        for name, kind in zip(self.names, self.kinds, strict=True):
            layout = Struct(">" + VALUE_FORMATS[kind])
            if len(data) < layout.size:
                break
            values = layout.unpack(data[: layout.size])
            found.append((name, values[0] if len(values) == 1 else values))
            data = data[layout.size :]
        return found


class InputOwners:
    """Which client writes which input: no two may write the same."""

    def __init__(self) -> None:
        self._owners: dict[str, object] = {}

    def claim(self, names: Sequence[str], owner: object) -> list[str]:
        """Claim inputs for a client, all or none; gives their types, or IN_USE and NOT_FOUND."""
        kinds = [self._kind(name, owner) for name in names]
        if not {"IN_USE", "NOT_FOUND"} & set(kinds):
            self._owners.update(dict.fromkeys(names, owner))
        return kinds

    def release(self, owner: object) -> None:
        """Release the inputs that a client holds."""
        self._owners = {name: o for name, o in self._owners.items() if o is not owner}

    def _kind(self, name: str, owner: object) -> str:
        if self._owners.get(name, owner) is not owner:
            return "IN_USE"
        return INPUT_TYPES.get(name, "NOT_FOUND")


class RtdeSession:
    """Session of one RTDE client with the loopback controller.

    Parameters
    ----------
    send : callable
        Sends bytes to the client.
    version : tuple of int
        Of the controller: major, minor, bugfix, build.
    hz : float
        How often the controller publishes at most.
    registry : InputOwners
        Who writes which input.
    write : callable
        Is given the inputs of each package that arrives: their names and values.
    """

    def __init__(
        self,
        send: Callable[[bytes], None],
        version: tuple[int, int, int, int],
        hz: float,
        registry: InputOwners,
        write: Callable[[Sequence[tuple[str, Value]]], None],
    ) -> None:
        self._send, self._version, self._hz = send, version, hz
        self._registry, self._write = registry, write
        self._inputs: dict[int, RtdeRecipe] = {}
        self._outputs: RtdeRecipe | None = None
        self._started = False
        self._every, self._count = 1, 0

    def answer_package(self, kind: int, payload: bytes) -> None:
        """Answer a package that the client sent."""
        if kind == PackageKind.VERSION:
            self._reply(PackageKind.VERSION, bytes([unpack(">H", payload)[0] == 2]))
        elif kind == PackageKind.CONTROLLER:
            self._reply(PackageKind.CONTROLLER, Struct(">4I").pack(*self._version))
        elif kind == PackageKind.OUTPUTS:
            self._agree_outputs(payload)
        elif kind == PackageKind.INPUTS:
            self._agree_inputs(payload)
        elif kind in (PackageKind.START, PackageKind.PAUSE):
            self._started = kind == PackageKind.START and self._outputs is not None
            self._reply(kind, bytes([kind == PackageKind.PAUSE or self._started]))
        elif kind == PackageKind.DATA and payload and payload[0] in self._inputs:
            self._write(self._inputs[payload[0]].unpack(payload[1:]))

    def send_outputs(self, read: Callable[[str], Value]) -> None:
        """Send the outputs to the client, if it wants them now."""
        if not self._started or self._outputs is None:
            return
        self._count += 1
        if self._count % self._every == 0:
            values = [read(name) for name in self._outputs.names]
            self._reply(PackageKind.DATA, b"\x01" + self._outputs.pack(values))

    def close(self) -> None:
        """Release the inputs that the client holds."""
        self._registry.release(self)

    def _agree_outputs(self, payload: bytes) -> None:
        frequency, names = unpack(">d", payload[:8])[0], _names(payload[8:])
        kinds = [OUTPUT_TYPES.get(name, "NOT_FOUND") for name in names]
        if not (isfinite(frequency) and frequency > 0):
            raise ValueError(f"outputs {frequency:g} times a second")
        if "NOT_FOUND" not in kinds:
            self._outputs = RtdeRecipe(names, tuple(kinds))
            self._every = max(1, round(self._hz / frequency))
        self._reply(PackageKind.OUTPUTS, b"\x01" + ",".join(kinds).encode())

    def _agree_inputs(self, payload: bytes) -> None:
        names = _names(payload)
        kinds = self._registry.claim(names, self)
        number = 0
        if len(self._inputs) >= MOST_RECIPES:
            raise ValueError(f"more than {MOST_RECIPES} sets of inputs")
        if not {"IN_USE", "NOT_FOUND"} & set(kinds):
            number = len(self._inputs) + 1
            self._inputs[number] = RtdeRecipe(names, tuple(kinds))
        self._reply(PackageKind.INPUTS, bytes([number]) + ",".join(kinds).encode())

    def _reply(self, kind: int, payload: bytes) -> None:
        self._send(PACKAGE_HEADER.pack(PACKAGE_HEADER.size + len(payload), kind) + payload)


def _names(payload: bytes) -> tuple[str, ...]:
    return tuple(name for name in payload.decode().split(",") if name)


def zero_output(name: str) -> Value:
    """Zero value of an output variable, number or vector."""
    size = {"VECTOR3D": 3, "VECTOR6D": 6, "VECTOR6INT32": 6}.get(OUTPUT_TYPES[name])
    return 0 if size is None else [0] * size
