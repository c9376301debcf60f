"""Reading the recording of a scan."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from tjscan.core.frames import Array, inverse_pose
from tjscan.laser.profile import Profile
from tjscan.recording.damage import RecordingDamage, ReportDamage, refuse_damage
from tjscan.recording.event import RecordedEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_header
from tjscan.scanning.recorded import RecordedScan, RecordedSection
from tjscan.scanning.section import ProfileView
from tjscan.scanning.topics import read_file_entries as read_newest
from tjscan.scanning.topics_0_1 import read_file_entries_0_1

Entry = ProfileView | RecordedSection | RecordedEvent

RIGID_TOLERANCE: Final = 1e-6
"""Metres, and entries of a rotation: how far the sensor's pose on the flange, written to the last
digit, may differ between two views."""


def read_recorded_scan(
    directory: Path, report_damage: ReportDamage = refuse_damage
) -> RecordedScan:
    """Read the recording of a run directory, all its parts together.

    Parameters
    ----------
    directory : Path
        The run directory.
    report_damage : callable
        Is called with each damage, where what is left is to be read; without it the first is
        refused.

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
        for time, entry in read_recording_entries(file, report_damage):
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
    file: Path, report_damage: ReportDamage = refuse_damage
) -> Iterator[tuple[datetime, Entry]]:
    """Yield time and content of each view, section and event of a recording, any version.

    The sensor sits on the flange as it did in the file's other views; a view that contradicts this
    is damaged, and so is a section that was read in it.
    """
    head = read_header(file)
    is_old = head is not None and head.format == 1
    entries = list((read_file_entries_0_1 if is_old else read_newest)(file, report_damage))
    poses = np.array([_sensor_on_flange(e) for _, e in entries if isinstance(e, ProfileView)])
    T_f_s = np.median(poses, axis=0) if len(poses) else np.eye(4)
    for time, entry in entries:
        view = entry.view if isinstance(entry, RecordedSection) else entry
        if isinstance(view, ProfileView):
            apart = float(np.abs(_sensor_on_flange(view) - T_f_s).max())
            if apart > RIGID_TOLERANCE:
                what = "section" if isinstance(entry, RecordedSection) else "view of section"
                reason = (
                    f"in a {what} {view.index} the poses of flange and sensor contradict each "
                    f"other by {1e3 * apart:.3g} mm"
                )
                report_damage(RecordingDamage(file, reason, is_at_end=False))
                continue
        yield time, entry


def _sensor_on_flange(view: ProfileView) -> Array:
    return inverse_pose(view.T_b_f) @ view.T_b_s


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
