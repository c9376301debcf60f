"""A move on a controller: set off, followed to its end, and judged there."""

from __future__ import annotations

import time
from typing import Final

import numpy as np

from tjscan.core.errors import (
    ArmFault,
    ArmNotResponding,
    PoseNotReached,
    ProgramStopped,
    TargetRefused,
)
from tjscan.core.frames import Array, rotation_angle_between
from tjscan.robot.arm import ArmState
from tjscan.robot.motion_lock import MotionLock
from tjscan.robot.ur.commands import MoveCommand
from tjscan.robot.ur.messages import ControllerState
from tjscan.robot.ur.session import ControllerSession
from tjscan.robot.ur.settings import UrSettings

POLL_PERIOD: Final = 0.004
"""Seconds between two looks at a move."""

START_LIMIT: Final = 2.0
"""Seconds within which a move that was accepted begins."""

STALL_LIMIT: Final = 10.0
"""Seconds for which a move may not go on: the speed slider may be at zero for a moment."""

SETTLE_LIMIT: Final = 1.0
"""Seconds the arm may take to come to rest where it was sent."""

REST_SPEED: Final = 5e-3
"""rad/s: what encoders show of a joint at rest, an assumption."""

LEAST_TURN: Final = 1e-5
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
        raise TargetRefused(
            "that is outside the safety limits set on its pendant. Look at its safety "
            "planes and joint limits, or move the base.",
            T_b_f,
        )


def execute_move(
    session: ControllerSession, latch: MotionLock, order: MoveCommand, T_b_f: Array
) -> None:
    """Start a move and wait for its end; whatever interrupts it leaves the arm at rest.

    Raises
    ------
    TargetRefused
        If the controller does not begin it.
    ArmFault
        If the arm was stopped, or something is wrong with it.
    """
    session.keep_dashboard()
    before = session.read_state()
    try:
        with latch.begin_move():
            begun = session.call_client_method(
                bool, order.name, order.target, order.speed, order.acceleration
            )
        if not begun:
            session.read_state()
            session.check_commands_are_answered()
            raise TargetRefused("it did not begin the move. Read its pendant's log.", T_b_f)
        _follow(session, latch, before)
    except BaseException:
        session.stop_move()
        raise


def _follow(session: ControllerSession, latch: MotionLock, before: ControllerState) -> None:
    """Watch a move until it has ended."""
    began, moved, last = time.monotonic(), time.monotonic(), np.array(before.q)
    while True:
        stopping = latch.wait_for_stop(POLL_PERIOD)
        now, moment = session.read_state_supervising_move(), time.monotonic()
        if stopping:
            raise ArmFault(
                "the arm was stopped on its way. See that the way is clear, then move again "
                "from where it is."
            )
        session.keep_dashboard_connected()
        if now.operation == before.operation:
            if moment > began + START_LIMIT:
                raise session.end_for_fault(
                    ProgramStopped("the controller accepted a move and does not begin it.")
                )
        elif not now.moving:
            return
        q = np.array(now.q)
        if np.abs(q - last).max() > LEAST_TURN:
            moved, last = moment, q
        if moment > moved + STALL_LIMIT:
            raise session.end_for_fault(
                ArmNotResponding(
                    f"the arm does not move for {STALL_LIMIT:g} s in the middle of a move. See "
                    "that the speed slider on its pendant is not at zero, then start again."
                )
            )


def await_arrival(
    session: ControllerSession, latch: MotionLock, settings: UrSettings, T_b_f: Array
) -> ArmState:
    """Wait until the arm rests, and check that it is where it was sent.

    Raises
    ------
    PoseNotReached
        If it is not where it was sent. The session has ended then: what holds an arm off
        its place, or moves it, would do so again, and what was planned from there is not so.
    """
    limit, first = time.monotonic() + SETTLE_LIMIT, session.read_state().time
    while True:
        now = session.read_state()
        # A look later than the one that saw the end: both links have the end by then.
        newer, state = now.time > first, session.arm_state_from(now)
        rests = newer and np.abs(now.speed).max() < REST_SPEED
        distance = float(np.linalg.norm(state.T_b_f[:3, 3] - T_b_f[:3, 3]))
        angle = rotation_angle_between(state.T_b_f, T_b_f)
        near = distance <= settings.position_tolerance and angle <= settings.rotation_tolerance
        if rests and near:
            return state
        if newer and time.monotonic() > limit:
            raise session.end_for_fault(
                PoseNotReached(
                    f"it is {1e3 * distance:.2f} mm and {np.degrees(angle):.2f} deg from "
                    "there. See that the payload is right and nothing holds the arm, then start "
                    "again.",
                    T_b_f,
                    state.T_b_f,
                )
            )
        latch.wait_for_stop(POLL_PERIOD)
