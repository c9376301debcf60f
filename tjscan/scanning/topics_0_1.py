"""The recordings of version 0.1.0: JSON messages whose flange and profile make a view."""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array, inverse_pose, pose
from tjscan.laser.profile import Profile
from tjscan.recording.damage import ReportDamage, refuse_damage
from tjscan.recording.event import RecordedEvent
from tjscan.recording.json_numbers import to_finite_floats
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import Topic, make_json_topic
from tjscan.scanning.recorded import RecordedSection
from tjscan.scanning.section import ProfileView, Substep
from tjscan.scanning.topics import parse_section_number

UNNORMALISED: Final = 1e-6
"""A quaternion whose length is further from one is not one."""


def _old(name: str, schema: str) -> Topic[dict[str, Any]]:
    return make_json_topic(name, schema, {}, dict, dict)


FLANGE: Final = _old("/flange", "foxglove.PoseInFrame")
PROFILE: Final = _old("/profile", "foxglove.PointCloud")
SECTION: Final = _old("/section", "tjscan.Section")
EVENT: Final = _old("/event", "tjscan.Event")


def read_file_entries_0_1(
    file: Path, report_damage: ReportDamage = refuse_damage
) -> Iterator[tuple[datetime, ProfileView | RecordedSection | RecordedEvent]]:
    """Yield time and content of each view, section and event of a file of version 0.1.0.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    flange: dict[str, Any] = {}
    view: ProfileView | None = None
    for entry in read_messages(file, (FLANGE, PROFILE, SECTION, EVENT), report_damage):
        when, message = entry.when, entry.message
        try:
            if entry.topic is FLANGE:
                flange = message
            elif entry.topic is PROFILE:
                view = _view(flange, message)
                yield when, view
            elif entry.topic is SECTION:
                yield when, _section(view, message)
            else:
                yield when, RecordedEvent(when, str(message["name"]), str(message["detail"]))
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            raise RecordingError(
                f"{file}: is no recording, or is damaged: {entry.topic.name}: {error!r}"
            ) from error


def _view(flange: dict[str, Any], profile: dict[str, Any]) -> ProfileView:
    table = np.frombuffer(b64decode(profile["data"])).reshape(-1, len(profile["fields"]))
    columns = {field["name"]: table[:, i] for i, field in enumerate(profile["fields"])}
    index = parse_section_number(profile["index"])
    if index != flange["index"]:
        raise ValueError(f"a profile of section {index} after a pose of section {flange['index']}")
    (time,) = to_finite_floats((profile["arm_time"],))
    return ProfileView(
        index=index,
        substep=Substep(profile["substep"]),
        T_b_f=_pose(flange["pose"]),
        T_b_s=_pose(profile["pose"]),
        profile=Profile(columns["x"], columns["z"], columns.get("intensity"), time),
        time=time,
        q=np.array(to_finite_floats(flange["q"])),
    )


def _section(view: ProfileView | None, message: dict[str, Any]) -> RecordedSection:
    if view is None or view.index != message["index"]:
        raise ValueError("a section without its view")
    T_b_g, T_b_t = (_pose(message[name]) for name in ("T_b_g", "T_b_t"))
    points_b = np.array(
        [to_finite_floats(point[axis] for axis in "xyz") for point in message["points"]]
    )
    return RecordedSection(view, inverse_pose(view.T_b_s) @ T_b_t, T_b_g, points_b)


def _pose(message: dict[str, dict[str, float]]) -> Array:
    quaternion = to_finite_floats(message["orientation"][axis] for axis in "xyzw")
    position = to_finite_floats(message["position"][axis] for axis in "xyz")
    if not abs(np.linalg.norm(quaternion) - 1) < UNNORMALISED:
        raise ValueError(f"a quaternion of length {np.linalg.norm(quaternion):.3g}")
    return pose(Rotation.from_quat(quaternion).as_matrix(), position)
