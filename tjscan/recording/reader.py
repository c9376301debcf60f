"""Reading a recording, whole or cut off."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from tjscan.errors import RecordingError
from tjscan.laser.profile import Profile
from tjscan.recording.messages import FLANGE, PROFILE, read_view
from tjscan.scanning.scan import View


def read_messages(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield topic and content of every whole message, in the order they were written.

    Raises
    ------
    RecordingError
        If the file is missing or is no recording. One that was cut off ends where it was cut.
    """
    try:
        with file.open("rb") as stream:
            yield from _messages(stream)
    except OSError as error:
        raise RecordingError(f"{file}: can't be read: {error.strerror}") from error
    except (McapError, struct.error, KeyError, ValueError) as error:
        raise RecordingError(f"{file}: is no recording, or is damaged: {error}") from error


def read_views(file: Path) -> Iterator[View]:
    """Yield every view of a recording; raises as `read_messages` does."""
    flange: dict[str, Any] = {}
    for topic, message in read_messages(file):
        if topic == FLANGE:
            flange = message
        elif topic == PROFILE:
            try:
                yield read_view(flange, message)
            except (KeyError, ValueError, TypeError) as error:
                raise RecordingError(f"{file}: holds a profile of another make: {error}") from error


def read_run(directory: Path) -> dict[str, Profile]:
    """Every profile of a run directory, by section and substep; raises as `read_messages` does."""
    profiles: dict[str, Profile] = {}
    for number, view in enumerate(read_views(directory / "scan.mcap"), start=1):
        profiles[f"profile {number}: section {view.index}, {view.substep}"] = view.profile
    return profiles


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
