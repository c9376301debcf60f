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

from tjscan.calibration.targets.target import PosedProfile
from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array
from tjscan.laser.profile import Profile
from tjscan.recording.foxglove import (
    frame_transforms_message,
    profile_from_cloud_message,
    profile_to_cloud_message,
)
from tjscan.recording.json_numbers import pose_from_list, pose_to_list
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import (
    BOOLEAN_SCHEMA,
    INTEGER_SCHEMA,
    NUMBERS_SCHEMA,
    TEXT_SCHEMA,
    Topic,
    make_json_topic,
    make_protobuf_topic,
)

CALIBRATION_RECORDING: Final = "measured"
"""Kind of the recording: it is in ``measured.mcap``, and in a further part for each resume."""

_NO_PROFILE: Final = Profile(np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True)
class StartOrResumeEntry:
    """Entry of a calibration's recording: when it was started or resumed."""

    date: datetime


@dataclass(frozen=True, slots=True, eq=False)
class BoardTouch:
    """Entry of a calibration's recording: the board was touched.

    Parameters
    ----------
    place_number : int
        Which of the planned places; a later touch of the same place replaces the earlier one.
    T_b_f : ndarray, shape (4, 4)
        Flange pose with the tip on the board; none where the place was passed over.
    q : ndarray, shape (joints,), or None
        Joint angles there, radians, where they are known.
    """

    place_number: int
    T_b_f: Array | None
    q: Array | None = None


@dataclass(frozen=True, slots=True)
class LaserLineTaken:
    """Entry of a calibration's recording: a laser line was taken, to calibrate or to verify."""

    posed_profile: PosedProfile
    for_verification: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SkippedPose:
    """Entry of a calibration's recording: a pose was skipped, and why."""

    T_b_f: Array
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class ArmPoseTaken:
    """Entry of a calibration's recording: the arm looked at the ball from a posture.

    Parameters
    ----------
    number : int
        Of the posture in the plan.
    q : ndarray, shape (joints,)
        Joint angles, radians.
    posed_profile : PosedProfile
        What was seen; without points where the arm did not get there.
    """

    number: int
    q: Array
    posed_profile: PosedProfile


CalibrationEntry = StartOrResumeEntry | BoardTouch | LaserLineTaken | SkippedPose | ArmPoseTaken


def _to_touch(fields: dict[str, Any]) -> BoardTouch:
    T_b_f = fields["T_b_f"]
    pose = pose_from_list(T_b_f) if T_b_f else None
    return BoardTouch(int(fields["place"]), pose, _to_joints(fields))


def _to_line(fields: dict[str, Any]) -> LaserLineTaken:
    T_b_f, q = pose_from_list(fields["T_b_f"]), _to_joints(fields)
    return LaserLineTaken(
        PosedProfile(str(fields["name"]), T_b_f, _NO_PROFILE, q), bool(fields["fresh"])
    )


def _to_joints(fields: dict[str, Any]) -> Array | None:
    """Joint angles; an earlier version recorded none with touches and lines."""
    return np.array(fields["q"], dtype=float) if fields.get("q") else None


def _from_joints(q: Array | None) -> list[float]:
    return [] if q is None else [float(angle) for angle in q]


def _to_arm_pose(fields: dict[str, Any]) -> ArmPoseTaken:
    shot = PosedProfile(str(fields["name"]), pose_from_list(fields["T_b_f"]), _NO_PROFILE)
    return ArmPoseTaken(int(fields["number"]), np.array(fields["q"], dtype=float), shot)


STARTED_TOPIC: Final = make_json_topic(
    "/begun",
    "tjscan.CalibrationBegun",
    {"date": TEXT_SCHEMA},
    lambda begun: {"date": begun.date.isoformat()},
    lambda fields: StartOrResumeEntry(datetime.fromisoformat(fields["date"])),
)
TOUCH_TOPIC: Final = make_json_topic(
    "/touch",
    "tjscan.Touch",
    {"place": INTEGER_SCHEMA, "T_b_f": NUMBERS_SCHEMA, "q": NUMBERS_SCHEMA},
    lambda touch: {
        "place": touch.place_number,
        "T_b_f": [] if touch.T_b_f is None else pose_to_list(touch.T_b_f),
        "q": _from_joints(touch.q),
    },
    _to_touch,
)
LINE_TOPIC: Final = make_json_topic(
    "/line",
    "tjscan.CalibrationLine",
    {"name": TEXT_SCHEMA, "fresh": BOOLEAN_SCHEMA, "T_b_f": NUMBERS_SCHEMA, "q": NUMBERS_SCHEMA},
    lambda line: {
        "name": line.posed_profile.name,
        "fresh": line.for_verification,
        "T_b_f": pose_to_list(line.posed_profile.T_b_f),
        "q": _from_joints(line.posed_profile.q),
    },
    _to_line,
)
"""A line without its profile, which follows on `PROFILE_TOPIC`."""

