"""State of the controller: modes, registers, joints, the program that runs, and its clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.frames import Array
from tjscan.robot.kinematics import Kinematics
from tjscan_loopback.faults import ScheduledFault
from tjscan_loopback.ur.faults import InjectedFault
from tjscan_loopback.ur.motion import DecelerationMotion, Motion
from tjscan_loopback.ur.packets import PACKET_FAULTS, Inputs, PacketWay
from tjscan_loopback.ur.program import RunningProgram
from tjscan_loopback.ur.programs import ControllerPrograms
from tjscan_loopback.ur.states import ProgramState, RobotPower, SafetyState
from tjscan_loopback.ur.urscript.host import SpeedDrive
from tjscan_loopback.ur.urscript.tokens import ScriptError
from tjscan_loopback.ur.wire import REGISTER_COUNT, Value

FAST_TIME_FACTOR: Final = 25
"""A tick of a fast controller is worth as many ticks of motion."""

MISSED_TARGET_ERROR: Final = 0.01
"""Radians by which the wrist stops short when it is asked to miss."""

UNLOCK_DELAY: Final = 5.0
"""Seconds on the controller's clock that a protective stop lasts at least."""

LET_GO: Final = 10.0
"""rad/s² with which an arm comes to rest that is commanded no more."""

END_INTERVAL: Final = 1e-6
"""Seconds at the end of a motion, from which the speed there is taken."""

PASSING_SPEED: Final = 5e-5
"""rad/s of a joint at the end of a motion that does not end at rest."""

REMEMBERED_TICKS: Final = 1000
"""Ticks for which joint angles are remembered."""

OUTPUT_GROUPS: Final = {"standard": (0, 8), "configurable": (8, 8), "tool": (16, 2)}
"""First digital output of a group, and how many it has."""

SLIDER_POSITIONS: Final = {
    InjectedFault.SLIDER_ZERO: 0.0,
    InjectedFault.SLIDER_HALF: 0.5,
    InjectedFault.SLIDER_FULL: 1.0,
}
"""Positions of the speed slider."""

