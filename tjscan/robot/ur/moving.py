"""Moves and programs on a controller: set off, followed to their end, and judged there.

A program of our own runs in place of the client library's control script. The client goes on
watching the controller and feeding its watchdog, so that a controller which no longer hears this
computer ends the program.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import NoneType
from typing import Final

import numpy as np

from tjscan.core import errors, pose_vector
from tjscan.core.frames import Array
from tjscan.robot.arm import ArmState
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import JointTrajectory
from tjscan.robot.ur.messages import (
    PROGRAM_PLAYING,
    PROGRAM_WAITING,
    WATCHDOG_PERIOD,
    ControllerState,
)
from tjscan.robot.ur.session import ControllerSession

SHORTEST_LINE_LENGTH: Final = 1e-6
"""Metres: a shorter line is none."""

LARGEST_FLANGE_SWING: Final = 0.005
"""Metres that the flange may swing aside while it turns on the spot, within any margin."""

OTHER_CONFIGURATION_ANGLE: Final = 0.1
"""Radians between the controller's inverse and ours, beyond calibration."""

LARGEST_JOINT_SPEED: Final = 3.0
"""rad/s: the client library refuses more than 3.14."""

LARGEST_JOINT_ACCELERATION: Final = 39.0
"""rad/s²: the client library refuses more than 40."""


MoveCommand = tuple[str, tuple[float, ...], float, float]
"""A move as the client takes it: a method of `client.RtdeClient`, its target (pose of the TCP, or
joint angles), then speed and acceleration of the flange in m/s and m/s², or of the leading joint in
rad/s and rad/s²."""


def linear_command(
    kinematics: Kinematics, session: ControllerSession, path: JointTrajectory, T_b_f: Array
) -> MoveCommand:
    """Command that moves the flange on a straight line along a path that ends at a pose.

    Raises
    ------
    TargetRefused
        If it turns on the spot, and swings the flange aside.
    """
    end, start = (kinematics.forward(path.q[i])[:3, 3] for i in (-1, 0))
    length = float(np.linalg.norm(end - start))
    if length < SHORTEST_LINE_LENGTH:
        return _turn_on_spot_command(kinematics, session, path, T_b_f)
    return ("move_linear", session.active_tcp_pose(T_b_f), *_speed_and_acceleration(path, length))


def joint_command(session: ControllerSession, path: JointTrajectory, T_b_f: Array) -> MoveCommand:
    """Command that moves in joint space along a path that ends at a pose.

    The controller knows how its arm differs from the drawing; ours is the configuration.

    Raises
    ------
    TargetRefused
        If the controller has the pose in another configuration.
    """
    goal, tcp = path.q[-1], session.active_tcp_pose(T_b_f)
    q = np.array(session.call_client_method(list, "inverse", tcp, tuple(goal.tolist())))
    if q.shape != goal.shape or np.abs(q - goal).max() > OTHER_CONFIGURATION_ANGLE:
        session.read_state()  # the true reason, if the arm is not well
        raise errors.TargetRefused("it finds no configuration near the one planned.", T_b_f)
    speed, acceleration = _speed_and_acceleration(path, float(np.abs(goal - path.q[0]).max()))
    limited = min(speed, LARGEST_JOINT_SPEED), min(acceleration, LARGEST_JOINT_ACCELERATION)
    return ("move_joint", tuple(q.tolist()), *limited)


def _turn_on_spot_command(
    kinematics: Kinematics, session: ControllerSession, path: JointTrajectory, T_b_f: Array
) -> MoveCommand:
    """A line without length: a speed of the flange bounds no turn, speeds of joints do."""
    straight = path.q[0] + np.linspace(0, 1, 9)[:, None] * (path.q[-1] - path.q[0])
    places = np.array([kinematics.forward(q)[:3, 3] for q in straight])
    if np.linalg.norm(places - places[0], axis=1).max() > LARGEST_FLANGE_SWING:
        message = "a turn this wide on the spot would swing the flange aside; turn in parts."
        raise errors.TargetRefused(message, T_b_f)
    return joint_command(session, path, T_b_f)


def _speed_and_acceleration(path: JointTrajectory, length: float) -> tuple[float, float]:
    """Speed and acceleration along a path of this length that take as long as it does."""
    speed = length / (path.duration - path.ramp)
    return speed, speed / path.ramp


MOVE_POLL_PERIOD: Final = 0.004
"""Seconds between two looks at a move."""

MOVE_START_LIMIT: Final = 2.0
"""Seconds within which a move that was accepted begins."""

MOVE_STALL_TIMEOUT: Final = 10.0
"""Seconds for which a move may not go on: the speed slider may be at zero for a moment."""