ARM_POSE_TOPIC: Final = make_json_topic(
    "/arm_pose",
    "tjscan.CalibrationArmPose",
    {"number": INTEGER_SCHEMA, "name": TEXT_SCHEMA, "q": NUMBERS_SCHEMA, "T_b_f": NUMBERS_SCHEMA},
    lambda taken: {
        "number": taken.number,
        "name": taken.posed_profile.name,
        "q": taken.q.tolist(),
        "T_b_f": pose_to_list(taken.posed_profile.T_b_f),
    },
    _to_arm_pose,
)
"""A posture without its profile, which follows on `PROFILE_TOPIC`."""

SKIPPED_TOPIC: Final = make_json_topic(
    "/passed_over",
    "tjscan.PosePassedOver",
    {"T_b_f": NUMBERS_SCHEMA, "reason": TEXT_SCHEMA},
    lambda passed: {"T_b_f": pose_to_list(passed.T_b_f), "reason": passed.reason},
    lambda fields: SkippedPose(pose_from_list(fields["T_b_f"]), str(fields["reason"])),
)
PROFILE_TOPIC: Final = make_protobuf_topic("/profile", PointCloud)
TRANSFORMS_TOPIC: Final = make_protobuf_topic("/tf", FrameTransforms)

READ_TOPICS: Final[tuple[Topic[Any], ...]] = (
    STARTED_TOPIC,
    TOUCH_TOPIC,
    LINE_TOPIC,
    SKIPPED_TOPIC,
    ARM_POSE_TOPIC,
    PROFILE_TOPIC,
)
"""What is read again; the rest is for viewers."""

ALL_TOPICS: Final[tuple[Topic[Any], ...]] = (*READ_TOPICS, TRANSFORMS_TOPIC)
"""Everything that a calibration records."""


def messages_of_entry(time: int, entry: CalibrationEntry) -> tuple[tuple[Topic[Any], Any], ...]:
    """Messages that record an entry of a calibration, with their topics.

    Parameters
    ----------
    time : int
        Nanoseconds since 1970.
    entry : CalibrationEntry
        What happened.
    """
    match entry:
        case StartOrResumeEntry():
            return ((STARTED_TOPIC, entry),)
        case BoardTouch(_, T_b_f, _):
            touch = (TOUCH_TOPIC, entry)
            return (touch,) if T_b_f is None else (touch, _flange(time, T_b_f))
        case SkippedPose():
            return ((SKIPPED_TOPIC, entry),)
        case LaserLineTaken(shot):
            cloud = profile_to_cloud_message(time, shot.profile)
            return ((LINE_TOPIC, entry), (PROFILE_TOPIC, cloud), _flange(time, shot.T_b_f))
        case ArmPoseTaken(_, _, shot):
            cloud = profile_to_cloud_message(time, shot.profile)
            return ((ARM_POSE_TOPIC, entry), (PROFILE_TOPIC, cloud), _flange(time, shot.T_b_f))


def _flange(time: int, T_b_f: Array) -> tuple[Topic[Any], FrameTransforms]:
    return (TRANSFORMS_TOPIC, frame_transforms_message(time, {("b", "f"): T_b_f}))


def read_calibration_entries(directory: Path) -> Iterator[CalibrationEntry]:
    """Yield the entries of a calibration's recording in order; none where nothing is recorded.

    Raises
    ------
    RecordingError
        If the recording is of another program or of a newer version, or is damaged. One that was
        cut off ends where it was cut.
    """
    for file in recording_files(directory, CALIBRATION_RECORDING):
        if not file.exists():
            return
        line: LaserLineTaken | ArmPoseTaken | None = None
        for entry in read_messages(file, READ_TOPICS):
            if entry.topic in (LINE_TOPIC, ARM_POSE_TOPIC):
                line = entry.message
            elif entry.topic is PROFILE_TOPIC:
                yield _complete(file, line, entry.message)
            else:
                yield entry.message


def _complete(
    file: Path, line: LaserLineTaken | ArmPoseTaken | None, cloud: PointCloud
) -> LaserLineTaken | ArmPoseTaken:
    """A line or a posture with its profile."""
    try:
        if line is None:
            raise ValueError("a profile without a line")
        return replace(
            line,
            posed_profile=replace(
                line.posed_profile, profile=profile_from_cloud_message(cloud, 0.0)
            ),
        )
    except (KeyError, ValueError) as error:
        raise RecordingError(f"{file}: is damaged: {error!r}") from error
