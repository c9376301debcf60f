"""Asking a scan to stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tjscan.core.errors import ScanInterrupted


class StopRequest:
    """Asks a scan to stop, from another thread: after the section under way, or at once."""

    def __init__(self) -> None:
        self._wanted = self._at_once = False
        self._halt: Callable[[], None] | None = None

    @property
    def ends_after_section(self) -> bool:
        """Whether the scan shall end after the section under way."""
        return self._wanted

    @property
    def must_stop_now(self) -> bool:
        """Whether nothing shall move any more."""
        return self._at_once

    @property
    def scan_is_running(self) -> bool:
        """Whether a scan is under way that looks at this request."""
        return self._halt is not None

    def request_stop_after_section(self) -> None:
        """Ask for an end after the section under way."""
        self._wanted = True

    def request_stop_now(self) -> None:
        """Ask for an end now, and stop the arm."""
        self._wanted = self._at_once = True
        if (halt := self._halt) is not None:
            halt()

    def raise_if_stop_now(self) -> None:
        """Let nothing begin after the end was asked for now.

        Raises
        ------
        Interrupted
            If it was.
        """
        if self._at_once:
            raise ScanInterrupted

    @contextmanager
    def halt_arm_on_stop_now(self, halt: Callable[[], None]) -> Iterator[None]:
        """Stop an arm by `halt` where the end is asked for now, while the block runs."""
        self._halt = halt
        try:
            yield
        finally:
            self._halt = None
