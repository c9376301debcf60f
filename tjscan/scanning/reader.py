"""Reading the recording of a scan."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array, inverse_pose
from tjscan.laser.profile import Profile
from tjscan.recording.foxglove import PROFILE_TOPIC, profile_from_cloud_message
from tjscan.recording.journal import RunEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import RecordingDamage, ReportDamage, read_messages, refuse_damage
from tjscan.scanning.recorded import RecordedScan
from tjscan.scanning.section import ProfileView, ScannedSection
from tjscan.scanning.topics import SECTION_TOPIC, TOPICS_READ, VIEW_TOPIC

Entry = ProfileView | ScannedSection | RunEvent

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
        Is called with each damage, so that what is left can be read; without it the first is
        refused.

    Raises
    ------
    ConfigurationError
        If there is none.
    RecordingError
        If it is of another program or format, or is damaged. One that was cut off ends at the
        cut.
    """
    started: datetime | None = None
    views: list[ProfileView] = []
    sections: dict[int, ScannedSection] = {}
    events: list[RunEvent] = []
    for file in recording_files(directory):
        for time, entry in read_recording_entries(file, report_damage):
            started = started or time
            match entry:
                case ProfileView():
                    views.append(entry)
                case ScannedSection():
                    sections[entry.view.index] = entry
                case RunEvent():
                    events.append(entry)
    return RecordedScan(started, tuple(views), MappingProxyType(sections), tuple(events))


def read_recording_entries(
    file: Path, report_damage: ReportDamage = refuse_damage
) -> Iterator[tuple[datetime, Entry]]:
    """Yield time and content of each view, section and event of a recording.

    The sensor sits on the flange as it did in the file's other views; a view that contradicts them
    is damaged, and so is a section that was read in it.
    """
    entries = list(_read_entries(file, report_damage))
    poses = np.array([_sensor_on_flange(e) for _, e in entries if isinstance(e, ProfileView)])
    T_f_s = np.median(poses, axis=0) if len(poses) else np.eye(4)
    for time, entry in entries:
        view = entry.view if isinstance(entry, ScannedSection) else entry
        if isinstance(view, ProfileView):
            apart = float(np.abs(_sensor_on_flange(view) - T_f_s).max())
            if apart > RIGID_TOLERANCE:
                what = "section" if isinstance(entry, ScannedSection) else "view of section"
                reason = (
                    f"in a {what} {view.index} the poses of flange and sensor contradict each "
                    f"other by {1e3 * apart:.3g} mm"
                )
                report_damage(RecordingDamage(file, reason, is_at_end=False))
                continue
        yield time, entry


def _read_entries(file: Path, report_damage: ReportDamage) -> Iterator[tuple[datetime, Entry]]:
    """Time and content of each entry of a file; a section whose own view is damaged is so, too."""
    view: ProfileView | None = None
    pending: ProfileView | None = None

    def forget_view(damage: RecordingDamage) -> None:
        nonlocal view, pending
        view = pending = None
        report_damage(damage)

    for entry in read_messages(file, TOPICS_READ, forget_view):
        when, message = entry.when, entry.message
        if entry.topic is VIEW_TOPIC:
            pending = message
        elif entry.topic is PROFILE_TOPIC:
            if pending is None:
                raise RecordingError(
                    f"{file}: is damaged: a profile on /profile has no message on /view before it"
                )
            try:
                profile = profile_from_cloud_message(message, pending.profile)
            except (KeyError, ValueError) as error:
                raise RecordingError(f"{file}: is damaged: {error}") from error
            view, pending = replace(pending, profile=profile), None
            yield when, view
        elif entry.topic is SECTION_TOPIC:
            index = message.view.index
            if view is None or view.index != index:
                lost = f"section {index} has no view of its number before it"
                report_damage(RecordingDamage(file, lost, is_at_end=False))
                continue
            yield when, replace(message, view=view)
        else:
            yield when, RunEvent.of_log(entry)


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