ARRIVAL_SETTLE_TIMEOUT: Final = 1.0
"""Seconds the arm may take to come to rest where it was sent."""

JOINT_SPEED_AT_REST: Final = 5e-3
"""rad/s: what encoders show of a joint at rest, an assumption."""

LEAST_MOVING_TURN: Final = 1e-5
"""Radians a joint turns at least between two looks at an arm that moves."""


def check_target_is_safe(session: ControllerSession, T_b_f: Array) -> None:
    """Check with the controller that a pose is within its safety limits; else TargetRefused.

    The client library also answers no if the controller does not answer. So the controller is
    asked again, after it has answered a question with a known answer.

    Raises
    ------
    TargetRefused
        If not.
    ArmFault
        If it is not well, or does not answer.
    """
    target = session.active_tcp_pose(T_b_f)
    if session.call_client_method(bool, "pose_is_safe", target):
        return
    session.read_state()  # the true reason, if the arm is not well
    session.check_commands_are_answered()
    if not session.call_client_method(bool, "pose_is_safe", target):
        session.read_state()
        raise errors.TargetRefused(
            "that is outside the safety limits set on its pendant. Look at its safety "
            "planes and joint limits, or move the base.",
            T_b_f,
        )


def execute_move(session: ControllerSession, command: MoveCommand, T_b_f: Array) -> None:
    """Start a move and wait for its end; whatever interrupts it leaves the arm at rest.

    Raises
    ------
    TargetRefused
        If the controller does not begin it.
    ArmFault
        If the arm was stopped, or something is wrong with it.
    """
    session.ensure_dashboard_answers()
    before = session.read_state()
    try:
        with session.latch.begin_move_unless_stopped():
            begun = session.call_client_method(bool, *command)
        if not begun:
            session.read_state()
            session.check_commands_are_answered()
            raise errors.TargetRefused("it did not begin the move. Read its pendant's log.", T_b_f)
        _follow_move_to_its_end(session, before)
    except BaseException:
        session.stop_move()
        raise


def _follow_move_to_its_end(session: ControllerSession, before: ControllerState) -> None:
    began, moved, last = time.monotonic(), time.monotonic(), np.array(before.q)
    while True:
        stopping = session.latch.wait_for_stop(MOVE_POLL_PERIOD)
        now, moment = session.read_state(supervising_move=True), time.monotonic()
        if stopping:
            raise errors.ArmFault(
                "the arm was stopped on its way. See that the way is clear, then move again "
                "from where it is."
            )
        session.ensure_dashboard_connected()
        if now.operation == before.operation:
            if moment > began + MOVE_START_LIMIT:
                fault = errors.ProgramStopped(
                    "the controller accepted a move and does not begin it."
                )
                raise session.end_session_for_fault(fault)
        elif not now.moving:
            return
        q = np.array(now.q)
        if np.abs(q - last).max() > LEAST_MOVING_TURN:
            moved, last = moment, q
        if moment > moved + MOVE_STALL_TIMEOUT:
            raise session.end_session_for_fault(
                errors.ArmNotResponding(
                    f"the arm does not move for {MOVE_STALL_TIMEOUT:g} s in the middle of a move. "
                    "See that the speed slider on its pendant is not at zero, then start again."
                )
            )


def await_arrival(session: ControllerSession, T_b_f: Array) -> ArmState:
    """Wait until the arm rests, and check that it is where it was sent.

    Raises
    ------
    PoseNotReached
        If it is not where it was sent. The session has ended then: what holds an arm off
        its place, or moves it, would do so again, and what was planned from there is not so.
    """
    limit, first = time.monotonic() + ARRIVAL_SETTLE_TIMEOUT, session.read_state().time
    while True:
        now = session.read_state()
        # A look later than the one that saw the end: both links have the end by then.
        newer, state = now.time > first, session.arm_state_from(now)
        rests = newer and np.abs(now.speed).max() < JOINT_SPEED_AT_REST
        distance, angle, near = session.settings.compare_with_wanted_pose(state.T_b_f, T_b_f)
        if rests and near:
            return state
        if newer and time.monotonic() > limit:
            raise session.end_session_for_fault(
                errors.PoseNotReached(
                    f"it is {1e3 * distance:.2f} mm and {np.degrees(angle):.2f} deg from "
                    "there. See that the payload is right and nothing holds the arm, then start "
                    "again.",
                    T_b_f,
                    state.T_b_f,
                )
            )
        session.latch.wait_for_stop(MOVE_POLL_PERIOD)


SECONDARY_INTERFACE_PORT: Final = 30002
"""Of the secondary interface, which takes programs."""

PROGRAM_POLL_PERIOD: Final = 0.05
"""Seconds between two looks at a program."""

