"""What a calibration measured, each entry on the disk before the next move."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

from tjscan.calibration.targets.target import PosedProfile
from tjscan.calibration.wizard.topics import (
    CALIBRATION_RECORDING,
    CALIBRATION_TOPICS,
    ArmPoseTaken,
    BoardTouch,
    CalibrationEntry,
    LaserLineTaken,
    SkippedPose,
    StartOrResumeEntry,
    messages_of_entry,
    read_calibration_entries,
)
from tjscan.core.frames import Array
from tjscan.recording.foxglove import TRANSFORMS_TOPIC, frame_transforms_message
from tjscan.recording.parts import next_recording_file
from tjscan.recording.writer import RecordingWriter


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
        Receives every entry, those of before too, once it is on the disk.

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
        file = next_recording_file(directory, CALIBRATION_RECORDING)
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
            mount = frame_transforms_message(now, {("f", "s"): self._T_f_s})
            self.write(now, (TRANSFORMS_TOPIC, mount))
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
