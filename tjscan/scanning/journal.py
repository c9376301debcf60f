"""What a scan reports while it runs, to whoever writes it down or shows it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from tjscan.scanning.events import RetryCounts
from tjscan.scanning.recorded import RecordedScan
from tjscan.scanning.section import ProfileView, ScannedSection


class Journal(Protocol):
    """Receives every profile, section and event of a scan at once, in the order they happen."""

    def record_view(self, view: ProfileView) -> None:
        """Note that a profile was taken, before it is read."""
        ...

    def record_section(self, section: ScannedSection) -> None:
        """Note that a section is finished."""
        ...

    def record_event(self, name: str, detail: str) -> None:
        """Note that something out of the ordinary happened.

        Parameters
        ----------
        name : str
            What, by its stable name; see `tjscan.scanning.events.ScanEvent`.
        detail : str
            The same in a sentence, with numbers.
        """
        ...


class CombinedJournal:
    """Passes everything on to several journals, in their order.

    Parameters
    ----------
    *journals : Journal
        The one that writes to disk comes first.
    """

    def __init__(self, *journals: Journal) -> None:
        self._journals = journals

    def record_view(self, view: ProfileView) -> None:
        """Pass a profile on."""
        for journal in self._journals:
            journal.record_view(view)

    def record_section(self, section: ScannedSection) -> None:
        """Pass a section on."""
        for journal in self._journals:
            journal.record_section(section)

    def record_event(self, name: str, detail: str) -> None:
        """Pass an event on; for the parameters see `Journal.record_event`."""
        for journal in self._journals:
            journal.record_event(name, detail)


class ScanResultsJournal:
    """Journal that keeps a scan's sections, views and counts, and passes all on to another.

    Parameters
    ----------
    journal : Journal
        Receives everything next.

    Attributes
    ----------
    sections : list of ScannedSection
        The finished sections in order.
    views : list of ProfileView
        Every profile taken, in order.
    counts : RetryCounts
        How often each kind of retry was made.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self.sections: list[ScannedSection] = []
        self.views: list[ProfileView] = []
        self.counts = RetryCounts()

    def restore_from_recording(
        self, done: RecordedScan, sections: Iterable[ScannedSection]
    ) -> None:
        """Restore sections, views and counts from what was recorded before.

        Parameters
        ----------
        done : RecordedScan
            The recording.
        sections : iterable of ScannedSection
            Its finished sections, read once more.
        """
        self.sections, self.views = list(sections), list(done.views)
        self.counts = done.retry_counts

    def record_view(self, view: ProfileView) -> None:
        """Keep a profile and pass it on."""
        self.views.append(view)
        self._journal.record_view(view)

    def record_section(self, section: ScannedSection) -> None:
        """Keep a section and pass it on."""
        self.sections.append(section)
        self._journal.record_section(section)

    def record_event(self, name: str, detail: str) -> None:
        """Count an event and pass it on; for the parameters see `Journal.record_event`."""
        self.counts = self.counts.with_one_more(name)
        self._journal.record_event(name, detail)
