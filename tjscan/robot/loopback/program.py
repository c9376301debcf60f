"""What the client's control script does, command by command; it is no URScript interpreter.

The client writes a command and its arguments into input registers and waits until output
register 0 says that it is done (2), clears the command, and waits until it is ready (1).
"""

from __future__ import annotations

import re
from typing import Final, Protocol

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array, inverse_pose
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.loopback.motion import (
    Motion,
    decelerate_motion,
    joint_motion,
    linear_motion,
)

READY, DONE = 1, 2
"""What output register 0 says."""

MOVE_J, MOVE_J_IK, MOVE_L, MOVE_L_FK, STOP_L, STOP_J = 1, 2, 3, 4, 33, 34
PAYLOAD, SET_TCP, INVERSE_NEAR, PROTECT, POSE_SAFE, JOINTS_SAFE = 17, 29, 30, 31, 36, 37
TCP_OFFSET, FORWARD, FORWARD_OF, INVERSE, STEADY = 40, 43, 44, 46, 47
WATCHDOG, HAS_INVERSE, HAS_INVERSE_NEAR, END = 35, 60, 61, 255
"""Commands of the control script."""

COUNTS: Final = 128
"""Counters of asynchronous operations have seven bits."""

LINEAR_STOP: Final = 0.25
"""rad/s² per m/s²: a linear stop is braked in joint space here, about as fast."""


def first_register_of_script(script: str) -> int | None:
    """First register that a control script uses, or None where it is another script."""
    found = re.search(r"# int register offset\n\s*(\d+)", script)
    return int(found[1]) if found and "def rtde_control" in script else None


class ScriptHost(Protocol):
    """Controller as a control script sees it: motions, registers and stops."""

    kinematics: Kinematics
    q: Array
    tcp: Array
    payload: float
    centre_of_gravity: list[float]
    input_int: list[int]
    output_int: list[int]
    input_double: list[float]
    output_double: list[float]
    patience: float
    refusing: bool

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        ...

    def begin_motion(self, motion: Motion) -> None:
        """Begin a motion."""
        ...

    def start_deceleration(self, motion: Motion) -> None:
        """Begin to come to rest along a motion."""
        ...

    @property
    def motion_progress(self) -> tuple[Motion, float] | None:
        """The motion under way and its seconds so far."""
        ...

    def stop_instantly(self) -> None:
        """Stand still at once."""
        ...

    def protective_stop(self) -> None:
        """Stop as the safety system does, until it is unlocked."""
        ...


