"""The protocol that every line laser, real or simulated, fulfils."""

from __future__ import annotations

from types import TracebackType
from typing import Protocol, Self

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.laser.profile import Profile


class LineLaser(Protocol):
    """A line laser on the arm's hand. It is a context manager: entering connects it."""

    def __enter__(self) -> Self:
        """Connect."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Disconnect."""
        ...

    @property
    def identity(self) -> DeviceIdentity:
        """Which laser it is; known while connected."""
        ...

    def report_events_to(self, listener: EventListener) -> None:
        """Report events to a listener from now on."""
        ...

    def capture(self) -> Profile:
        """Take one profile with the arm at rest, now: one that waits in a buffer is late.

        Raises
        ------
        LaserFault
            If no profile came.
        """
        ...