WATCHDOG_STATEMENT: Final = (
    f'  rtde_set_watchdog("input_int_register_0", {1 / WATCHDOG_PERIOD:g}, "stop")'
)
"""First statement of a program: to end when nothing is heard of this computer any more."""


@dataclass(frozen=True, slots=True, eq=False)
class UrProgram:
    """A program in URScript, and the pose that it leads to.

    Parameters
    ----------
    script : str
        ``def NAME(): ... end``.
    T_b_tcp : ndarray, shape (4, 4)
        Where it leaves the TCP that it sets, in frame b.
    leave : str
        Another program, that is run if this one does not come to its end: to switch off what it
        has switched on.
    output : int
        Number of the standard digital output that it switches: while that is on, it never pauses.
    """

    script: str
    T_b_tcp: Array
    leave: str
    output: int

    def goes_on(self, now: ControllerState) -> bool:
        """Whether it runs, or waits for a person with its output off."""
        waits = now.runtime_state in PROGRAM_WAITING and not now.outputs >> self.output & 1
        return waits or now.runtime_state == PROGRAM_PLAYING


def run_program(
    session: ControllerSession, program: UrProgram, started: Callable[[], object]
) -> None:
    """Run a program and watch it to its end.

    Parameters
    ----------
    session : ControllerSession
        The session; its control script ends.
    program : UrProgram
        The program.
    started : callable
        Is called once it runs.

    Raises
    ------
    ArmFault
        If the arm was stopped, or something is wrong with it.
    ProgramStopped
        If the controller does not begin it.
    PoseNotReached
        If it did not lead where it should: it was stopped on its way.
    """
    session.ensure_dashboard_answers()
    session.read_state()
    try:
        head, _, rest = program.script.partition("\n")
        start_program(session, "\n".join((head, WATCHDOG_STATEMENT, rest)))
        started()
        while program.goes_on(session.read_state(beside_program=True)):
            if session.latch.wait_for_stop(PROGRAM_POLL_PERIOD):
                raise errors.ArmFault(
                    "the program was stopped on its way. See that the way is clear."
                )
            session.ensure_dashboard_connected()
        _check_program_end_pose(session, program.T_b_tcp)
    except BaseException as error:
        session.stop_program(error)
        try:
            _send_script(session, program.leave)
        except errors.ArmFault as unsent:
            error.add_note(f"What is more, its outputs could not be reset: {unsent}")
        raise


def start_program(session: ControllerSession, script: str) -> None:
    """Start a program in place of the control script; raises as `run_program` does."""
    with session.latch.begin_move_unless_stopped():
        session.call_client_method(NoneType, "stop_control_script")
        await_program_state(session, runs=False)
        _send_script(session, script)
    await_program_state(session, runs=True)
    session.call_client_method(NoneType, "feed_foreign_watchdog")


def _send_script(session: ControllerSession, script: str) -> None:
    host = session.settings.host
    try:
        with socket.create_connection((host, SECONDARY_INTERFACE_PORT), MOVE_START_LIMIT) as link:
            link.sendall(f"{script.rstrip()}\n".encode())
            # Some controllers drop what they have not read when the link closes.
            time.sleep(4 * PROGRAM_POLL_PERIOD)
    except OSError as error:
        raise errors.ArmNotConnected(
            f"the controller at {host} takes no programs (port {SECONDARY_INTERFACE_PORT}: "
            f"{error.strerror or error}). See that the interface is enabled in its security "
            "settings."
        ) from None


def await_program_state(session: ControllerSession, *, runs: bool) -> None:
    """Wait until a program runs, or holds already, or none does."""
    limit, begun = time.monotonic() + MOVE_START_LIMIT, (PROGRAM_PLAYING, *PROGRAM_WAITING)
    while (session.read_state(beside_program=True).runtime_state in begun) != runs:
        if time.monotonic() > limit:
            verb = "begin the program" if runs else "end the program before"
            raise errors.ProgramStopped(f"the controller does not {verb}. Read its log.")
        session.latch.wait_for_stop(PROGRAM_POLL_PERIOD)


def _check_program_end_pose(session: ControllerSession, T_b_tcp: Array) -> None:
    there = pose_vector.pose_from_vector(np.array(session.read_state(beside_program=True).tcp))
    distance, angle, near = session.settings.compare_with_wanted_pose(there, T_b_tcp)
    if not near:
        raise errors.PoseNotReached(
            f"the program ended {1e3 * distance:.1f} mm and {np.degrees(angle):.1f} deg from where "
            "it leads: it was stopped on its way, by a person or by the controller, whose log then "
            "states why.",
            T_b_tcp,
            there,
        )
