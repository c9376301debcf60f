"""Reading a recording, whole or cut off."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from mcap.records import Channel, Message, Metadata

from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.files import check_size
from tjscan.core.frames import Array, inverse
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile
from tjscan.recording.messages import EVENT, FLANGE, PROFILE, SECTION, read_view, to_pose
from tjscan.recording.origin import ORIGIN, Origin
from tjscan.recording.records import MOST_BYTES, read_records
from tjscan.recording.writer import parts
from tjscan.scanning.events import EventCounts, ScanEvent
from tjscan.scanning.result import InterruptedScan
from tjscan.scanning.section import ScannedSection, View

UNREADABLE: Final = (KeyError, ValueError, TypeError, OverflowError)
"""What comes of a message whose fields are others than those a scan writes."""


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """A section that a scan finished.

    Parameters
    ----------
    view : View
        What it was read in.
    T_s_t : ndarray, shape (4, 4)
        Frame t in the sensor.
    T_b_g : ndarray, shape (4, 4)
        Frame g in the base frame, as it was read then.
    """

    view: View
    T_s_t: Array
    T_b_g: Array


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What a recording holds.

    Parameters
    ----------
    finished : tuple of Finished
        The finished sections in order.
    views : tuple of View
        Every profile, in order.
    counts : EventCounts
        How often each remedy was tried.
    stop : str
        Why the scan ended; empty where it did not.
    """

    finished: tuple[Finished, ...]
    views: tuple[View, ...]
    counts: EventCounts
    stop: str


def read_messages(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield topic and content of every whole message, in the order they were written.

    Raises
    ------
    ConfigurationError
        If there is no such file, or it is too large.
    RecordingError
        If it is no recording. One that was cut off ends where it was cut.
    """
    topics: dict[int, str] = {}
    for record in _records(file):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            try:
                content = json.loads(record.data)
                topic = topics[record.channel_id]
            except (ValueError, KeyError, RecursionError) as error:
                raise _damaged(file, error) from error
            if not isinstance(content, dict):
                raise _damaged(file, f"a message on {topic} holds no fields")
            yield topic, content


def read_origin(directory: Path) -> Origin | None:
    """What a run was last recorded with; None where nothing was, or where it does not say.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    found = None
    for file in parts(directory):
        # It stands before the first message.
        for record in takewhile(lambda record: not isinstance(record, Message), _records(file)):
            if isinstance(record, Metadata) and record.name == ORIGIN:
                found = Origin.of(record.metadata)
    return found


def read_views(file: Path) -> Iterator[View]:
    """Yield every view of a recording; raises as `read_messages` does."""
    for _, view, _ in read_with_views(file):
        if view is not None:
            yield view


def read_recording(path: Path) -> Iterator[View]:
    """Yield every view of a run directory, or of one file; raises as `read_messages` does."""
    for file in parts(path) if path.is_dir() else (path,):
        yield from read_views(file)


def read_run(directory: Path) -> dict[str, Profile]:
    """Every profile of a run directory, by section and substep; raises as `read_messages` does."""
    return {
        f"profile {number}: section {view.index}, {view.substep}": view.profile
        for number, view in enumerate(read_recording(directory), start=1)
    }


def read_progress(directory: Path, read: Callable[[Profile], GrooveSection]) -> InterruptedScan:
    """What an interrupted scan had found: its finished sections, read again from their profiles.

    Parameters
    ----------
    directory : Path
        The run directory.
    read : callable
        The same reader as in the scan.

    Raises
    ------
    RecordingError
        As `read_messages` does.
    """
    recorded = read_recorded(directory)
    sections = (
        ScannedSection(one.view, read(one.view.profile), one.T_s_t) for one in recorded.finished
    )
    return InterruptedScan(tuple(sections), recorded.views, recorded.counts)


def read_recorded(directory: Path) -> Recorded:
    """All that a run directory's recording holds, nothing read anew; raises as `read_messages`."""
    views: list[View] = []
    finished: dict[int, Finished] = {}
    counts, stop = EventCounts(), ""
    for file in parts(directory):
        for topic, view, message in read_with_views(file):
            if view is not None:
                views.append(view)
            elif topic == SECTION:
                section = _section(file, views, message)
                finished[section.view.index] = section
            elif topic == EVENT:
                name = str(message.get("name"))
                counts = counts.counting(name)
                stop = str(message.get("detail")) if name == ScanEvent.STOP else ""
    return Recorded(tuple(finished.values()), tuple(views), counts, stop)


def _section(file: Path, views: list[View], message: dict[str, Any]) -> Finished:
    """A finished section, and the view that it was read in."""
    try:
        if not views or views[-1].index != message["index"]:
            raise ValueError("a section without its profile")
        T_b_g, T_b_t = (to_pose(message[name]) for name in ("T_b_g", "T_b_t"))
        return Finished(views[-1], inverse(views[-1].T_b_s) @ T_b_t, T_b_g)
    except UNREADABLE as error:
        raise _damaged(file, f"a section of another make: {error!r}") from error


def read_with_views(file: Path) -> Iterator[tuple[str, View | None, dict[str, Any]]]:
    """Yield topic, view where it is a profile, and message; raises as `read_messages` does."""
    flange: dict[str, Any] = {}
    for topic, message in read_messages(file):
        view = None
        if topic == FLANGE:
            flange = message
        elif topic == PROFILE:
            try:
                view = read_view(flange, message)
            except UNREADABLE as error:
                raise _damaged(file, f"a profile of another make: {error!r}") from error
        yield topic, view, message


def _records(file: Path) -> Iterator[Channel | Message | Metadata]:
    try:
        check_size(file, MOST_BYTES, "a recording")
        with file.open("rb") as stream:
            yield from read_records(stream)
    except FileNotFoundError:
        raise ConfigurationError(
            "there is no recording; a run directory holds scan.mcap", file=file
        ) from None
    except OSError as error:
        raise RecordingError(f"{file}: can't be read: {error.strerror}") from error
    except ValueError as error:
        raise _damaged(file, error) from error


def _damaged(file: Path, why: object) -> RecordingError:
    return RecordingError(f"{file}: is no recording, or is damaged: {why}")
