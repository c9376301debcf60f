"""The topics of a scan, and the journal that writes to them.

Viewers show Foxglove's: the frames b, f, s, t, g and j, the raw profile in frame s, the groove
as it grows, the joints and the events. Our own two hold what those have no field for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from tjscan.core.frames import Array, inverse_pose
from tjscan.core.signals import hold_ctrl_c
from tjscan.recording.foxglove import (
    PROFILE_TOPIC,
    TRANSFORMS_TOPIC,
    frame_transforms_message,
    joint_states_message,
    line_and_surface_message,
    profile_to_cloud_message,
)
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import LOG_TOPIC, RecordingJournal, RunEvent
from tjscan.recording.topic import Topic
from tjscan.recording.writer import NO_ATTACHMENTS
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.journal import grid_triangles
from tjscan.scanning.section import ProfileView, ScannedSection

VIEW_TOPIC: Final = Topic.of("/view", ProfileView)
"""A view without the points of its profile, which follow on `PROFILE_TOPIC`."""

SECTION_TOPIC: Final = Topic.of("/section", ScannedSection)
"""A finished section, read in the view before it. Evidence of what persists along the groove is not
recorded: it follows from the profile."""

JOINTS_TOPIC: Final = Topic.of("/joints", JointStates)
SCENE_TOPIC: Final = Topic.of("/scene", SceneUpdate)

TOPICS_READ: Final[tuple[Topic[Any], ...]] = (VIEW_TOPIC, PROFILE_TOPIC, SECTION_TOPIC, LOG_TOPIC)
"""What is read again; the rest is for viewers."""

SCAN_TOPICS: Final = (*TOPICS_READ, TRANSFORMS_TOPIC, JOINTS_TOPIC, SCENE_TOPIC)
"""Everything that a scan records."""


class ScanRecording(RecordingJournal):
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

    @hold_ctrl_c()
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
        self.add(PROFILE_TOPIC, profile_to_cloud_message(self.now, view.profile))
        T_f_s = inverse_pose(view.T_b_f) @ view.T_b_s
        self._add_frames({("b", "f"): view.T_b_f, ("f", "s"): T_f_s})
        self.add(JOINTS_TOPIC, joint_states_message(self.now, names, view.q))

    def _add_section(self, section: ScannedSection) -> None:
        points, surface = section.points_b, np.empty((0, 3, 3))
        if self._last_points is not None:
            strip = np.concatenate((self._last_points, points))
            surface = strip[grid_triangles(2, len(points))]
        name = f"section {section.view.index}"
        self.add(SECTION_TOPIC, replace(section, groove=replace(section.groove, evidence=None)))
        self._add_frames({("s", "t"): section.T_s_t, ("b", "g"): section.T_b_g})
        self.add(SCENE_TOPIC, line_and_surface_message(self.now, name, points, surface))
        self._last_points = points

    def _add_frames(self, frames: Mapping[tuple[str, str], Array]) -> None:
        self.add(TRANSFORMS_TOPIC, frame_transforms_message(self.now, frames))
