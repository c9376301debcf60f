"""What a calibration measured, each entry on the disk before the next move."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Self

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from tjscan.calibration.targets.target import PosedProfile
from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array, PoseMatrix
from tjscan.recording import foxglove
from tjscan.recording.journal import RecordingWriter
from tjscan.recording.parts import next_recording_file, recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import Topic

CALIBRATION_RECORDING_KIND: Final = "measured"
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


ENTRY_TOPICS: Final[Mapping[type[CalibrationEntry], Topic[Any]]] = {
    StartOrResumeEntry: Topic.of("/begun", StartOrResumeEntry),
    BoardTouch: Topic.of("/touch", BoardTouch),
    LaserLineTaken: Topic.of("/line", LaserLineTaken),
    ArmPoseTaken: Topic.of("/arm_pose", ArmPoseTaken),
    SkippedPose: Topic.of("/passed_over", SkippedPose),
}
"""Topic of each kind of entry; the points of a profile follow on `PROFILE_TOPIC`."""

TOPICS_READ: Final[tuple[Topic[Any], ...]] = (*ENTRY_TOPICS.values(), foxglove.PROFILE_TOPIC)
"""What is read again; the rest is for viewers."""

CALIBRATION_TOPICS: Final[tuple[Topic[Any], ...]] = (*TOPICS_READ, foxglove.TRANSFORMS_TOPIC)
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
            yield _flange_message(time, T_b_f)
        case LaserLineTaken(posed_profile=shot) | ArmPoseTaken(posed_profile=shot):
            yield foxglove.PROFILE_TOPIC, foxglove.profile_to_cloud_message(time, shot.profile)
            yield _flange_message(time, shot.T_b_f)


def _flange_message(time: int, T_b_f: Array) -> tuple[Topic[Any], FrameTransforms]:
    return (foxglove.TRANSFORMS_TOPIC, foxglove.frame_transforms_message(time, {("b", "f"): T_b_f}))


def read_calibration_entries(directory: Path) -> Iterator[CalibrationEntry]:
    """Yield the entries of a calibration's recording in order; none if nothing is recorded.

    Raises
    ------
    RecordingError
        If the recording is of another program or format, or is damaged. One that was cut off ends
        at the cut.
    """
    for file in recording_files(directory, CALIBRATION_RECORDING_KIND):
        if not file.exists():
            return
        pending: LaserLineTaken | ArmPoseTaken | None = None
        for entry in read_messages(file, TOPICS_READ):
            if isinstance(entry.message, LaserLineTaken | ArmPoseTaken):
                pending = entry.message
            elif entry.topic is foxglove.PROFILE_TOPIC:
                yield _add_profile_points(file, pending, entry.message)
            else:
                yield entry.message


def _add_profile_points(
    file: Path, entry: LaserLineTaken | ArmPoseTaken | None, cloud: PointCloud
) -> LaserLineTaken | ArmPoseTaken:
    """A line or a posture with the points of its profile."""
    try:
        if entry is None:
            raise ValueError("a profile without a line")
        shot = entry.posed_profile
        profile = foxglove.profile_from_cloud_message(cloud, shot.profile)
    except (KeyError, ValueError) as error:
        raise RecordingError(f"{file}: is damaged: {error!r}") from error
    return replace(entry, posed_profile=replace(shot, profile=profile))


@dataclass(frozen=True, slots=True)
class MeasurementsSoFar:
    """All touches, lines and skipped poses so far; what comes next follows from them alone.

    Parameters
    ----------
    started_at : datetime
        When the first of it.
    touches : dict of int to BoardTouch
        The last one of each place.
    line_profiles : tuple of PosedProfile
        The lines.
    skipped_poses : tuple of SkippedPose
        Poses that are not worth another try.
    skipped_in_a_row : int
        Poses skipped since the last line, or since it was resumed.
    verification_profile : PosedProfile or None
        The line that verifies.
    arm_poses : dict of int to ArmPoseTaken
        Postures of the arm from which the ball was looked at, by their number in the plan.
    """

    started_at: datetime
    touches: dict[int, BoardTouch]
    line_profiles: tuple[PosedProfile, ...] = ()
    skipped_poses: tuple[SkippedPose, ...] = ()
    skipped_in_a_row: int = 0
    verification_profile: PosedProfile | None = None
    arm_poses: dict[int, ArmPoseTaken] = field(default_factory=dict)

    @property
    def tip_contacts(self) -> list[tuple[int, Array, Array | None]]:
        """Number of each place where the tip touched, T_b_f and joint angles then, in order."""
        touches = sorted(self.touches.items())
        return [(k, touch.T_b_f, touch.q) for k, touch in touches if touch.T_b_f is not None]

    def with_entry(self, entry: CalibrationEntry) -> MeasurementsSoFar:
        """The same measurements with one entry more."""
        match entry:
            case StartOrResumeEntry():
                return replace(self, skipped_in_a_row=0)
            case BoardTouch():
                return replace(self, touches={**self.touches, entry.place_number: entry})
            case LaserLineTaken(shot, for_verification=True):
                return replace(self, verification_profile=shot)
            case LaserLineTaken(shot):
                return replace(self, line_profiles=(*self.line_profiles, shot), skipped_in_a_row=0)
            case ArmPoseTaken():
                return replace(self, arm_poses={**self.arm_poses, entry.number: entry})
            case SkippedPose():
                return replace(
                    self,
                    skipped_poses=(*self.skipped_poses, entry),
                    skipped_in_a_row=self.skipped_in_a_row + 1,
                )


class Logbook(RecordingWriter):
    """Writes the recording of a calibration, entry by entry; a context manager.

    Parameters
    ----------
    directory : Path
        Where it is. A calibration that it holds already is resumed, in a part of its own; an entry
        that was cut off in the middle is dropped.
    T_f_s : ndarray, shape (4, 4)
        About where the laser sits on the flange, as assumed while measuring. It shows a viewer
        where the profiles are, and is not read again.
    listen : callable, optional
        Receives every entry, earlier ones too, once it is on the disk.

    Raises
    ------
    RecordingError
        On entering or writing, if it can't be read or written, or is damaged.
    """

    def __init__(
        self,
        directory: Path,
        T_f_s: Array,
        listen: Callable[[CalibrationEntry], object] = lambda _: None,
    ) -> None:
        file = next_recording_file(directory, CALIBRATION_RECORDING_KIND)
        super().__init__(file, CALIBRATION_TOPICS)
        self._directory, self._T_f_s, self._listen = directory, T_f_s, listen

    def __enter__(self) -> Self:
        begun = StartOrResumeEntry(datetime.now(UTC).replace(microsecond=0))
        entries = list(read_calibration_entries(self._directory))
        first = next((entry for entry in entries if isinstance(entry, StartOrResumeEntry)), begun)
        self.measured = MeasurementsSoFar(first.date, {})
        for entry in entries:
            self.measured = self.measured.with_entry(entry)
            self._listen(entry)
        super().__enter__()
        with ExitStack() as stack:
            stack.push(super().__exit__)
            now = time.time_ns()
            mount = foxglove.frame_transforms_message(now, {("f", "s"): self._T_f_s})
            self.write(now, (foxglove.TRANSFORMS_TOPIC, mount))
            self.record(begun)
            stack.pop_all()
        return self

    def record(self, entry: CalibrationEntry) -> None:
        """Write an entry to the disk; only then does it count as measured."""
        now = time.time_ns()
        self.write(now, *messages_of_entry(now, entry))
        self.sync_to_disk()
        self.measured = self.measured.with_entry(entry)
        self._listen(entry)
