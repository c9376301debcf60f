"""What a scan's recording holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from math import nan

from tjscan.core.frames import Array
from tjscan.recording.event import RecordedEvent
from tjscan.scanning.events import RetryCounts, ScanEvent
from tjscan.scanning.progress import StopReason
from tjscan.scanning.section import ProfileView, ScannedSection
from tjscan.scanning.sections_before import GrooveReader, read_section


@dataclass(frozen=True, slots=True, eq=False)
class RecordedSection:
    """A section that a scan finished.

    Parameters
    ----------
    view : ProfileView
        The view that it was read in.
    T_s_t : ndarray, shape (4, 4)
        Frame t in the sensor.
    T_b_g : ndarray, shape (4, 4)
        Frame g in the base frame, as it was read during the scan.
    points_b : ndarray, shape (5, 3)
        The five points in the base frame, metres, as they were read during the scan.
    model : str
        The form of groove; empty where a file of an earlier version does not hold it.
    conditions : tuple of str
        What was found about the groove, such as ``tack``.
    absent : tuple of str
        Corners that are buried, not there or not seen.
    root_opening : float
        Distance of an open root's edge from the leg, metres; NaN where the root is not open.
    """

    view: ProfileView
    T_s_t: Array
    T_b_g: Array
    points_b: Array
    model: str = ""
    conditions: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    root_opening: float = nan


@dataclass(frozen=True, slots=True, eq=False)
class RecordedScan:
    """The recording of a scan, all its parts together.

    Parameters
    ----------
    started : datetime or None
        When its first message was written, UTC; None where there is none.
    views : tuple of ProfileView
        Every profile taken, in order.
    sections : mapping of int to RecordedSection
        The finished sections by their number, in order.
    events : tuple of RecordedEvent
        In order.
    """

    started: datetime | None
    views: tuple[ProfileView, ...]
    sections: Mapping[int, RecordedSection]
    events: tuple[RecordedEvent, ...]

    @property
    def retry_counts(self) -> RetryCounts:
        """How often each kind of retry was made."""
        counts = RetryCounts()
        for event in self.events:
            counts = counts.with_one_more(event.name)
        return counts

    @property
    def stop_reason(self) -> str:
        """Reason why the scan ended; empty where it did not."""
        last = self.events[-1] if self.events else None
        return last.detail if last is not None and last.name == ScanEvent.STOP else ""

    @property
    def stop(self) -> StopReason:
        """Why the scan ended; `StopReason.CUT` where it did not."""
        known = (reason for reason in StopReason if self.stop_reason.startswith(reason))
        return next(known, StopReason.CUT)

    def reread_sections(self, read: GrooveReader) -> tuple[ScannedSection, ...]:
        """The finished sections, read once more from their profiles.

        Parameters
        ----------
        read : callable
            Turns a profile into a groove section: the reader of the scan.
        """
        found: list[ScannedSection] = []
        for one in self.sections.values():
            found.append(read_section(read, one.view, one.T_s_t, found))
        return tuple(found)
