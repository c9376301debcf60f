"""The topics of a calibration: what was touched, seen and skipped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from tjscan.calibration.targets.target import PosedProfile
from tjscan.core.array_fields import PoseMatrix
from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array
from tjscan.recording.foxglove import (
    PROFILE_TOPIC,
    TRANSFORMS_TOPIC,
    frame_transforms_message,
    profile_from_cloud_message,
    profile_to_cloud_message,
)
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import Topic

CALIBRATION_RECORDING: Final = "measured"
"""Kind of the recording: it is in ``measured.mcap``, and in a further part for each resume."""


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
        Number among the planned places; a later touch of the same place replaces the earlier one.
    T_b_f : ndarray, shape (4, 4)
        Flange pose with the tip on the board; None if the place was skipped.
    q : ndarray, shape (joints,), or None
        Joint angles there, radians, if they are known.
    """

    place_number: int
    T_b_f: PoseMatrix | None
    q: Array | None = None


@dataclass(frozen=True, slots=True)
class LaserLineTaken:
    """Entry of a calibration's recording: a laser line was taken, to calibrate or to verify."""

    posed_profile: PosedProfile
    for_verification: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SkippedPose:
    """Entry of a calibration's recording: a pose was skipped, and why."""

    T_b_f: PoseMatrix
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
        What was seen; without points if the arm did not get there.
    """

    number: int
    q: Array
    posed_profile: PosedProfile


CalibrationEntry = StartOrResumeEntry | BoardTouch | LaserLineTaken | SkippedPose | ArmPoseTaken


ENTRY_TOPICS: Final[Mapping[type[CalibrationEntry], Topic[Any]]] = MappingProxyType(
    {
        StartOrResumeEntry: Topic.of("/begun", StartOrResumeEntry),
        BoardTouch: Topic.of("/touch", BoardTouch),
        LaserLineTaken: Topic.of("/line", LaserLineTaken),
        ArmPoseTaken: Topic.of("/arm_pose", ArmPoseTaken),
        SkippedPose: Topic.of("/passed_over", SkippedPose),
    }
)
"""Topic of each kind of entry; the points of a profile follow on `PROFILE_TOPIC`."""

TOPICS_READ: Final[tuple[Topic[Any], ...]] = (*ENTRY_TOPICS.values(), PROFILE_TOPIC)
"""What is read again; the rest is for viewers."""

CALIBRATION_TOPICS: Final[tuple[Topic[Any], ...]] = (*TOPICS_READ, TRANSFORMS_TOPIC)
"""Everything that a calibration records."""


def messages_of_entry(time: int, entry: CalibrationEntry) -> Iterator[tuple[Topic[Any], Any]]:
    """Messages that record an entry of a calibration, with their topics.

    Parameters
    ----------
    time : int
        Nanoseconds since 1970.
    entry : CalibrationEntry
        What happened.
    """
    yield ENTRY_TOPICS[type(entry)], entry
    match entry:
        case BoardTouch(T_b_f=T_b_f) if T_b_f is not None:
            yield _flange(time, T_b_f)
        case LaserLineTaken(posed_profile=shot) | ArmPoseTaken(posed_profile=shot):
            yield PROFILE_TOPIC, profile_to_cloud_message(time, shot.profile)
            yield _flange(time, shot.T_b_f)


def _flange(time: int, T_b_f: Array) -> tuple[Topic[Any], FrameTransforms]:
    return (TRANSFORMS_TOPIC, frame_transforms_message(time, {("b", "f"): T_b_f}))


def read_calibration_entries(directory: Path) -> Iterator[CalibrationEntry]:
    """Yield the entries of a calibration's recording in order; none if nothing is recorded.

    Raises
    ------
    RecordingError
        If the recording is of another program or format, or is damaged. One that was cut off ends
        at the cut.
    """
    for file in recording_files(directory, CALIBRATION_RECORDING):
        if not file.exists():
            return
        pending: LaserLineTaken | ArmPoseTaken | None = None
        for entry in read_messages(file, TOPICS_READ):
            if isinstance(entry.message, LaserLineTaken | ArmPoseTaken):
                pending = entry.message
            elif entry.topic is PROFILE_TOPIC:
                yield _with_points(file, pending, entry.message)
            else:
                yield entry.message


def _with_points(
    file: Path, entry: LaserLineTaken | ArmPoseTaken | None, cloud: PointCloud
) -> LaserLineTaken | ArmPoseTaken:
    """A line or a posture with the points of its profile."""
    try:
        if entry is None:
            raise ValueError("a profile without a line")
        shot = entry.posed_profile
        profile = profile_from_cloud_message(cloud, shot.profile)
    except (KeyError, ValueError) as error:
        raise RecordingError(f"{file}: is damaged: {error!r}") from error
    return replace(entry, posed_profile=replace(shot, profile=profile))