class ControlScript:
    """The client's control script while the loopback controller runs it.

    Parameters
    ----------
    controller : ScriptHost
        Runs it.
    offset : int
        First register it uses, 0 or 24.
    """

    def __init__(self, controller: ScriptHost, offset: int) -> None:
        self._controller, self._offset = controller, offset
        self._executed = False
        self._waiting = False
        self._asynchronous = False
        self._writes = self._operations = 0
        self._report(running=False)
        self._say(READY)

    def run_cycle(self) -> bool:
        """Run the script's main loop once; returns whether it goes on."""
        if self._asynchronous and not self._controller.moving:
            self._asynchronous = False
            self._report(running=False)
        command = self._int(0)
        if self._waiting:
            if not self._controller.moving:
                self._waiting = False
                self._say(DONE)
        elif command == END:
            return False
        elif command == 0:
            self._executed = False
            self._say(READY)
        elif not self._executed:
            self._executed = True
            if not self._execute(command):
                return False
            self._waiting = self._controller.moving and not self._asynchronous
            if not self._waiting:
                self._say(DONE)
        return True

    def _execute(self, command: int) -> bool:
        """Do a command; returns whether the script survives it."""
        controller = self._controller
        if command in (MOVE_J, MOVE_J_IK, MOVE_L, MOVE_L_FK):
            return self._move(command)
        if command in (STOP_L, STOP_J):
            self._stop(self._double(0) * (LINEAR_STOP if command == STOP_L else 1))
        elif command == PAYLOAD:
            controller.payload = self._double(0)
            controller.centre_of_gravity = [self._double(i) for i in (1, 2, 3)]
        elif command == SET_TCP:
            controller.tcp = self._six(0)
        elif command == TCP_OFFSET:
            self._give(controller.tcp)
        elif command == PROTECT:
            controller.protective_stop()
        elif command == POSE_SAFE:
            self._answer(not controller.refusing and self._inverse(self._six(0)) is not None)
        elif command == JOINTS_SAFE:
            self._answer(not controller.refusing and self._within_limits(self._six(0)))
        elif command in (INVERSE, INVERSE_NEAR):
            near = self._six(6) if command == INVERSE_NEAR else None
            q = self._inverse(self._six(0), near)
            if q is None:
                return False  # a script that asks for the inverse of what has none dies
            self._give(q)
        elif command in (HAS_INVERSE, HAS_INVERSE_NEAR):
            near = self._six(6) if command == HAS_INVERSE_NEAR else None
            self._answer(self._inverse(self._six(0), near) is not None)
        elif command == FORWARD:
            self._give(
                pose_vector.pose_to_vector(
                    controller.kinematics.forward(controller.q) @ self._T_f_tcp
                )
            )
        elif command == FORWARD_OF:
            T_b_f = controller.kinematics.forward(self._six(0))
            self._give(
                pose_vector.pose_to_vector(T_b_f @ pose_vector.pose_from_vector(self._six(6)))
            )
        elif command == WATCHDOG:
            controller.patience = 1 / max(self._double(0), 1e-3)
        elif command == STEADY:
            self._answer(not controller.moving)
        return True

    def _move(self, command: int) -> bool:
        self._end_asynchronous()
        motion = self._plan(command)
        if motion is None:
            return False
        self._controller.begin_motion(motion)
        if self._int(1) == 1:
            self._begin_asynchronous()
        return True

    def _plan(self, command: int) -> Motion | None:
        controller, target = self._controller, self._six(0)
        speed, acceleration = self._double(6), self._double(7)
        if command in (MOVE_L, MOVE_L_FK):
            T_b_f = (
                controller.kinematics.forward(target)
                if command == MOVE_L_FK
                else pose_vector.pose_from_vector(target) @ inverse_pose(self._T_f_tcp)
            )
            try:
                return linear_motion(
                    controller.kinematics, controller.q, T_b_f, speed, acceleration
                )
            except PoseUnreachable:
                return None
        goal = self._inverse(target) if command == MOVE_J_IK else target
        if goal is None or not self._within_limits(goal):
            return None
        return joint_motion(controller.kinematics, controller.q, goal, speed, acceleration)

    def _stop(self, deceleration: float) -> None:
        progress = self._controller.motion_progress
        self._end_asynchronous()
        if progress is not None:
            self._controller.start_deceleration(decelerate_motion(*progress, deceleration))
        if self._int(1) == 1:
            self._begin_asynchronous()

    def _begin_asynchronous(self) -> None:
        self._asynchronous = True
        self._operations = (self._operations + 1) % COUNTS
        self._report(running=True)

    def _end_asynchronous(self) -> None:
        if self._asynchronous:
            self._asynchronous = False
            self._controller.stop_instantly()
            self._report(running=False)

    def _report(self, *, running: bool) -> None:
        """Number of writes in bits 16 to 22, of operations in 24 to 30, bit 15: running."""
        self._writes = (self._writes + 1) % COUNTS
        word = self._writes << 16 | self._operations << 24 | running << 15
        self._controller.output_int[self._offset + 2] = word

    @property
    def _T_f_tcp(self) -> Array:
        return pose_vector.pose_from_vector(self._controller.tcp)

    def _inverse(self, target: Array, near: Array | None = None) -> Array | None:
        controller = self._controller
        T_b_f = pose_vector.pose_from_vector(target) @ inverse_pose(self._T_f_tcp)
        try:
            return controller.kinematics.inverse(T_b_f, controller.q if near is None else near)
        except PoseUnreachable:
            return None

    def _within_limits(self, q: Array) -> bool:
        kinematics = self._controller.kinematics
        return bool(np.all((q >= kinematics.lower) & (q <= kinematics.upper)))

    def _int(self, i: int) -> int:
        return self._controller.input_int[self._offset + i]

    def _double(self, i: int) -> float:
        return self._controller.input_double[self._offset + i]

    def _six(self, first: int) -> Array:
        return np.array([self._double(first + i) for i in range(6)])

    def _say(self, state: int) -> None:
        self._controller.output_int[self._offset] = state

    def _answer(self, yes: bool) -> None:
        self._controller.output_int[self._offset + 1] = int(yes)

    def _give(self, values: Array) -> None:
        start = self._offset
        self._controller.output_double[start : start + 6] = [float(value) for value in values]
