"""Asking a scan to stop, or to pause for a while between two sections."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Condition

from tjscan.core.errors import ScanInterrupted, TjscanError


class StopRequest:
    """Asks a scan to stop, from another thread: after the section under way, or at once.

    It may also be asked to pause between two sections, and to go on by one or altogether.

    Attributes
    ----------
    ends_after_section : bool
        Whether the scan shall end after the section under way.
    must_stop_now : bool
        Whether nothing shall move any more.
    """

    def __init__(self) -> None:
        self.ends_after_section = self.must_stop_now = False
        self._halt: Callable[[], None] | None = None
        self._may_go = Condition()
        self._paused = False
        self._steps = self._let_go = 0

    @property
    def scan_is_running(self) -> bool:
        """Whether a scan is under way that looks at this request."""
        return self._halt is not None

    @property
    def is_paused(self) -> bool:
        """Whether the scan pauses, or shall pause, after the section under way."""
        return self._paused and not self._steps and not self.ends_after_section

    @property
    def asks_for_rest(self) -> bool:
        """Whether the arm shall come to rest after the section under way, for whatever reason."""
        return self.is_paused or self.ends_after_section

    def pause(self) -> None:
        """Let the scan pause after the section under way."""
        with self._may_go:
            self._paused, self._steps = True, 0

    def go_on(self) -> None:
        """Let a paused scan go on."""
        with self._may_go:
            self._paused, self._steps, self._let_go = False, 0, self._let_go + 1
            self._may_go.notify_all()

    def go_one_step(self) -> None:
        """Let the scan make one section, and pause after it."""
        with self._may_go:
            self._paused, self._steps, self._let_go = True, 1, self._let_go + 1
            self._may_go.notify_all()

    def wait_while_paused(self, announce: Callable[[], object]) -> None:
        """Wait, between two sections, until the scan may go on or shall end.

        Parameters
        ----------
        announce : callable
            Reports that the scan pauses; again if it was let go and paused again before it could
            move.
        """
        while True:
            with self._may_go:
                if not self.is_paused:
                    self._steps = 0
                    return
                before = self._let_go
            announce()
            with self._may_go:
                while self._let_go == before and self.is_paused:
                    self._may_go.wait()

    def request_stop_after_section(self) -> None:
        """Ask for an end after the section under way."""
        with self._may_go:
            self.ends_after_section = True
            self._may_go.notify_all()

    def request_stop_now(self) -> None:
        """Ask for an end now, and stop the arm."""
        self.must_stop_now = True
        self.request_stop_after_section()
        if (halt := self._halt) is not None:
            halt()

    def raise_if_stop_now(self) -> None:
        """Let nothing begin after the end was asked for now.

        Raises
        ------
        Interrupted
            If it was.
        """
        if self.must_stop_now:
            raise ScanInterrupted

    @contextmanager
    def halt_arm_on_stop_now(self, halt: Callable[[], None]) -> Iterator[None]:
        """Stop an arm by `halt` if the end is asked for now, while the block runs.

        Raises
        ------
        ScanInterrupted
            In place of the error with which the block ends then.
        """
        self._halt = halt
        try:
            yield
        except TjscanError as error:
            if self.must_stop_now:
                raise ScanInterrupted from error
            raise
        finally:
            self._halt = None
