"""What an algorithm reports on a run in its report: facts, findings, charts, events, profiles.

Each algorithm registers one function that takes a run directory and gives a `ReportChapter`. The
report renders chapters, and knows no algorithm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np

from tjscan.core.frames import Array, array_dataclass
from tjscan.groove.settings import DEFAULT_SETTINGS, GrooveSettings
from tjscan.laser.profile import Profile
from tjscan.recording.journal import RunEvent


@dataclass(frozen=True, slots=True, eq=False)
class AnimatedLine:
    """A line that changes its shape.

    Parameters
    ----------
    name, colour : str
        As the legend has it; the colour as CSS writes it.
    points : ndarray, shape (frames, n, 2)
        Metres.
    dashed : bool
    """

    name: str
    colour: str
    points: Array
    dashed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class MovingDiscs:
    """Discs that go about.

    Parameters
    ----------
    name, colour : str
        As of `AnimatedLine`.
    circles : ndarray, shape (frames, n, 3)
        x, y and radius, metres.
    """

    name: str
    colour: str
    circles: Array


@dataclass(frozen=True, slots=True, eq=False)
class PlaneAnimation:
    """What a report lets its reader scrub through.

    Parameters
    ----------
    title, caption : str
        What it shows, and what to see in it.
    times : ndarray, shape (frames,)
        Seconds.
    polygons : sequence of ndarray, shape (n, 2)
        What does not move: the first is the floor, the others are on it.
    path : ndarray, shape (n, 2)
        A line that does not move.
    lines : sequence of AnimatedLine
    discs : sequence of MovingDiscs
    values : sequence of (str, ndarray of shape (frames,))
        Numbers to show at each time, with their names and units.
    notes : sequence of str
        A sentence for each frame, or nothing.
    """

    title: str
    caption: str
    times: Array
    polygons: Sequence[Array]
    path: Array
    lines: Sequence[AnimatedLine]
    discs: Sequence[MovingDiscs]
    values: Sequence[tuple[str, Array]] = ()
    notes: Sequence[str] = ()

    def as_json(self) -> dict[str, Any]:
        """The same as JSON holds it, in whole millimetres."""
        return {
            "times": [round(float(time), 1) for time in self.times],
            "polygons": [_rows_in_whole_mm(polygon) for polygon in self.polygons],
            "path": _rows_in_whole_mm(self.path),
            "lines": [
                asdict(line) | {"points": _rows_in_whole_mm(line.points)} for line in self.lines
            ],
            "discs": [
                asdict(one) | {"circles": _rows_in_whole_mm(one.circles)} for one in self.discs
            ],
            "values": [
                {"name": name, "at": [None if v != v else round(v, 3) for v in values.tolist()]}
                for name, values in self.values
            ],
            "notes": list(self.notes),
        }


def _rows_in_whole_mm(values: Array) -> list[Any]:
    """Metres as whole millimetres, each frame in one row."""
    whole = np.rint(1e3 * np.asarray(values)).astype(int)
    flat: list[Any] = whole.reshape(len(whole), -1).tolist()
    return flat


@array_dataclass
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


Judgement = Literal["", "good", "bad"]
"""Of a number: whether it is as it should be, if that can be said."""


@dataclass(frozen=True, slots=True)
class HeadlineNumber:
    """A number of the headline: its text, what it means, and whether that is good or bad.

    Parameters
    ----------
    value, meaning : str
    judged : str
        ``good``, ``bad`` or nothing.
    """

    value: str
    meaning: str
    judged: Judgement = ""


@dataclass(frozen=True, slots=True)
class ReportSheet:
    """What makes the page of a chapter a single sheet.

    Parameters
    ----------
    title : str
        What kind of page it is.
    picture : str
        Name of the file, beside the page, that holds its charts as one picture.
    frame : str
        Letter of the frame of its numbers.
    """

    title: str
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
    events : tuple of RunEvent
        In their order.
    headline : tuple of HeadlineNumber
        What its page begins with: the verdict, and the numbers asked for.
    sheet : ReportSheet or None
        If its page is a single sheet.
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
    events: tuple[RunEvent, ...] = ()
    headline: tuple[HeadlineNumber, ...] = ()
    sheet: ReportSheet | None = None
    animation: PlaneAnimation | None = None
    profiles: Mapping[int, Profile] = field(default_factory=lambda: MappingProxyType({}))
    settings: GrooveSettings = DEFAULT_SETTINGS


def verdict_on(complete: bool, meaning: str) -> HeadlineNumber:
    """Whether a run did all that was asked, as the first of its headline."""
    return HeadlineNumber(
        "complete" if complete else "not complete", meaning, "good" if complete else "bad"
    )


class ChapterWriter(Protocol):
    """A function that makes a task's chapter of the report on a run directory."""

    def __call__(self, directory: Path) -> ReportChapter:
        """Give the chapter of a run directory, an empty one if it has nothing to report.

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