FAULT_FLAGS: Final = {
    InjectedFault.DROP_LINK: ("dropping",),
    InjectedFault.DROP_DASHBOARD: ("dropping_dashboard",),
    InjectedFault.CLOSE_DASHBOARD: ("dropping_dashboard", "dashboard_closed"),
    InjectedFault.FREEZE: ("frozen",),
    InjectedFault.REFUSE_TARGETS: ("refusing",),
    InjectedFault.MISS_TARGET: ("_missing",),
    InjectedFault.REFUSE_STOP: ("deaf",),
}
"""Faults that a controller has until they are cleared, and its attributes that are true then."""


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
    report_line : callable
        Receives a line for each move and program.
    clock : float, optional
        What its clock shows at first, seconds.
    packet_seed : int, optional
        Decides which packets are affected by their faults.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        q: Array,
        *,
        hz: float,
        fast: bool,
        report_line: Callable[[str], None],
        clock: float = 0.0,
        packet_seed: int = 0,
    ) -> None:
        self.kinematics, self.report_line = kinematics, report_line
        self.mode, self.safety, self.runtime = (
            RobotPower.RUNNING,
            SafetyState.NORMAL,
            ProgramState.STOPPED,
        )
        self.remote = True
        self.refusing = self.deaf = self.frozen = self.dropping = False
        self.dropping_dashboard = self.dashboard_closed = False
        self.input_int, self.output_int = [0] * REGISTER_COUNT, [0] * REGISTER_COUNT
        self.input_double, self.output_double = [0.0] * REGISTER_COUNT, [0.0] * REGISTER_COUNT
        self.q, self.speed = np.array(q, dtype=float), np.zeros(6)
        self._home = self.q.copy()
        self.tcp = np.zeros(6)
        self.payload, self.centre_of_gravity = 0.0, [0.0] * 3
        self.gravity: tuple[float, ...] = (0.0, 0.0, 9.82)
        self.digital_outputs, self.analog_outputs = 0, [0.0] * 2
        self.speed_fraction = 1.0
        self.clock, self.packets = clock, PacketWay(packet_seed)
        self._servo_target: Array | None = None
        self._masks: dict[str, int] = {}
        self.history: deque[Array] = deque([self.q], maxlen=REMEMBERED_TICKS)
        self.time = 0.0
        self.patience = inf
        self._wall = self._heard = 0.0
        self.tick, self._worth = 1 / hz, FAST_TIME_FACTOR if fast else 1
        self._stopped_at = -UNLOCK_DELAY
        self._motion: Motion | None = None
        self._drive: SpeedDrive | None = None
        self._elapsed = self._left = 0.0
        self._is_let_go = False
        self._missing = False
        self._programs = ControllerPrograms(self, report_line)
        self._orders: list[ScheduledFault[InjectedFault]] = []
        self._moves = 0

    # What the network asks of it

    def advance_one_tick(self) -> None:
        """Advance the controller by one tick: time, motion, programs."""
        step = self.tick * (self._worth if self._motion is not None else 1)
        self.time += step
        self._wall += self.tick
        self._write_arrived()
        if self._wall - self._heard > self.patience and not self.deaf:
            self.stop_program()  # the watchdog that the client has set: no one writes any more
        self.history.append(self.q)
        if self.runtime is not ProgramState.PAUSED:
            if self._motion is not None:
                self._advance(self._motion, step * self.speed_fraction)
            elif self._drive is not None:
                self._turn_joints(self._drive, step * self.speed_fraction)
        if self.runtime is not ProgramState.PAUSED and self._programs.run_tick():
            self.stop_program()
        if self._is_let_go:
            self.come_to_rest(float(np.abs(self.speed).max()) / LET_GO)

    def start_script(self, script: str) -> None:
        """Start a script in place of the one that runs; one of kind ``sec`` runs beside it.

        Raises
        ------
        ScriptError
            If the robot is not ready, or it is no URScript.
        """
        if (
            self.mode is not RobotPower.RUNNING
            or self.safety is not SafetyState.NORMAL
            or not self.remote
        ):
            raise ScriptError("the robot is not ready for a program")
        program = RunningProgram(script, self)
        if program.runs_beside:
            self._programs.start_beside(program)
            return
        self.stop_program()
        self._programs.start(program)
        self.runtime = ProgramState.PLAYING

    def stop_program(self) -> None:
        """End the program, those beside it, and the motion."""
        self._programs.end()
        self.runtime, self.patience = ProgramState.STOPPED, inf
        self.stop_instantly()

    def schedule_fault(self, order: ScheduledFault[InjectedFault]) -> None:
        """Schedule a fault for now or for a later move."""
        if order.when:
            self._orders.append(ScheduledFault(order.fault, self._moves + order.when))
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

    def take_inputs(self, inputs: Inputs) -> None:
        """Take what a packet writes, now or when it arrives."""
        self.packets.send(inputs, self._wall)
        self._write_arrived()

    def _write_arrived(self) -> None:
        for name, value in self.packets.arrived(self._wall):
            self.write_input(name, value)

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
        elif name.endswith("_mask"):
            self._masks[name] = int(value)
        elif name.endswith("_digital_output"):
            first, count = OUTPUT_GROUPS[name.partition("_")[0]]
            mask = (self._masks.get(f"{name}_mask", 0) & (1 << count) - 1) << first
            self.digital_outputs = self.digital_outputs & ~mask | int(value) << first & mask
        elif kind == "standard_analog_output" and isfinite(value):
            if self._masks.get("standard_analog_output_mask", 0) >> int(number) & 1:
                self.analog_outputs[int(number)] = float(value)
        elif name == "speed_slider_fraction" and self._masks.get("speed_slider_mask"):
            self.speed_fraction = min(max(float(value), 0.0), 1.0) if isfinite(value) else 0.0

    def tcp_pose(self) -> list[float]:
        """Position in metres and rotation vector of the active TCP in frame b."""
        T_b_tcp = self.kinematics.forward(self.q) @ pose_vector.pose_from_vector(self.tcp)
        return [float(value) for value in pose_vector.pose_to_vector(T_b_tcp)]

    # What the program asks of it

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        return self._motion is not None or self._drive is not None

    def begin_motion(self, motion: Motion) -> None:
        """Begin a motion; what was left of the tick in which the last one ended counts for it."""
        self._moves += 1
        self.report_line(f"move {self._moves}")
        self._take_over(motion, None, self._left)
        self.q = motion.joint_angles_at(self._elapsed)

    def come_to_rest(self, duration: float) -> None:
        """Begin to come to rest within some seconds; scheduled faults do not count it as a move."""
        self._take_over(DecelerationMotion(self.q, self.speed, duration), None)

    def drive(self, speeds: SpeedDrive) -> None:
        """Let the joints turn with a speed that each tick asks for, until another command."""
        self._take_over(None, speeds)

    def servo(self, speeds: SpeedDrive, target: Array) -> None:
        """Drive the joints towards a target, which the controller shows as such."""
        self._take_over(None, speeds)
        self._servo_target = target

    @property
    def target(self) -> Array:
        """Joint angles that were commanded: those of the arm, but while it servoes."""
        return self.q if self._servo_target is None else self._servo_target

    def let_go(self) -> None:
        """End the commands to the arm: unless one comes in this tick, it comes to rest."""
        self._is_let_go = True

    def _take_over(
        self, motion: Motion | None, drive: SpeedDrive | None, elapsed: float = 0.0
    ) -> None:
        self._motion, self._drive, self._elapsed = motion, drive, elapsed
        self._left, self._is_let_go, self._servo_target = 0.0, False, None

    def stop_instantly(self) -> None:
        """Stop the motion at once, where it is."""
        self._take_over(None, None)
        self.speed = np.zeros(6)

    def protective_stop(self, reason: str = "") -> None:
        """Stop as the safety system does; the program pauses."""
        if reason:
            self.report_line(f"protective stop: {reason}")
        self.safety, self._stopped_at = SafetyState.PROTECTIVE_STOP, self.time
        self.pause_program()
        self.stop_instantly()

    def pause_program(self) -> None:
        """Pause the program, if one runs, and its motion."""
        if self._programs.running:
            self.runtime, self.speed = ProgramState.PAUSED, np.zeros(6)

    def resume_program(self) -> bool:
        """Let a paused program go on; whether there is one that may."""
        resumes = self.runtime is ProgramState.PAUSED and self.safety is SafetyState.NORMAL
        if resumes:
            self.runtime = ProgramState.PLAYING
        return resumes

    # Motion and faults

    def _advance(self, motion: Motion, step: float) -> None:
        due = [order for order in self._orders if order.when == self._moves]
        end = motion.duration / 2 if due else motion.duration
        before, passed = self.q, self._elapsed
        self._elapsed = min(self._elapsed + step, end)
        self.q = motion.joint_angles_at(self._elapsed)
        if self._elapsed > passed:
            self.speed = (self.q - before) / (self._elapsed - passed)
        if due and self._elapsed >= end:
            for order in due:
                self._orders.remove(order)
                self._bring(order.fault)
        elif self._elapsed >= motion.duration:
            self._end(motion, passed + step - motion.duration)

    def _end(self, motion: Motion, left: float) -> None:
        """End a motion: at rest, or on into the next one, which has the seconds that are left."""
        speed = (self.q - motion.joint_angles_at(motion.duration - END_INTERVAL)) / END_INTERVAL
        if motion.duration > END_INTERVAL and np.abs(speed).max() > PASSING_SPEED:
            self._take_over(None, None)
            self.speed, self._left, self._is_let_go = speed, left, True
            return
        if self._missing:
            self.q, self._missing = self.q - MISSED_TARGET_ERROR * np.eye(6)[5], False
        self.stop_instantly()

    def _turn_joints(self, drive: SpeedDrive, step: float) -> None:
        speeds = drive(step, self.q, self.speed) if step > 0 else np.zeros(6)
        turned = self.q + step * speeds
        if np.any((turned < self.kinematics.lower) | (turned > self.kinematics.upper)):
            self.protective_stop("a joint would pass its limit")
        elif self.safety is SafetyState.NORMAL:
            self.q, self.speed = turned, speeds

    def _bring(self, fault: InjectedFault) -> None:
        if fault in FAULT_FLAGS:
            for flag in FAULT_FLAGS[fault]:
                setattr(self, flag, True)
        elif fault in PACKET_FAULTS:
            self.packets.faults.add(fault)
        elif fault in SLIDER_POSITIONS:
            self.speed_fraction = SLIDER_POSITIONS[fault]
        elif fault is InjectedFault.PROTECTIVE_STOP:
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
        elif fault is InjectedFault.HOME:
            self.stop_instantly()
            self.q = self._home.copy()
        else:
            self._clear()

    def _clear(self) -> None:
        self.mode, self.safety, self.remote = RobotPower.RUNNING, SafetyState.NORMAL, True
        self.refusing = self.deaf = self.frozen = self._missing = self.dashboard_closed = False
        self._orders.clear()
        self.packets.faults.clear()
        self.speed_fraction = 1.0
        if self.runtime is ProgramState.PAUSED:
            self.stop_program()
