"""The protocol that every arm, real or simulated, fulfils; its rest, and stops that hold."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, Protocol

import numpy as np

from tjscan.core.devices import Device
from tjscan.core.errors import ArmFault
from tjscan.core.frames import Array, array_dataclass


@array_dataclass
class ArmState:
    """State of an arm: its joint angles, flange pose and time.

    Parameters
    ----------
    q : ndarray, shape (n,)
        Joint angles in radians.
    T_b_f : ndarray, shape (4, 4)
        Flange pose in the base frame.
    time : float
        Seconds on the arm's own clock. A simulated arm's clock runs with its motion, not
        with the wall.
    """

    q: Array
    T_b_f: Array
    time: float


class Arm(Device, Protocol):
    """A robot arm that moves its flange to poses; disconnecting stops it.

    Each event, such as a detour, is reported before it begins.
    """

    def state(self) -> ArmState:
        """Joint angles, flange pose and time, as the arm reads them now."""

    def check_moves(self, *T_b_f: Array) -> None:
        """Check a move in joint space to the first pose and straight lines on to the others.

        Nothing moves.

        Raises
        ------
        PoseUnreachable
            If the path leaves the joint limits or the reach.
        """

    def move_linear(self, T_b_f: Array) -> ArmState:
        """Move the flange on a straight line to a pose, and return the state reached.

        Raises
        ------
        PoseUnreachable
            Before anything moves, if the path leaves the joint limits or the reach.
        ArmFault
            If the arm stopped on the way.
        """

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        """Move to a flange pose along a line in joint space, and return the state reached.

        It ends in the configuration nearest to the joint angles `near`, shape (n,), in radians;
        nearest to those it has where they are left out. An arm that goes round what blocks its
        way does not if the path is to be `direct`.

        Raises
        ------
        PoseUnreachable
            Before anything moves, if no configuration within limits holds that pose.
        ArmFault
            If the arm stopped on the way.
        """

    def stop(self) -> None:
        """Bring the arm to rest now, from any thread, and let it begin no move any more.

        The move under way raises ArmFault in its own thread; so does every later one, until the
        stop is taken back by `accept_moves_again`, or by connecting again.
        """

    def accept_moves_again(self) -> None:
        """Take commands again after a stop, once the move that was stopped has ended.

        Not from within a move's own thread while it moves: this waits for it.
        """


LARGEST_TURN_AT_REST: Final = 2e-4
"""Radians a joint may turn while the arm rests: more than encoders flicker, 0.2 mm at 1 m."""

LEAST_REST_DURATION: Final = 0.25
"""Seconds for which no joint may turn further."""

REST_TIMEOUT: Final = 10.0
"""Seconds within which the arm has to come to rest."""

STATE_READING_PAUSE: Final = 0.02
"""Seconds between two looks."""


def await_rest(
    arm: Arm,
    *,
    now: Callable[[], float] = time.monotonic,
    pause: Callable[[float], object] = time.sleep,
) -> ArmState:
    """Wait until an arm has been still for a moment.

    Parameters
    ----------
    arm : Arm
        The arm, connected.
    now, pause : callable, optional
        The clock to go by, in seconds, and what waits some seconds on it.

    Returns
    -------
    ArmState
        Its state at rest.

    Raises
    ------
    ArmFault
        If it is not at rest within `REST_TIMEOUT`.
    """
    until, since, start = now() + REST_TIMEOUT, now(), arm.state()
    while True:
        pause(STATE_READING_PAUSE)
        state, moment = arm.state(), now()
        if largest_joint_rotation(start, state) > LARGEST_TURN_AT_REST:
            since, start = moment, state
        elif moment - since >= LEAST_REST_DURATION:
            return state
        if moment > until:
            raise ArmFault(
                f"the arm does not come to rest: it still moved after {REST_TIMEOUT:g} s. Let it "
                "rest, leave freedrive, then start again."
            )


def check_arm_has_not_moved(before: ArmState, after: ArmState) -> None:
    """Check that an arm has not moved between two states.

    Raises
    ------
    ArmFault
        If it has.
    """
    if (angle := largest_joint_rotation(before, after)) > LARGEST_TURN_AT_REST:
        raise ArmFault(
            f"the arm moved while the laser looked: a joint turned by {np.degrees(angle):.2f} "
            "deg. Let it rest, leave freedrive, then start again."
        )


def largest_joint_rotation(before: ArmState, after: ArmState) -> float:
    """Largest angle in radians by which a joint turned from one state to another."""
    return float(np.abs(after.q - before.q).max())


class MotionLock:
    """Lock that lets one move run at a time, and none after a stop until that is cleared.

    A driver holds `hold_for_move` from the moment a move is ordered until it has ended, and
    `begin_move_unless_stopped` while it starts it. So a stop, given from any thread, finds one of
    two: the move has not started, and never will; or it has, and `wait_for_stop` reports it.
    """

    def __init__(self) -> None:
        self._stopped = threading.Event()
        self._moving = threading.Lock()
        self._starting = threading.RLock()  # a signal's handler may stop what it interrupted

    @contextmanager
    def hold_for_move(self) -> Iterator[None]:
        """Hold the lock while the block orders a move and sees it to its end.

        Raises
        ------
        ArmFault
            If another move is under way, or the arm was stopped and that holds.
        """
        if not self._moving.acquire(blocking=False):
            raise ArmFault("the arm is moving already: wait for that move or stop it")
        try:
            self.check_not_stopped()
            yield
        finally:
            self._moving.release()

    @contextmanager
    def begin_move_unless_stopped(self) -> Iterator[None]:
        """Let the block set a move off unless the arm was stopped, see `check_not_stopped`."""
        with self._starting:
            self.check_not_stopped()
            yield

    def check_not_stopped(self) -> None:
        """Refuse to go on if the arm was stopped and that was not cleared.

        Raises
        ------
        ArmFault
            If one does.
        """
        if self._stopped.is_set():
            raise ArmFault(
                "the arm was stopped, and begins no move until that is taken back. See that the "
                "way is clear, then start again."
            )

    def stop(self) -> None:
        """Forbid new moves; when this returns, none is about to start."""
        self._stopped.set()
        with self._starting:
            pass

    def clear_stop(self) -> None:
        """Wait until the move under way has ended, then allow moves again."""
        with self._moving:
            self._stopped.clear()

    def wait_for_stop(self, seconds: float) -> bool:
        """Wait for a stop, up to a time; returns whether there was one."""
        return self._stopped.wait(seconds)
