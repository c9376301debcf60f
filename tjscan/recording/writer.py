"""Writing a recording: every record reaches the file at once, the disk after each section."""

from __future__ import annotations

import json
import os
import time
from itertools import count, takewhile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from mcap.writer import CompressionType, Writer

from tjscan.core.errors import RecordingError
from tjscan.core.files import check_inside
from tjscan.recording.messages import (
    EVENT,
    FLANGE,
    PROFILE,
    SCHEMAS,
    SECTION,
    TOPICS,
    flange_message,
    profile_message,
    section_message,
)
from tjscan.recording.origin import ORIGIN, Origin
from tjscan.scanning.section import ScannedSection, View


def parts(directory: Path) -> list[Path]:
    """The recording of a run: ``scan.mcap``, and a further part for each time it was resumed.

    Raises
    ------
    ConfigurationError
        If a part is a link that leads out of the directory.
    """
    first = directory / "scan.mcap"
    others = (directory / f"scan-{number}.mcap" for number in count(2))
    found = [first, *takewhile(os.path.lexists, others)]
    check_inside(directory, *(file.name for file in found))
    return found


def next_part(directory: Path) -> Path:
    """Where to record next: what is on disk is never written again."""
    first = directory / "scan.mcap"
    return directory / f"scan-{len(parts(directory)) + 1}.mcap" if first.exists() else first


class Recording:
    """A journal that writes a part of a recording.

    Parameters
    ----------
    file : Path
        Must not exist yet.
    origin : Origin, optional
        What it is made with.

    Raises
    ------
    RecordingError
        On entering or writing, if the file can't be written.
    """

    def __init__(self, file: Path, origin: Origin | None = None) -> None:
        self._file, self._origin = file, origin

    def __enter__(self) -> Self:
        try:
            self._stream = self._file.open("xb")
        except OSError as error:
            raise self._lost(error) from error
        self._writer = Writer(self._stream, compression=CompressionType.NONE, use_chunking=False)
        self._writer.start(profile="tjscan")
        if self._origin is not None:
            self._writer.add_metadata(ORIGIN, self._origin.metadata)
        self._channels = {topic: self._channel(topic, name) for topic, name in TOPICS.items()}
        self._start_ns, self._arm_time = time.time_ns(), 0.0
        self._arm_start: float | None = None
        self._stream.flush()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._writer.finish()
            self._sync()
            self._stream.close()
        except OSError as full:
            if error is None:
                raise self._lost(full) from full

    def view(self, view: View) -> None:
        """Write the flange pose and the raw profile, before anybody tries to read it."""
        if self._arm_start is None:  # a real arm's clock began when it was switched on
            self._arm_start = view.time
        self._arm_time = view.time - self._arm_start
        self._write(FLANGE, flange_message(view))
        self._write(PROFILE, profile_message(view))

    def section(self, scan: ScannedSection) -> None:
        """Write a finished section and bring all of it to the disk."""
        self._write(SECTION, section_message(scan))
        self._sync()

    def event(self, name: str, detail: str) -> None:
        """Write what happened out of the ordinary."""
        self._write(EVENT, {"frame_id": "b", "name": name, "detail": detail})

    def _channel(self, topic: str, schema: str) -> int:
        text = json.dumps({"title": schema, "type": "object", "properties": SCHEMAS[schema]})
        schema_id = self._writer.register_schema(schema, "jsonschema", text.encode())
        return int(self._writer.register_channel(topic, "json", schema_id))

    def _write(self, topic: str, message: dict[str, Any]) -> None:
        """Append a message, stamped with the start plus what passed on the arm's clock."""
        now = self._start_ns + round(1e9 * self._arm_time)
        sec, nsec = divmod(now, 10**9)
        data = json.dumps({"timestamp": {"sec": sec, "nsec": nsec}, **message}).encode()
        try:
            self._writer.add_message(
                self._channels[topic], log_time=now, publish_time=now, data=data
            )
            self._stream.flush()
        except OSError as error:
            raise self._lost(error) from error

    def _sync(self) -> None:
        try:
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise self._lost(error) from error

    def _lost(self, error: OSError) -> RecordingError:
        return RecordingError(
            f"{self._file}: can't be written: {error.strerror}. What was written before is whole."
        )
