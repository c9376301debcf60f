"""The topics of a calibration: what was touched, seen and passed over."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from tjscan.calibration.posed_profile import PosedProfile
from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array
from tjscan.laser.profile import Profile
from tjscan.recording.foxglove import frame_transforms, profile_cloud, read_profile
from tjscan.recording.numbers import from_pose, to_pose
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import FLAG, INTEGER, NUMBERS, TEXT, Topic, json_topic, protobuf_topic
from tjscan.recording.writer import parts

MEASURED: Final = "measured"
"""Kind of the recording: it is in ``measured.mcap``, and in a further part for each resume."""

_NO_PROFILE: Final = Profile(np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True)
class Begun:
    """When somebody began, or went on."""

    date: datetime


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """The board was touched.

    Parameters
    ----------
    place : int
        Which of the planned places; a later touch of the same place replaces the earlier one.
    T_b_f : ndarray, shape (4, 4)
        Flange pose with the tip on the board; none where the place was passed over.
    """

    place: int
    T_b_f: Array | None


@dataclass(frozen=True, slots=True)
class Line:
    """A line was taken; a fresh one takes no part in the calibration but verifies it."""

    shot: PosedProfile
    fresh: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Passed:
    """A pose was passed over, and why."""

    T_b_f: Array
    reason: str


Entry = Begun | Touch | Line | Passed


def _to_touch(fields: dict[str, Any]) -> Touch:
    T_b_f = fields["T_b_f"]
    return Touch(int(fields["place"]), to_pose(T_b_f) if T_b_f else None)


def _to_line(fields: dict[str, Any]) -> Line:
    shot = PosedProfile(str(fields["name"]), to_pose(fields["T_b_f"]), _NO_PROFILE)
    return Line(shot, bool(fields["fresh"]))


BEGUN: Final = json_topic(
    "/begun",
    "tjscan.CalibrationBegun",
    {"date": TEXT},
    lambda begun: {"date": begun.date.isoformat()},
    lambda fields: Begun(datetime.fromisoformat(fields["date"])),
)
TOUCH: Final = json_topic(
    "/touch",
    "tjscan.Touch",
    {"place": INTEGER, "T_b_f": NUMBERS},
    lambda touch: {
        "place": touch.place,
        "T_b_f": [] if touch.T_b_f is None else from_pose(touch.T_b_f),
    },
    _to_touch,
)
LINE: Final = json_topic(
    "/line",
    "tjscan.CalibrationLine",
    {"name": TEXT, "fresh": FLAG, "T_b_f": NUMBERS},
    lambda line: {
        "name": line.shot.name,
        "fresh": line.fresh,
        "T_b_f": from_pose(line.shot.T_b_f),
    },
    _to_line,
)
"""A line without its profile, which follows on `PROFILE`."""

PASSED: Final = json_topic(
    "/passed_over",
    "tjscan.PosePassedOver",
    {"T_b_f": NUMBERS, "reason": TEXT},
    lambda passed: {"T_b_f": from_pose(passed.T_b_f), "reason": passed.reason},
    lambda fields: Passed(to_pose(fields["T_b_f"]), str(fields["reason"])),
)
PROFILE: Final = protobuf_topic("/profile", PointCloud)
TRANSFORMS: Final = protobuf_topic("/tf", FrameTransforms)

READ: Final[tuple[Topic[Any], ...]] = (BEGUN, TOUCH, LINE, PASSED, PROFILE)
"""What is read again; the rest is for viewers."""

TOPICS: Final[tuple[Topic[Any], ...]] = (*READ, TRANSFORMS)
"""Everything that a calibration records."""


def messages_of(time: int, entry: Entry) -> tuple[tuple[Topic[Any], Any], ...]:
    """The messages of an entry, with their topics.

    Parameters
    ----------
    time : int
        Nanoseconds since 1970.
    entry : Begun, Touch, Line or Passed
        What happened.
    """
    match entry:
        case Begun():
            return ((BEGUN, entry),)
        case Touch(_, T_b_f):
            touch = (TOUCH, entry)
            return (touch,) if T_b_f is None else (touch, _flange(time, T_b_f))
        case Passed():
            return ((PASSED, entry),)
        case Line(shot):
            cloud = profile_cloud(time, shot.profile)
            return ((LINE, entry), (PROFILE, cloud), _flange(time, shot.T_b_f))


def _flange(time: int, T_b_f: Array) -> tuple[Topic[Any], FrameTransforms]:
    return (TRANSFORMS, frame_transforms(time, {("b", "f"): T_b_f}))


def read_entries(directory: Path) -> Iterator[Entry]:
    """Yield what was measured in a directory, in order; nothing where there is no recording yet.

    Raises
    ------
    RecordingError
        If the recording is of another program or of a newer version, or is damaged. One that was
        cut off ends where it was cut.
    """
    for file in parts(directory, MEASURED):
        if not file.exists():
            return
        line: Line | None = None
        for entry in read_messages(file, READ):
            if entry.topic is LINE:
                line = entry.message
            elif entry.topic is PROFILE:
                yield _complete(file, line, entry.message)
            else:
                yield entry.message


def _complete(file: Path, line: Line | None, cloud: PointCloud) -> Line:
    """A line with its profile."""
    try:
        if line is None:
            raise ValueError("a profile without a line")
        return replace(line, shot=replace(line.shot, profile=read_profile(cloud, 0.0)))
    except (KeyError, ValueError) as error:
        raise RecordingError(f"{file}: is damaged: {error!r}") from error
