"""What a scan keeps of its own journal: sections, views and events so far."""

from __future__ import annotations

from collections.abc import Iterable

from tjscan.recording.journal import Journal, RunEvent
from tjscan.scanning.events import RetryCounts
from tjscan.scanning.recorded import RecordedScan
from tjscan.scanning.section import ProfileView, ScannedSection


class ScanResultsJournal:
    """Journal that keeps a scan's sections, views and events, and passes all on to another.

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
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self.sections: list[ScannedSection] = []
        self.views: list[ProfileView] = []
        self._event_names: list[str] = []

    @property
    def counts(self) -> RetryCounts:
        """How often each kind of retry was made."""
        return RetryCounts.of_events(self._event_names)

    def restore_from_recording(
        self, done: RecordedScan, sections: Iterable[ScannedSection]
    ) -> None:
        """Restore sections, views and events from what was recorded before.

        Parameters
        ----------
        done : RecordedScan
            The recording.
        sections : iterable of ScannedSection
            Its finished sections, read again.
        """
        self.sections, self.views = list(sections), list(done.views)
        self._event_names = [event.name for event in done.events]

    def record(self, message: object) -> None:
        """Keep a message and pass it on."""
        match message:
            case ProfileView():
                self.views.append(message)
            case ScannedSection():
                self.sections.append(message)
            case RunEvent():
                self._event_names.append(message.name)
        self._journal.record(message)

    def record_event(self, name: str, detail: str) -> None:
        """Record an event of the scan.

        Parameters
        ----------
        name : str
            By its stable name; see `tjscan.scanning.events.ScanEvent`.
        detail : str
            The same in a sentence, with numbers.
        """
        self.record(RunEvent(name, detail))
