"""The recording of a scan: its topics, how they are written, and how they are read.

Viewers show Foxglove's: the frames b, f, s, t, g and j, the raw profile in frame s, the groove
as it grows, the joints and the events. Our own two hold what those have no field for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.signals import delay_ctrl_c
from tjscan.laser.profile import Profile
from tjscan.recording import foxglove
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import LOG_TOPIC, NO_ATTACHMENTS, RecordingWriter, RunEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import RecordingDamage, ReportDamage, raise_damage_error, read_messages
from tjscan.recording.topic import Topic
from tjscan.scanning.journal import RecordedScan, ScanEvent, grid_triangles
from tjscan.scanning.section import ProfileView, ScannedSection

VIEW_TOPIC: Final = Topic.of("/view", ProfileView)
"""A view without the points of its profile, which follow on `PROFILE_TOPIC`."""

SECTION_TOPIC: Final = Topic.of("/section", ScannedSection)
"""A finished section, read in the view before it. Evidence of what persists along the groove is not
recorded: it follows from the profile."""

JOINTS_TOPIC: Final = Topic.of("/joints", JointStates)
SCENE_TOPIC: Final = Topic.of("/scene", SceneUpdate)

TOPICS_READ: Final = (VIEW_TOPIC, foxglove.PROFILE_TOPIC, SECTION_TOPIC, LOG_TOPIC)
"""What is read again; the rest is for viewers."""

SCAN_TOPICS: Final = (*TOPICS_READ, foxglove.TRANSFORMS_TOPIC, JOINTS_TOPIC, SCENE_TOPIC)
"""Everything that a scan records."""


class ScanRecordingWriter(RecordingWriter):
    """The journal that writes a scan's recording; a context manager.

    Parameters
    ----------
    file, origin, attachments
        As of `RecordingWriter`.
    joint_names : sequence of str
        Names of the arm's joints in its URDF; numbers if left out.
    fixed : mapping of str to ndarray, shape (4, 4), optional
        Poses in the base frame of frames that do not move, by their names: that of j if it is
        known, and that of the URDF's root.
    """

    def __init__(
        self,
        file: Path,
        origin: JobSnapshot | None = None,
        *,
        joint_names: Sequence[str] = (),
        fixed: Mapping[str, Array] = MappingProxyType({}),
        attachments: Mapping[str, bytes] = NO_ATTACHMENTS,
    ) -> None:
        errors = (ScanEvent.FAILED, ScanEvent.INTERRUPTED)
        super().__init__(file, SCAN_TOPICS, origin, attachments, errors=errors)
        self._joint_names = joint_names
        self._last_points: Array | None = None
        if fixed:
            self._add_frames({("b", name): T for name, T in fixed.items()})

    @delay_ctrl_c()
    def record(self, message: object) -> None:
        """Write a view before it is read, an event, or a section, which is brought to the disk."""
        match message:
            case ProfileView():
                self._add_view(message)
            case ScannedSection():
                self._add_section(message)
            case RunEvent():
                self.add_event(message)
        self.flush()
        if isinstance(message, ScannedSection):
            self.sync_to_disk()

    def _add_view(self, view: ProfileView) -> None:
        self.set_time(view.time)
        names = self._joint_names or [f"joint {i + 1}" for i in range(len(view.q))]
        self.add(VIEW_TOPIC, view)
        self.add(foxglove.PROFILE_TOPIC, foxglove.profile_to_cloud_message(self.now, view.profile))
        T_f_s = inverse_pose(view.T_b_f) @ view.T_b_s
        self._add_frames({("b", "f"): view.T_b_f, ("f", "s"): T_f_s})
        self.add(JOINTS_TOPIC, foxglove.joint_states_message(self.now, names, view.q))

    def _add_section(self, section: ScannedSection) -> None:
        points, surface = section.points_b, np.empty((0, 3, 3))
        if self._last_points is not None:
            strip = np.concatenate((self._last_points, points))
            surface = strip[grid_triangles(2, len(points))]
        name = f"section {section.view.index}"
        self.add(SECTION_TOPIC, replace(section, groove=replace(section.groove, evidence=None)))
        self._add_frames({("s", "t"): section.T_s_t, ("b", "g"): section.T_b_g})
        self.add(SCENE_TOPIC, foxglove.line_and_surface_message(self.now, name, points, surface))
        self._last_points = points

    def _add_frames(self, frames: Mapping[tuple[str, str], Array]) -> None:
        self.add(foxglove.TRANSFORMS_TOPIC, foxglove.frame_transforms_message(self.now, frames))


Entry = ProfileView | ScannedSection | RunEvent

RIGID_MOUNT_TOLERANCE: Final = 1e-6
"""Metres, and entries of a rotation: how far the sensor's pose on the flange, written to the last
digit, may differ between two views."""


def read_recorded_scan(
    directory: Path, report_damage: ReportDamage = raise_damage_error
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
    file: Path, report_damage: ReportDamage = raise_damage_error
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
            if apart > RIGID_MOUNT_TOLERANCE:
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
        elif entry.topic is foxglove.PROFILE_TOPIC:
            if pending is None:
                raise RecordingError(
                    f"{file}: is damaged: a profile on /profile has no message on /view before it"
                )
            try:
                profile = foxglove.profile_from_cloud_message(message, pending.profile)
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
