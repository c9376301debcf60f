"""Reading the recording of a scan."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from types import MappingProxyType

from tjscan.laser.profile import Profile
from tjscan.recording.reader import read_header
from tjscan.recording.writer import recording_files
from tjscan.scanning.recorded import RecordedEvent, RecordedScan, RecordedSection
from tjscan.scanning.section import ProfileView
from tjscan.scanning.topics import read_file_entries as read_newest
from tjscan.scanning.topics_0_1 import read_file_entries_0_1


def read_recorded_scan(directory: Path) -> RecordedScan:
    """Read the recording of a run directory, all its parts together.

    Raises
    ------
    ConfigurationError
        If there is none.
    RecordingError
        If it is of another program or of a newer version, or is damaged. One that was cut off
        ends where it was cut.
    """
    started: datetime | None = None
    views: list[ProfileView] = []
    sections: dict[int, RecordedSection] = {}
    events: list[RecordedEvent] = []
    for file in recording_files(directory):
        for time, entry in read_recording_entries(file):
            started = started or time
            match entry:
                case ProfileView():
                    views.append(entry)
                case RecordedSection():
                    sections[entry.view.index] = entry
                case RecordedEvent():
                    events.append(entry)
    return RecordedScan(started, tuple(views), MappingProxyType(sections), tuple(events))


def read_recording_entries(
    file: Path,
) -> Iterator[tuple[datetime, ProfileView | RecordedSection | RecordedEvent]]:
    """Yield time and content of each view, section and event of a recording, any version."""
    head = read_header(file)
    return (
        read_file_entries_0_1(file) if head is not None and head.format == 1 else read_newest(file)
    )


def read_views(path: Path) -> Iterator[ProfileView]:
    """Yield every view of a run directory, or of one file; raises as `read_recorded_scan` does."""
    for file in recording_files(path) if path.is_dir() else (path,):
        for _, entry in read_recording_entries(file):
            if isinstance(entry, ProfileView):
                yield entry


def load_profiles_of_run(directory: Path) -> dict[str, Profile]:
    """Every profile of a run directory, by section and substep; see `read_recorded_scan`."""
    return {
        f"profile {number}: section {view.index}, {view.substep}": view.profile
        for number, view in enumerate(read_views(directory), start=1)
    }
