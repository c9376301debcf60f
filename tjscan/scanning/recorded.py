"""What a scan's recording holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from tjscan.recording.journal import RunEvent
from tjscan.scanning.events import RetryCounts, ScanEvent
from tjscan.scanning.progress import StopReason
from tjscan.scanning.section import ProfileView, ScannedSection
from tjscan.scanning.sections_before import GrooveReader, read_section


@dataclass(frozen=True, slots=True, eq=False)
class RecordedScan:
    """The recording of a scan, all its parts together.

    Parameters
    ----------
    started : datetime or None
        When its first message was written, UTC; None if there is none.
    views : tuple of ProfileView
        Every profile taken, in order.
    sections : mapping of int to ScannedSection
        The finished sections by their number, in order, as they were read during the scan.
    events : tuple of RunEvent
        In order.
    """

    started: datetime | None
    views: tuple[ProfileView, ...]
    sections: Mapping[int, ScannedSection]
    events: tuple[RunEvent, ...]

    @property
    def retry_counts(self) -> RetryCounts:
        """How often each kind of retry was made."""
        return RetryCounts.of_events(event.name for event in self.events)

    @property
    def stop_reason(self) -> str:
        """Reason why the scan ended; empty if it did not."""
        last = self.events[-1] if self.events else None
        return last.detail if last is not None and last.name == ScanEvent.STOP else ""

    @property
    def stop(self) -> StopReason:
        """Why the scan ended; `StopReason.CUT` if it did not."""
        known = (reason for reason in StopReason if self.stop_reason.startswith(reason))
        return next(known, StopReason.CUT)

    def reread_sections(self, read: GrooveReader) -> tuple[ScannedSection, ...]:
        """The finished sections, read again from their profiles.

        Parameters
        ----------
        read : callable
            Turns a profile into a groove section: the reader of the scan.
        """
        found: list[ScannedSection] = []
        for one in self.sections.values():
            found.append(read_section(read, one.view, one.T_s_t, found))
        return tuple(found)
