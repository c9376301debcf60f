"""What an algorithm has to say of a run in its report: facts, findings, charts, events, profiles.

Each algorithm registers one function that takes a run directory and gives a `ReportChapter`. The
report renders chapters, and knows no algorithm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Literal, Protocol

from tjscan.core.frames import Array, readonly_copy
from tjscan.groove.settings import DEFAULT_SETTINGS, GrooveSettings
from tjscan.laser.profile import Profile
from tjscan.result.animation import PlaneAnimation


@dataclass(frozen=True, slots=True, eq=False)
class ReportChart:
    """A chart of a report: one quantity over another; charts of one title are drawn together.

    Parameters
    ----------
    title : str
        What it shows.
    x_label, y_label : str
        Of the axes, with units.
    x, y : ndarray, shape (n,)
        Values in these units.
    nominal : float or None
        What was asked for, drawn as a dashed line.
    line : str
        What this line is called where several are drawn in one chart; nothing for a lone one.
    caption : str
        What to see in it, in a sentence.
    plane : bool
        Whether it shows a plane, so that both axes have one scale.
    mark : str
        How its values are drawn: a line through them, a bar or a dot for each.
    log_y : bool
        Whether the y axis is logarithmic.
    """

    title: str
    x_label: str
    y_label: str
    x: Array
    y: Array
    nominal: float | None = None
    line: str = ""
    caption: str = ""
    plane: bool = False
    mark: Literal["line", "bar", "dot"] = "line"
    log_y: bool = False

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            object.__setattr__(self, name, readonly_copy(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class ReportEvent:
    """An event of a run that a report lists: its time, name and detail.

    Parameters
    ----------
    time : datetime
        When, in UTC.
    name, detail : str
        What, in a word and in a sentence.
    """

    time: datetime
    name: str
    detail: str


@dataclass(frozen=True, slots=True)
class ReportSheet:
    """What makes the page of a chapter a single sheet that begins with the numbers asked for.

    Parameters
    ----------
    title : str
        What kind of page it is.
    headline : tuple of (str, str)
        Name and value of each number asked for.
    picture : str
        Name of the file, beside the page, that holds its charts as one picture.
    frame : str
        Letter of the frame of its numbers.
    """

    title: str
    headline: tuple[tuple[str, str], ...]
    picture: str
    frame: str


@dataclass(frozen=True, slots=True, eq=False)
class ReportChapter:
    """What a task adds to the report of a run: facts, findings, charts, events and profiles.

    Parameters
    ----------
    facts : tuple of (str, str)
        Name and value of what holds for all of it: device, job, calibration.
    findings : tuple of str
        What a reader has to know before relying on it, a sentence each.
    charts : tuple of ReportChart
        How it went.
    events : tuple of ReportEvent
        In their order.
    sheet : ReportSheet or None
        Where its page is a single sheet.
    animation : PlaneAnimation or None
        What moved, for the reader to scrub through.
    profiles : mapping of int to Profile
        Profile of each finished section, by its number.
    settings : GrooveSettings
        How the groove was read in these.
    """

    facts: tuple[tuple[str, str], ...] = ()
    findings: tuple[str, ...] = ()
    charts: tuple[ReportChart, ...] = ()
    events: tuple[ReportEvent, ...] = ()
    sheet: ReportSheet | None = None
    animation: PlaneAnimation | None = None
    profiles: Mapping[int, Profile] = field(default_factory=lambda: MappingProxyType({}))
    settings: GrooveSettings = DEFAULT_SETTINGS


class ChapterWriter(Protocol):
    """A function that makes a task's chapter of the report on a run directory."""

    def __call__(self, directory: Path) -> ReportChapter:
        """Give the chapter of a run directory, an empty one where it has nothing to say.

        Parameters
        ----------
        directory : Path
            A finished run.

        Raises
        ------
        ConfigurationError
            If a file in it is wrong.
        RecordingError
            If its recording is damaged.
        """
