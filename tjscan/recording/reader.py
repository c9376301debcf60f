"""Reading a recording, whole or cut off."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from tjscan.errors import ConfigurationError, RecordingError
from tjscan.frames import inverse
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile
from tjscan.recording.messages import EVENT, FLANGE, PROFILE, SECTION, read_view, to_pose
from tjscan.recording.writer import parts
from tjscan.scanning.scan import Scan, View
from tjscan.scanning.scanner import Progress


def read_messages(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield topic and content of every whole message, in the order they were written.

    Raises
    ------
    ConfigurationError
        If there is no such file.
    RecordingError
        If it is no recording. One that was cut off ends where it was cut.
    """
    try:
        with file.open("rb") as stream:
            yield from _messages(stream)
    except FileNotFoundError:
        raise ConfigurationError(
            "there is no recording; a run directory holds scan.mcap", file=file
        ) from None
    except OSError as error:
        raise RecordingError(f"{file}: can't be read: {error.strerror}") from error
    except (McapError, struct.error, KeyError, ValueError) as error:
        raise RecordingError(f"{file}: is no recording, or is damaged: {error}") from error


def read_views(file: Path) -> Iterator[View]:
    """Yield every view of a recording; raises as `read_messages` does."""
    for _, view, _ in _with_views(file):
        if view is not None:
            yield view


def read_run(directory: Path) -> dict[str, Profile]:
    """Every profile of a run directory, by section and substep; raises as `read_messages` does."""
    views = (view for file in parts(directory) for view in read_views(file))
    return {
        f"profile {number}: section {view.index}, {view.substep}": view.profile
        for number, view in enumerate(views, start=1)
    }


def read_progress(directory: Path, read: Callable[[Profile], GrooveSection]) -> Progress:
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
    views: list[View] = []
    sections: dict[int, Scan] = {}
    half_steps = 0
    for file in parts(directory):
        for topic, view, message in _with_views(file):
            if view is not None:
                views.append(view)
            elif topic == SECTION:
                last = views[-1]
                T_s_t = inverse(last.T_b_s) @ to_pose(message["T_b_t"])
                sections[last.index] = Scan(last, read(last.profile), T_s_t)
            elif topic == EVENT:
                half_steps += message["name"] == "half step"
    return Progress(tuple(sections.values()), tuple(views), half_steps)


def _with_views(file: Path) -> Iterator[tuple[str, View | None, dict[str, Any]]]:
    """Topic, view where it is a profile, and message."""
    flange: dict[str, Any] = {}
    for topic, message in read_messages(file):
        view = None
        if topic == FLANGE:
            flange = message
        elif topic == PROFILE:
            try:
                view = read_view(flange, message)
            except (KeyError, ValueError, TypeError) as error:
                raise RecordingError(f"{file}: holds a profile of another make: {error}") from error
        yield topic, view, message


def _messages(stream: BinaryIO) -> Iterator[tuple[str, dict[str, Any]]]:
    topics: dict[int, str] = {}
    records = StreamReader(stream).records
    while True:
        try:
            record = next(records, None)
            if isinstance(record, Message):
                content = json.loads(record.data)
        except (EndOfFile, struct.error, ValueError):
            if stream.read(1):
                raise
            return  # cut off in the middle of this record: those before it are whole
        if record is None:
            return
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            yield topics[record.channel_id], content
