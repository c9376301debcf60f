"""What happened in a run, as its recording tells it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array
from tjscan.recording.messages import EVENT, SECTION, to_pose
from tjscan.recording.reader import UNREADABLE, read_with_views
from tjscan.recording.writer import parts
from tjscan.scanning.section import View


@dataclass(frozen=True, slots=True)
class Event:
    """Something out of the ordinary.

    Parameters
    ----------
    time : datetime
        When.
    name, detail : str
        What, shortly and in words.
    """

    time: datetime
    name: str
    detail: str


@dataclass(frozen=True, slots=True, eq=False)
class LoggedSection:
    """A finished section.

    Parameters
    ----------
    view : View
        The view that it was read in.
    T_b_g : ndarray, shape (4, 4)
        Its frame g in the base frame.
    """

    view: View
    T_b_g: Array


@dataclass(frozen=True, slots=True, eq=False)
class RunLog:
    """A run's recording, all its parts together.

    Parameters
    ----------
    started : datetime or None
        When its first message was written; None where there is none.
    views : tuple of View
        Every profile taken, in order.
    sections : mapping of int to LoggedSection
        Every finished section, by its number.
    events : tuple of Event
        In order.
    """

    started: datetime | None
    views: tuple[View, ...]
    sections: Mapping[int, LoggedSection]
    events: tuple[Event, ...]


def read_log(directory: Path) -> RunLog:
    """Read the recording of a run directory.

    Raises
    ------
    ConfigurationError
        If there is none.
    RecordingError
        If it is damaged.
    """
    started: datetime | None = None
    views: list[View] = []
    sections: dict[int, LoggedSection] = {}
    events: list[Event] = []
    for file in parts(directory):
        for topic, view, message in read_with_views(file):
            try:
                time = _time(message["timestamp"])
                if topic == EVENT:
                    events.append(Event(time, str(message["name"]), str(message["detail"])))
                elif topic == SECTION and views:
                    found = LoggedSection(views[-1], to_pose(message["T_b_g"]))
                    sections[found.view.index] = found
            except UNREADABLE as error:
                raise RecordingError(
                    f"{file}: holds a message of another make: {error!r}"
                ) from error
            started = started or time
            if view is not None:
                views.append(view)
    return RunLog(started, tuple(views), MappingProxyType(sections), tuple(events))


def _time(stamp: dict[str, Any]) -> datetime:
    return datetime.fromtimestamp(stamp["sec"] + 1e-9 * stamp["nsec"], UTC)
