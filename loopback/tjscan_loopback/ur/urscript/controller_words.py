"""Words of URScript that read the controller and set it: registers, outputs, tool, limits, time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array, inverse_pose
from tjscan_loopback.ur.motion import tool_jacobian
from tjscan_loopback.ur.urscript.host import ScriptHost
from tjscan_loopback.ur.urscript.tokens import ScriptError
from tjscan_loopback.ur.urscript.values import (
    Pose,
    finite,
    integer,
    numbers,
    pose_matrix,
    pose_of_matrix,
    six,
    truth,
)

AT_REST: Final = 1e-9
"""rad/s."""

LONGEST_SLEEP: Final = 1e6
"""Seconds."""


class ControllerWords:
    """The words that read and set a controller.

    Parameters
    ----------
    host : ScriptHost
        The controller.
    """

    def __init__(self, host: ScriptHost) -> None:
        self._host = host
        self._inertia: tuple[float, ...] = (0.0,) * 6

    def words(self) -> dict[str, Callable[..., Any]]:
        """Words by name."""
        host = self._host
        return {
            **{
                name: getattr(self, name)
                for name in dir(self)
                if not name.startswith("_") and name != "words"
            },
            "read_input_integer_register": lambda i: host.input_int[_index(i, host.input_int)],
            "read_input_float_register": lambda i: host.input_double[_index(i, host.input_double)],
            "read_output_integer_register": lambda i: host.output_int[_index(i, host.output_int)],
            "read_output_float_register": (
                lambda i: host.output_double[_index(i, host.output_double)]
            ),
            "get_actual_joint_positions": lambda: numbers(host.q),
            "get_target_joint_positions": lambda: numbers(host.target),
            "get_actual_joint_speeds": lambda: numbers(host.speed),
            "get_target_joint_speeds": lambda: numbers(host.speed),
            "get_actual_tcp_pose": lambda: pose_of_matrix(self._tool),
            "get_target_tcp_pose": lambda: pose_of_matrix(self._tool),
            "get_actual_tcp_speed": self._tool_velocity,
            "get_target_tcp_speed": self._tool_velocity,
            "get_actual_tool_flange_pose": (
                lambda: pose_of_matrix(host.kinematics.forward(host.q))
            ),
            "get_tcp_offset": lambda: Pose(float(x) for x in host.tcp),
            "get_target_payload": lambda: host.payload,
            "get_target_payload_cog": lambda: tuple(host.centre_of_gravity),
            "get_target_payload_inertia": lambda: self._inertia,
            "get_steptime": lambda: host.tick,
            "protective_stop": lambda: host.protective_stop("the program asks for it"),
        }

    # Time and messages

    def sync(self) -> Iterator[None]:
        """Wait for the next tick."""
        yield

    def sleep(self, t: Any) -> Iterator[None]:
        """Wait for some seconds."""
        left = min(finite(t, "t", least=-1e-12), LONGEST_SLEEP)
        while left > 0:
            yield
            left -= self._host.tick

    def textmsg(self, s1: Any, s2: Any = "") -> None:
        """Write into the log, which is not kept here."""

    def popup(
        self,
        s: Any,
        title: Any = "",
        warning: Any = False,
        error: Any = False,
        blocking: Any = False,
    ) -> Iterator[None]:
        """Show a message on the pendant: one that blocks pauses the program until ``play``."""
        if blocking:
            self._host.pause_program()
            yield

    # Registers and outputs

    def write_output_integer_register(self, address: Any, value: Any) -> None:
        """Write an output register of whole numbers."""
        registers = self._host.output_int
        found = integer(value)
        if not -(2**31) <= found < 2**31:
            raise ScriptError(f"{found} is too large for a register")
        registers[_index(address, registers)] = found

    def write_output_float_register(self, address: Any, value: Any) -> None:
        """Write an output register of numbers."""
        registers = self._host.output_double
        registers[_index(address, registers)] = finite(value, "the value")

    def set_standard_digital_out(self, n: Any, b: Any) -> None:
        """Switch one of the eight standard digital outputs."""
        self._switch(n, b, 0, 8)

    def set_configurable_digital_out(self, n: Any, b: Any) -> None:
        """Switch one of the eight configurable digital outputs."""
        self._switch(n, b, 8, 8)

    def set_tool_digital_out(self, n: Any, b: Any) -> None:
        """Switch one of the two digital outputs of the tool."""
        self._switch(n, b, 16, 2)

    def set_digital_out(self, n: Any, b: Any) -> None:
        """Switch one of the digital outputs, counted through."""
        self._switch(n, b, 0, 18)

    def get_standard_digital_out(self, n: Any) -> bool:
        """Whether one of the standard digital outputs is on."""
        return bool(self._host.digital_outputs >> _number_of(n, 8) & 1)

    def set_standard_analog_out(self, n: Any, f: Any) -> None:
        """Set one of the two standard analog outputs, as a share of its range."""
        share = finite(f, "f")
        if not 0 <= share <= 1:
            raise ScriptError(f"an analog output is 0 to 1 (found {share:g})")
        self._host.analog_outputs[_number_of(n, 2)] = share

    # Tool, load, watch

    def set_tcp(self, pose: Any) -> None:
        """Set the active TCP on the flange."""
        pose_matrix(pose, "the TCP")
        self._host.tcp = six(pose, "the TCP")

    def set_payload(self, m: Any, cog: Any = None) -> None:
        """Set the payload in kilograms, and its centre of gravity."""
        self.set_target_payload(m, tuple(self._host.centre_of_gravity) if cog is None else cog)

    def set_target_payload(
        self, m: Any, cog: Any = (0.0, 0.0, 0.0), inertia: Any = (0.0,) * 6, t: Any = 0
    ) -> None:
        """Set payload, centre of gravity and inertia."""
        finite(t, "t")
        if not isinstance(cog, tuple) or len(cog) != 3:
            raise ScriptError(f"a centre of gravity is three numbers (found {cog!r})")
        self._host.payload = finite(m, "the payload", least=-1e-12)
        self._host.centre_of_gravity = [finite(x, "cog") for x in cog]
        self._inertia = numbers(six(inertia, "inertia"))

    def set_gravity(self, d: Any) -> None:
        """Set the direction against gravity: nothing has a weight here."""
        if not isinstance(d, tuple) or len(d) != 3:
            raise ScriptError(f"gravity is three numbers (found {d!r})")
        self._host.gravity = tuple(finite(x, "d") for x in d)

    def rtde_set_watchdog(
        self, variable_name: Any, min_frequency: Any, action: Any = "pause"
    ) -> None:
        """End the program where inputs arrive less often than this; other actions are refused."""
        if action != "stop":
            raise ScriptError(f"the watchdog knows the action 'stop' alone (found {action!r})")
        self._host.patience = 1 / finite(min_frequency, "the watchdog's frequency", least=0.0)

    def force_mode_set_gain_scaling(self, scaling: Any) -> None:
        """Set how stiff force mode is, which this controller has not."""
        finite(scaling, "scaling")

    def force_mode_set_damping(self, damping: Any) -> None:
        """Set how damped force mode is, which this controller has not."""
        finite(damping, "damping")

    def tool_contact(self, direction: Any = (0.0,) * 6) -> int:
        """Ticks since the tool touched something: it touches nothing here."""
        six(direction, "the direction")
        return 0

    # Kinematics and limits

    def get_forward_kin(self, q: Any = None, tcp: Any = None) -> Pose:
        """Pose of the TCP for joint angles; of the active one, at its present pose, if left out."""
        T_b_f = self._host.kinematics.forward(self._host.q if q is None else six(q, "q"))
        return pose_of_matrix(T_b_f @ (self._T_f_tcp if tcp is None else pose_matrix(tcp, "tcp")))

    def get_inverse_kin(
        self,
        x: Any,
        qnear: Any = None,
        maxPositionError: Any = 1e-10,
        maxOrientationError: Any = 1e-10,
        tcp: Any = None,
    ) -> tuple[float, ...]:
        """Joint angles for a pose of the TCP, near others; the program ends if there are none."""
        q = self._inverse(x, qnear, tcp)
        if q is None:
            raise ScriptError("the pose has no inverse kinematics")
        return numbers(q)

    def get_inverse_kin_has_solution(
        self,
        pose: Any,
        qnear: Any = None,
        maxPositionError: Any = 1e-10,
        maxOrientationError: Any = 1e-10,
        tcp: Any = None,
    ) -> bool:
        """Whether there are joint angles for a pose of the TCP."""
        return self._inverse(pose, qnear, tcp) is not None

    def get_jacobian(self, q: Any = None, tcp: Any = None) -> tuple[tuple[float, ...], ...]:
        """Velocity of the TCP for unit joint speeds, 6 by 6; at the present pose if left out."""
        q = self._host.q if q is None else six(q, "q")
        T_f_tcp = self._T_f_tcp if tcp is None else pose_matrix(tcp, "tcp")
        return tuple(numbers(row) for row in tool_jacobian(self._host.kinematics, q, T_f_tcp))

    def is_within_safety_limits(self, target: Any) -> bool:
        """Whether a pose of the TCP, or joint angles, are within joint limits and reach."""
        if self._host.refusing:
            return False
        if isinstance(target, Pose):
            return self._inverse(target) is not None
        q, kinematics = six(target, "the target"), self._host.kinematics
        return bool(np.all((q >= kinematics.lower) & (q <= kinematics.upper)))

    def is_steady(self) -> bool:
        """Whether the arm rests."""
        return not self._host.moving and bool(np.abs(self._host.speed).max() < AT_REST)

    def get_actual_joint_positions_history(self, steps: Any = 0) -> tuple[float, ...]:
        """Joint angles some ticks ago."""
        back, history = integer(steps), self._host.history
        if not 0 <= back < len(history):
            raise ScriptError(f"the history holds {len(history)} ticks (found {back})")
        return numbers(history[-1 - back])

    # How

    @property
    def _T_f_tcp(self) -> Array:
        return pose_vector.pose_from_vector(self._host.tcp)

    @property
    def _tool(self) -> Array:
        return np.asarray(self._host.kinematics.forward(self._host.q) @ self._T_f_tcp)

    def _tool_velocity(self) -> tuple[float, ...]:
        J = tool_jacobian(self._host.kinematics, self._host.q, self._T_f_tcp)
        return numbers(J @ self._host.speed)

    def _inverse(self, x: Any, near: Any = None, tcp: Any = None) -> Array | None:
        T_f_tcp = self._T_f_tcp if tcp is None else pose_matrix(tcp, "tcp")
        T_b_f = pose_matrix(x, "the pose") @ inverse_pose(T_f_tcp)
        try:
            return self._host.kinematics.inverse(
                T_b_f, self._host.q if near is None else six(near, "qnear")
            )
        except PoseUnreachable:
            return None

    def _switch(self, n: Any, b: Any, first: int, count: int) -> None:
        bit = 1 << first + _number_of(n, count)
        on = truth(b)
        self._host.digital_outputs = self._host.digital_outputs & ~bit | (bit if on else 0)


def _index(address: Any, registers: list[Any]) -> int:
    return _number_of(address, len(registers))


def _number_of(n: Any, count: int) -> int:
    found = integer(n)
    if not 0 <= found < count:
        raise ScriptError(f"there is no number {found} of {count}")
    return found
