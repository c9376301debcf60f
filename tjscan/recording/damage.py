"""What is missing from a recording: noticed by its checksums and by the count of its messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tjscan.core.errors import RecordingError
from tjscan.recording.header import RecordingHeader


@dataclass(frozen=True, slots=True)
class RecordingDamage:
    """A damage of a recording that took messages with it.

    Parameters
    ----------
    file : Path
        The file.
    reason : str
        Where it is, and what is wrong there.
    is_at_end : bool
        Whether nothing was read behind it in this file.
    """

    file: Path
    reason: str
    is_at_end: bool

    def __str__(self) -> str:
        return f"{self.file}: is no recording, or is damaged: {self.reason}"


ReportDamage = Callable[[RecordingDamage], object]
"""Is called with each damage; what it raises ends the reading, else it goes on behind it."""


def refuse_damage(damage: RecordingDamage) -> None:
    """Raise the `RecordingError` of a damage."""
    raise RecordingError(str(damage))


class MessageCount:
    """Notices messages that are missing between those that are read, by their numbers.

    A damage of something else, such as a viewer's index, is none: no message is missing.

    Parameters
    ----------
    file : Path
        The file that is read.
    report : callable
        Is called with each damage.
    """

    def __init__(self, file: Path, report: ReportDamage) -> None:
        self._file, self._report = file, report
        self._next = 0
        self._noticed: list[str] = []

    def begin(self, header: RecordingHeader) -> None:
        """Take the number of the first message from the head of the file."""
        self._next = header.messages_before

    def notice(self, reason: str) -> None:
        """Take note of a damage, whose loss the next message shows."""
        self._noticed.append(reason)

    def count(self, number: int) -> None:
        """Take the number of a message that was read."""
        self._compare(number, is_at_end=False)
        self._next, self._noticed = number + 1, []

    def end(self, following: RecordingHeader | None) -> None:
        """Take the head of the part that follows this file; None if none does."""
        if following is not None:
            self._compare(following.messages_before, is_at_end=True)
        elif self._noticed:
            self._report_damage(self._noticed, is_at_end=True)

    def _compare(self, number: int, *, is_at_end: bool) -> None:
        if number != self._next:
            missing = number - self._next
            what = f"{missing} messages are missing" if missing > 0 else "messages come twice"
            behind = f"{what} before message {number} of the recording"
            self._report_damage([*self._noticed, behind], is_at_end=is_at_end)

    def _report_damage(self, reasons: list[str], *, is_at_end: bool) -> None:
        self._report(RecordingDamage(self._file, "; ".join(reasons), is_at_end))
