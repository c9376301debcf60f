"""``measured.jsonl``: what a calibration measured, each entry on the disk before the next move."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import numpy as np

from tjscan.calibration.posed_profile import PosedProfile
from tjscan.core.errors import RecordingError
from tjscan.core.files import check_size
from tjscan.core.frames import Array, readonly
from tjscan.laser.profile import Profile

MOST_BYTES: Final = 100_000_000
"""A larger file is no logbook: a line of 640 points takes 30 kB."""

ORTHONORMAL: Final = 1e-6
"""How far from a rotation the axes of a pose may be that was written to the last digit."""


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


@dataclass(frozen=True, slots=True)
class Measured:
    """All that was measured so far. What comes next follows from it alone.

    Parameters
    ----------
    begun : datetime
        When the first of it.
    touches : dict of int to Touch
        The last one of each place.
    shots : tuple of PosedProfile
        The lines.
    passed : tuple of Passed
        Poses that are not worth another try.
    blind : int
        Poses passed over since the last line, or since somebody went on.
    fresh : PosedProfile or None
        The line that verifies.
    """

    begun: datetime
    touches: dict[int, Touch]
    shots: tuple[PosedProfile, ...] = ()
    passed: tuple[Passed, ...] = ()
    blind: int = 0
    fresh: PosedProfile | None = None

    def after(self, entry: Entry) -> Measured:
        """The same with one entry more."""
        match entry:
            case Begun():
                return replace(self, blind=0)
            case Touch():
                return replace(self, touches={**self.touches, entry.place: entry})
            case Line(shot, fresh=True):
                return replace(self, fresh=shot)
            case Line(shot):
                return replace(self, shots=(*self.shots, shot), blind=0)
            case Passed():
                return replace(self, passed=(*self.passed, entry), blind=self.blind + 1)


class Logbook:
    """The file that measurements are appended to; a context manager.

    Parameters
    ----------
    file : Path
        Made where it is missing; else what it holds is where one goes on. An entry that was cut
        off in the middle is dropped.

    Raises
    ------
    RecordingError
        On entering or writing, if the file can't be read or written, or is damaged.
    """

    def __init__(self, file: Path) -> None:
        self._file = file

    def __enter__(self) -> Self:
        begun = Begun(datetime.now(UTC).replace(microsecond=0))
        try:
            if self._file.exists():
                check_size(self._file, MOST_BYTES, "what was measured")
            # Never through a link: what it leads to is no part of the calibration.
            flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
            self._stream = os.fdopen(os.open(self._file, flags, 0o666), "ab+")
            self._stream.seek(0)
            whole = self._stream.read()
            self._stream.truncate(whole.rfind(b"\n") + 1)
        except OSError as error:
            raise RecordingError(f"{self._file}: can't be opened: {error.strerror}") from error
        with ExitStack() as stack:
            stack.callback(self._stream.close)
            entries = list(self._read(whole.split(b"\n")[:-1]))
            first = next((entry for entry in entries if isinstance(entry, Begun)), begun)
            self.measured = Measured(first.date, {})
            for entry in entries:
                self.measured = self.measured.after(entry)
            self.add(begun)
            stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stream.close()

    def add(self, entry: Entry) -> None:
        """Bring an entry to the disk; only then does it count as measured."""
        try:
            self._stream.write(json.dumps(_to_json(entry), allow_nan=False).encode() + b"\n")
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise RecordingError(f"{self._file}: can't be written: {error.strerror}") from error
        self.measured = self.measured.after(entry)

    def _read(self, lines: list[bytes]) -> Iterator[Entry]:
        for number, line in enumerate(lines, start=1):
            try:
                yield _from_json(json.loads(line))
            except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
                raise RecordingError(f"{self._file}: line {number} is damaged: {error}") from error


def _to_json(entry: Entry) -> dict[str, Any]:
    match entry:
        case Begun(date):
            return {"kind": "begun", "date": date.isoformat()}
        case Touch(place, T_b_f):
            T = None if T_b_f is None else T_b_f.tolist()
            return {"kind": "touch", "place": place, "T_b_f": T}
        case Passed(T_b_f, reason):
            return {"kind": "passed", "T_b_f": T_b_f.tolist(), "reason": reason}
        case Line(shot, fresh):
            return {
                "kind": "fresh" if fresh else "line",
                "name": shot.name,
                "T_b_f": shot.T_b_f.tolist(),
                "x_s": _numbers(shot.profile.x_s),
                "z_s": _numbers(shot.profile.z_s),
            }


def _from_json(data: dict[str, Any]) -> Entry:
    match data["kind"]:
        case "begun":
            return Begun(datetime.fromisoformat(data["date"]))
        case "touch":
            return Touch(int(data["place"]), None if data["T_b_f"] is None else _pose(data))
        case "passed":
            return Passed(_pose(data), str(data["reason"]))
        case "line" | "fresh" as kind:
            # JSON knows no NaN: a missing point is null there.
            x, z = (np.array(data[name], dtype=float) for name in ("x_s", "z_s"))
            return Line(
                PosedProfile(str(data["name"]), _pose(data), Profile(x, z)), kind == "fresh"
            )
    raise ValueError(f"unknown entry {data['kind']!r}")


def _pose(data: dict[str, Any]) -> Array:
    T = readonly(data["T_b_f"])
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise ValueError("a pose is a 4 x 4 matrix of finite numbers")
    if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=ORTHONORMAL):
        raise ValueError("a pose has axes of length one, square to each other")
    return T


def _numbers(values: Array) -> list[float | None]:
    return [None if np.isnan(value) else value for value in values.tolist()]
