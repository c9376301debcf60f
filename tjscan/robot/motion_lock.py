"""Stops that hold: what an arm lets begin, and what it does not."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from tjscan.core.errors import ArmFault


class MotionLock:
    """Lock that lets one move run at a time, and none after a stop until that is cleared.

    A driver holds `hold_for_move` from the moment a move is ordered until it has ended, and
    `begin_move` while it starts it. So a stop, given from any thread, finds one of two: the move
    has not started, and never will; or it has, and `wait_for_stop` reports it.
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
    def begin_move(self) -> Iterator[None]:
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
