"""The topics of a scan, and the journal that writes to them.

Viewers show Foxglove's: the frames b, f, s, t, g and j, the raw profile in frame s, the groove
as it grows, the joints and the events. The two of our own hold what those have no field for.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from math import isnan, nan
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array, inverse_pose, readonly_copy
from tjscan.laser.profile import Profile
from tjscan.recording.damage import RecordingDamage, ReportDamage, refuse_damage
from tjscan.recording.event import RecordedEvent
from tjscan.recording.foxglove import (
    event_log_message,
    frame_transforms_message,
    joint_states_message,
    line_and_surface_message,
    profile_from_cloud_message,
    profile_to_cloud_message,
)
from tjscan.recording.header import JobSnapshot
from tjscan.recording.json_numbers import pose_from_list, pose_to_list, to_finite_floats
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import (
    INTEGER_SCHEMA,
    NUMBER_SCHEMA,
    NUMBERS_SCHEMA,
    TEXT_SCHEMA,
    TEXTS_SCHEMA,
    Topic,
    make_json_topic,
    make_protobuf_topic,
)
from tjscan.recording.writer import NO_ATTACHMENTS, RecordingWriter
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.recorded import RecordedSection
from tjscan.scanning.section import ProfileView, ScannedSection, Substep

MOST_SECTIONS: Final = 1_000_000
CORNERS: Final = 5

_NO_PROFILE: Final = Profile(np.empty(0), np.empty(0))
_LEVELS: Final[Mapping[str, Log.Level.ValueType]] = {
    ScanEvent.FAILED: Log.Level.ERROR,
    ScanEvent.INTERRUPTED: Log.Level.ERROR,
}
"""How grave an event is; what is not named here is information."""


@dataclass(frozen=True, slots=True, eq=False)
class SectionRecord:
    """Message that records a finished section.

    Parameters
    ----------
    index : int
        Its number.
    T_s_t, T_b_g : ndarray, shape (4, 4)
        Frame t in the sensor and frame g in the base frame.
    points_b : ndarray, shape (5, 3)
        The five points in the base frame, metres.
    model, conditions, absent, root_opening
        As of `RecordedSection`.
    """

    index: int
    T_s_t: Array
    T_b_g: Array
    points_b: Array
    model: str = ""
    conditions: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    root_opening: float = nan


def _from_view(view: ProfileView) -> dict[str, Any]:
    return {
        "index": view.index,
        "substep": str(view.substep),
        "arm_time": view.time,
        "q": view.q.tolist(),
        "T_b_f": pose_to_list(view.T_b_f),
        "T_b_s": pose_to_list(view.T_b_s),
        "profile_time": view.profile.time,
        "profile_time_uncertainty": view.profile.time_uncertainty,
    }


def _to_view(fields: dict[str, Any]) -> ProfileView:
    (arm_time,) = to_finite_floats((fields["arm_time"],))
    # Files of earlier versions lack the profile's own time.
    exposed, uncertainty = to_finite_floats(
        (fields.get("profile_time", arm_time), fields.get("profile_time_uncertainty", 0.0))
    )
    return ProfileView(
        index=parse_section_number(fields["index"]),
        substep=Substep(fields["substep"]),
        T_b_f=pose_from_list(fields["T_b_f"]),
        T_b_s=pose_from_list(fields["T_b_s"]),
        profile=replace(_NO_PROFILE, time=exposed, time_uncertainty=uncertainty),
        time=arm_time,
        q=np.array(to_finite_floats(fields["q"])),
    )


def _from_section(section: SectionRecord) -> dict[str, Any]:
    return {
        "index": section.index,
        "T_s_t": pose_to_list(section.T_s_t),
        "T_b_g": pose_to_list(section.T_b_g),
        "points_b": section.points_b.ravel().tolist(),
        "model": section.model,
        "conditions": list(section.conditions),
        "absent": list(section.absent),
        "root_opening": [] if isnan(section.root_opening) else [section.root_opening],
    }


def _to_section(fields: dict[str, Any]) -> SectionRecord:
    return SectionRecord(
        parse_section_number(fields["index"]),
        pose_from_list(fields["T_s_t"]),
        pose_from_list(fields["T_b_g"]),
        readonly_copy(np.reshape(to_finite_floats(fields["points_b"]), (CORNERS, 3))),
        # Files of earlier versions lack these.
        str(fields.get("model", "")),
        tuple(map(str, fields.get("conditions", ()))),
        tuple(map(str, fields.get("absent", ()))),
        next(iter(to_finite_floats(fields.get("root_opening", ()))), nan),
    )


def parse_section_number(value: Any) -> int:
    """The number of a section; raises ValueError where it is none."""
    if type(value) is not int or not 0 <= value <= MOST_SECTIONS:
        raise ValueError(f"{value!r} is no number of a section")
    return value


VIEW: Final = make_json_topic(
    "/view",
    "tjscan.View",
    {
        "index": INTEGER_SCHEMA,
        "substep": TEXT_SCHEMA,
        "arm_time": NUMBER_SCHEMA,
        "q": NUMBERS_SCHEMA,
        "T_b_f": NUMBERS_SCHEMA,
        "T_b_s": NUMBERS_SCHEMA,
        "profile_time": NUMBER_SCHEMA,
        "profile_time_uncertainty": NUMBER_SCHEMA,
    },
    _from_view,
    _to_view,
)
"""A view without its profile, which follows on `PROFILE`; poses row by row."""

SECTION: Final = make_json_topic(
    "/section",
    "tjscan.Section",
    {
        "index": INTEGER_SCHEMA,
        "T_s_t": NUMBERS_SCHEMA,
        "T_b_g": NUMBERS_SCHEMA,
        "points_b": NUMBERS_SCHEMA,
        "model": TEXT_SCHEMA,
        "conditions": TEXTS_SCHEMA,
        "absent": TEXTS_SCHEMA,
        "root_opening": NUMBERS_SCHEMA,
    },
    _from_section,
    _to_section,
)
PROFILE: Final = make_protobuf_topic("/profile", PointCloud)
TRANSFORMS: Final = make_protobuf_topic("/tf", FrameTransforms)
JOINTS: Final = make_protobuf_topic("/joints", JointStates)
SCENE: Final = make_protobuf_topic("/scene", SceneUpdate)
LOG: Final = make_protobuf_topic("/log", Log)

TOPICS: Final[tuple[Topic[Any], ...]] = (VIEW, PROFILE, SECTION, LOG, TRANSFORMS, JOINTS, SCENE)
"""Everything that a scan records."""

READ: Final[tuple[Topic[Any], ...]] = (VIEW, PROFILE, SECTION, LOG)
"""What is read again; the rest is for viewers."""


class RecordingJournal:
    """The journal that writes a scan's recording.

    Parameters
    ----------
    recording : Recording
        Open, with `TOPICS`.
    joint_names : sequence of str
        Names of the arm's joints in its URDF; numbers where left out.
    fixed : mapping of str to ndarray, shape (4, 4), optional
        Poses in the base frame of frames that do not move, by their names: that of j where it
        is known, and that of the URDF's root.
    """

    def __init__(
        self,
        recording: RecordingWriter,
        joint_names: Sequence[str] = (),
        fixed: Mapping[str, Array] = MappingProxyType({}),
    ) -> None:
        self._recording, self._joint_names = recording, joint_names
        self._start = self._now = time.time_ns()
        self._arm_start: float | None = None
        self._last: Array | None = None
        if fixed:
            frames = {("b", name): T for name, T in fixed.items()}
            recording.write(self._now, (TRANSFORMS, frame_transforms_message(self._now, frames)))

    def record_view(self, view: ProfileView) -> None:
        """Write where the arm stood and the raw profile, before anybody tries to read it."""
        if self._arm_start is None:  # a real arm's clock began when it was switched on
            self._arm_start = view.time
        now = self._now = self._start + round(1e9 * (view.time - self._arm_start))
        T_f_s = inverse_pose(view.T_b_f) @ view.T_b_s
        names = self._joint_names or [f"joint {i + 1}" for i in range(len(view.q))]
        self._recording.write(
            now,
            (VIEW, view),
            (PROFILE, profile_to_cloud_message(now, view.profile)),
            (
                TRANSFORMS,
                frame_transforms_message(now, {("b", "f"): view.T_b_f, ("f", "s"): T_f_s}),
            ),
            (JOINTS, joint_states_message(now, names, view.q)),
        )

    def record_section(self, scan: ScannedSection) -> None:
        """Write a finished section and bring all of it to the disk."""
        now, points, groove = self._now, scan.points_b, scan.groove
        record = SectionRecord(
            scan.view.index,
            scan.T_s_t,
            scan.T_b_g,
            points,
            groove.model,
            groove.conditions,
            groove.absent,
            groove.root_opening,
        )
        frames = {("s", "t"): scan.T_s_t, ("b", "g"): scan.T_b_g}
        surface = np.empty((0, 3, 3)) if self._last is None else _between(self._last, points)
        self._recording.write(
            now,
            (SECTION, record),
            (TRANSFORMS, frame_transforms_message(now, frames)),
            (SCENE, line_and_surface_message(now, f"section {scan.view.index}", points, surface)),
        )
        self._last = points
        self._recording.sync_to_disk()

    def record_event(self, name: str, detail: str) -> None:
        """Write what happened out of the ordinary."""
        level = _LEVELS.get(name, Log.Level.INFO)
        self._recording.write(self._now, (LOG, event_log_message(self._now, level, name, detail)))


@contextmanager
def record_scan(
    file: Path,
    origin: JobSnapshot | None = None,
    *,
    joint_names: Sequence[str] = (),
    fixed: Mapping[str, Array] = MappingProxyType({}),
    attachments: Mapping[str, bytes] = NO_ATTACHMENTS,
) -> Iterator[RecordingJournal]:
    """Record a scan into a new file while the block runs.

    Parameters
    ----------
    file, origin, attachments
        As of `RecordingWriter`.
    joint_names, fixed
        As of `RecordingJournal`.

    Raises
    ------
    RecordingError
        On entering or writing, if the file can't be written.
    """
    with RecordingWriter(file, TOPICS, origin, attachments) as recording:
        yield RecordingJournal(recording, joint_names, fixed)


def read_file_entries(
    file: Path, report_damage: ReportDamage = refuse_damage
) -> Iterator[tuple[datetime, ProfileView | RecordedSection | RecordedEvent]]:
    """Yield time and content of each view, section and event of one file.

    A section whose own view is damaged is so, too.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    view: ProfileView | None = None
    pending: ProfileView | None = None

    def forget_view(damage: RecordingDamage) -> None:
        nonlocal view, pending
        view = pending = None
        report_damage(damage)

    for entry in read_messages(file, READ, forget_view):
        when, message = entry.when, entry.message
        try:
            if entry.topic is VIEW:
                pending = message
            elif entry.topic is PROFILE:
                if pending is None:
                    raise ValueError("a profile on /profile has no message on /view before it")
                clock = pending.profile
                taken = profile_from_cloud_message(message, clock.time)
                taken = replace(taken, time_uncertainty=clock.time_uncertainty)
                view = replace(pending, profile=taken)
                pending = None
                yield when, view
            elif entry.topic is SECTION:
                if view is None or view.index != message.index:
                    lost = f"section {message.index} has no view of its number before it"
                    report_damage(RecordingDamage(file, lost, is_at_end=False))
                    continue
                yield (
                    when,
                    RecordedSection(
                        view,
                        message.T_s_t,
                        message.T_b_g,
                        message.points_b,
                        message.model,
                        message.conditions,
                        message.absent,
                        message.root_opening,
                    ),
                )
            else:
                yield when, RecordedEvent(when, message.name, message.message)
        except (KeyError, ValueError) as error:
            raise RecordingError(f"{file}: is damaged: {error}") from error


def _between(one: Array, other: Array) -> Array:
    """Triangles of the strip between two polylines of as many points, shape (2 (n - 1), 3, 3)."""
    a, b, c, d = one[:-1], one[1:], other[:-1], other[1:]
    return np.concatenate((np.stack((a, b, c), axis=1), np.stack((b, d, c), axis=1)))
