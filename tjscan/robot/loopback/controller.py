"""State of the controller: modes, registers, joints, the program that runs, and its clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from math import inf
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.frames import Array
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.loopback.faults import InjectedFault, ScheduledFault
from tjscan.robot.loopback.motion import Motion
from tjscan.robot.loopback.program import ControlScript, first_register_of_script
from tjscan.robot.loopback.wire import REGISTERS, Value, zero_output

FAST_TIME_FACTOR: Final = 25
"""A tick of a fast controller is worth as many ticks of motion."""

MISSED_TARGET_ERROR: Final = 0.01
"""Radians by which the wrist stops short when it is asked to miss."""

UNLOCK_DELAY: Final = 5.0
"""Seconds on the controller's clock that a protective stop lasts at least."""


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


class LoopbackController:
    """A simulated robot controller without its network: time, motion, program and faults.

    Parameters
    ----------
    kinematics : Kinematics
        Which arm it drives.
    q : ndarray, shape (6,)
        Joint angles it starts with, in radians.
    hz : float
        Its ticks per second.
    fast : bool
        Whether motion runs faster than the wall's clock; its own clock runs with the motion.
    tell : callable
        Receives a line for each move and program.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        q: Array,
        *,
        hz: float,
        fast: bool,
        tell: Callable[[str], None],
    ) -> None:
        self.kinematics, self.tell = kinematics, tell
        self.mode, self.safety, self.runtime = (
            RobotPower.RUNNING,
            SafetyState.NORMAL,
            ProgramState.STOPPED,
        )
        self.remote = True
        self.refusing = self.deaf = self.frozen = self.dropping = False
        self.dropping_dashboard = self.dashboard_closed = False
        self.input_int, self.output_int = [0] * REGISTERS, [0] * REGISTERS
        self.input_double, self.output_double = [0.0] * REGISTERS, [0.0] * REGISTERS
        self.q, self.speed = np.array(q, dtype=float), np.zeros(6)
        self._home = self.q.copy()
        self.tcp = np.zeros(6)
        self.payload, self.centre_of_gravity = 0.0, [0.0] * 3
        self.time = 0.0
        self.patience = inf
        self._wall = self._heard = 0.0
        self._tick, self._worth = 1 / hz, FAST_TIME_FACTOR if fast else 1
        self._stopped_at = -UNLOCK_DELAY
        self._motion: Motion | None = None
        self._elapsed = 0.0
        self._missing = False
        self._program: ControlScript | None = None
        self._orders: list[ScheduledFault] = []
        self._moves = 0

    # What the network asks of it

    def advance_one_tick(self) -> None:
        """Advance the controller by one tick: time, motion, program."""
        moving = self._motion is not None
        step = self._tick * (self._worth if moving else 1)
        self.time += step
        self._wall += self._tick
        if self._wall - self._heard > self.patience and not self.deaf:
            self.stop_program()  # the watchdog that the client has set: nobody writes any more
        if self._motion is not None:
            self._advance(self._motion, step)
        if (
            self._program is not None
            and self.runtime is ProgramState.PLAYING
            and not self._program.run_cycle()
        ):
            self.stop_program()

    def start_script(self, script: str) -> bool:
        """Start a script; it is the client's own control script, or it is refused."""
        if (
            self.mode is not RobotPower.RUNNING
            or self.safety is not SafetyState.NORMAL
            or not self.remote
        ):
            return False
        offset = first_register_of_script(script)
        if offset is None:
            return False
        self.stop_program()
        self.tell("program started")
        self._program, self.runtime = ControlScript(self, offset), ProgramState.PLAYING
        return True

    def stop_program(self) -> None:
        """End the program, and the motion with it."""
        if self._program is not None:
            self.tell("program stopped")
        self._program, self.runtime, self.patience = None, ProgramState.STOPPED, inf
        self.stop_instantly()

    def schedule_fault(self, order: ScheduledFault) -> None:
        """Schedule a fault for now or for a later move."""
        if order.move:
            self._orders.append(ScheduledFault(order.fault, self._moves + order.move))
        else:
            self._bring(order.fault)

    def unlock_protective_stop(self) -> bool:
        """Release a protective stop, if it has lasted long enough."""
        if self.safety is SafetyState.PROTECTIVE_STOP:
            if self.time - self._stopped_at < UNLOCK_DELAY:
                return False
            self.safety = SafetyState.NORMAL
        return True

    def set_power(self, mode: RobotPower) -> None:
        """Switch the robot on or off."""
        if mode is not RobotPower.RUNNING:
            self.stop_program()
        self.mode = mode

    def write_input(self, name: str, value: Value) -> None:
        """Write an input variable; all but registers are ignored."""
        kind, _, number = name.rpartition("_")
        if isinstance(value, Sequence):
            return
        self._heard = self._wall
        if kind == "input_int_register":
            self.input_int[int(number)] = int(value)
        elif kind == "input_double_register":
            self.input_double[int(number)] = float(value)

    def read_output(self, name: str) -> Value:
        """Read an output variable; those without meaning here are zero."""
        kind, _, number = name.rpartition("_")
        if kind == "output_int_register":
            return self.output_int[int(number)]
        if kind == "output_double_register":
            return self.output_double[int(number)]
        if name in _OUTPUTS:
            return _OUTPUTS[name](self)
        return zero_output(name)

    def tcp_pose(self) -> list[float]:
        """Position in metres and rotation vector of the active TCP in frame b."""
        T_b_tcp = self.kinematics.forward(self.q) @ pose_vector.pose_from_vector(self.tcp)
        return [float(value) for value in pose_vector.pose_to_vector(T_b_tcp)]

    # What the program asks of it

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        return self._motion is not None

    def begin_motion(self, motion: Motion) -> None:
        """Begin a motion that the program commands."""
        self._moves += 1
        self.tell(f"move {self._moves}")
        self._motion, self._elapsed = motion, 0.0

    def start_deceleration(self, motion: Motion) -> None:
        """Begin to stop along a motion; scheduled faults do not count it as a move."""
        self._motion, self._elapsed = motion, 0.0

    @property
    def motion_progress(self) -> tuple[Motion, float] | None:
        """The motion under way, and the seconds of it that have passed."""
        return None if self._motion is None else (self._motion, self._elapsed)

    def stop_instantly(self) -> None:
        """Stop the motion at once, where it is."""
        self._motion, self.speed = None, np.zeros(6)

    def protective_stop(self) -> None:
        """Stop as the safety system does; the program pauses."""
        self.safety, self._stopped_at = SafetyState.PROTECTIVE_STOP, self.time
        if self._program is not None:
            self.runtime = ProgramState.PAUSED
        self.stop_instantly()

    # Motion and faults

    def _advance(self, motion: Motion, step: float) -> None:
        due = [order for order in self._orders if order.move == self._moves]
        end = motion.duration / 2 if due else motion.duration
        before, self._elapsed = self.q, min(self._elapsed + step, end)
        self.q = motion.joint_angles_at(self._elapsed)
        self.speed = (self.q - before) / step
        if due and self._elapsed >= end:
            for order in due:
                self._orders.remove(order)
                self._bring(order.fault)
        elif self._elapsed >= motion.duration:
            if self._missing:
                self.q, self._missing = self.q - MISSED_TARGET_ERROR * np.eye(6)[5], False
            self.stop_instantly()

    def _bring(self, fault: InjectedFault) -> None:
        if fault is InjectedFault.PROTECTIVE_STOP:
            self.protective_stop()
        elif fault is InjectedFault.EMERGENCY_STOP:
            self.safety = SafetyState.ROBOT_EMERGENCY_STOP
            self.set_power(RobotPower.POWER_OFF)
        elif fault is InjectedFault.POWER_OFF:
            self.set_power(RobotPower.POWER_OFF)
        elif fault is InjectedFault.LOCAL_MODE:
            self.remote = False
            self.stop_program()
        elif fault is InjectedFault.STOP_PROGRAM:
            self.stop_program()
        elif fault is InjectedFault.DROP_LINK:
            self.dropping = True
        elif fault is InjectedFault.DROP_DASHBOARD:
            self.dropping_dashboard = True
        elif fault is InjectedFault.CLOSE_DASHBOARD:
            self.dropping_dashboard = self.dashboard_closed = True
        elif fault is InjectedFault.FREEZE:
            self.frozen = True
        elif fault is InjectedFault.REFUSE_TARGETS:
            self.refusing = True
        elif fault is InjectedFault.MISS_TARGET:
            self._missing = True
        elif fault is InjectedFault.REFUSE_STOP:
            self.deaf = True
        elif fault is InjectedFault.HOME:
            self.stop_instantly()
            self.q = self._home.copy()
        else:
            self._clear()

    def _clear(self) -> None:
        self.mode, self.safety, self.remote = RobotPower.RUNNING, SafetyState.NORMAL, True
        self.refusing = self.deaf = self.frozen = self._missing = self.dashboard_closed = False
        self._orders.clear()
        if self.runtime is ProgramState.PAUSED:
            self.stop_program()


_OUTPUTS: Final[dict[str, Callable[[LoopbackController], Value]]] = {
    "timestamp": lambda c: c.time,
    "actual_q": lambda c: c.q.tolist(),
    "target_q": lambda c: c.q.tolist(),
    "actual_qd": lambda c: c.speed.tolist(),
    "target_qd": lambda c: c.speed.tolist(),
    "actual_TCP_pose": LoopbackController.tcp_pose,
    "target_TCP_pose": LoopbackController.tcp_pose,
    "robot_mode": lambda c: int(c.mode),
    "safety_mode": lambda c: int(c.safety),
    "runtime_state": lambda c: int(c.runtime),
    "robot_status_bits": lambda c: (
        int(c.mode > RobotPower.POWER_OFF) | int(c.runtime is ProgramState.PLAYING) << 1
    ),
    "safety_status_bits": lambda c: SAFETY_BITS[c.safety],
    "payload": lambda c: c.payload,
    "payload_cog": lambda c: list(c.centre_of_gravity),
    "speed_scaling": lambda c: 1.0,
    "target_speed_fraction": lambda c: 1.0,
}
"""What each output shows. The others are zero."""
