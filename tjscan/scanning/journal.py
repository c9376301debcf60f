"""A scan's events, why it ends, what its recording holds, and the scanned surface as obstacle."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray

from tjscan.recording.journal import Journal, RunEvent
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection, Sections
from tjscan.scanning.sections_before import GrooveReader, read_section

if TYPE_CHECKING:
    from tjscan.robot.clearance import ClearPathPlanner


class ScanEvent(StrEnum):
    """Names of the events of a scan, in journals and recordings."""

    TAKEN_AGAIN = "taken again"
    MERGED = "merged"
    NUDGE = "nudge"
    HALF_STEP = "half step"
    RETREAT = "retreat"
    STEP_OVER = "step over"
    STRAIGHT = "straight"
    STEPWISE = "stepwise"
    CLOCK = "clock"
    SWAY = "sway"
    TACK = "tack"
    RESUMED = "resumed"
    DAMAGED = "damaged"
    PAUSED = "paused"
    STOP_REQUESTED = "stop requested"
    STOP = "stop"
    COMPLETE = "complete"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class RetryCounts:
    """How often each kind of retry was made.

    Parameters
    ----------
    taken_again : int
        Profiles taken again at the same place.
    merged : int
        Profiles made of what several of the same place agree on.
    nudges : int
        Views from a little beside the set-point.
    half_steps : int
        Steps tried again at half their length.
    retreats : int
        Returns to the last section.
    stepwise : int
        Steps of a continuous scan from rest, where the groove could not be followed.
    """

    taken_again: int = 0
    merged: int = 0
    nudges: int = 0
    half_steps: int = 0
    retreats: int = 0
    stepwise: int = 0

    @classmethod
    def of_events(cls, names: Iterable[str]) -> Self:
        """Count the retries among events, by their names."""
        count = Counter(names)
        return cls(
            taken_again=count[ScanEvent.TAKEN_AGAIN],
            merged=count[ScanEvent.MERGED],
            nudges=count[ScanEvent.NUDGE],
            half_steps=count[ScanEvent.HALF_STEP],
            retreats=count[ScanEvent.RETREAT],
            stepwise=count[ScanEvent.STEPWISE],
        )


class StopReason(StrEnum):
    """Why a scan ended."""

    LENGTH = "length reached"
    SECTIONS = "number of sections reached"
    CLOSED = "back at the first section"
    UNREACHABLE = "next pose out of reach"
    LOST = "groove not found"
    REFUSED = "next set-point refused"
    REQUESTED = "stop requested"
    CUT = "recording ends"


def groove_length(sections: Sections) -> float:
    """Length of the chain of groove origins, metres."""
    origins = np.array([scan.T_b_g[:3, 3] for scan in sections])
    return float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())


def untaught_step_lengths(sections: Sections) -> list[float]:
    """Distances in metres between the groove origins of the steps that were not taught."""
    origins = np.array([scan.T_b_g[:3, 3] for scan in sections[1:]])
    lengths: list[float] = np.linalg.norm(np.diff(origins, axis=0), axis=1).tolist()
    return lengths


def plan_is_fulfilled(stop: StopReason, plan: ScanPlan) -> bool:
    """Whether a scan did what it was asked to.

    Parameters
    ----------
    stop : StopReason
        Why it ended.
    plan : ScanPlan
        What was asked.
    """
    if stop is StopReason.UNREACHABLE:
        return plan.length is None and plan.sections is None
    return stop in (StopReason.LENGTH, StopReason.SECTIONS, StopReason.CLOSED)


def reason_to_stop(plan: ScanPlan, sections: Sections, step: float) -> StopReason | None:
    """Reason why the scan is done; None while there is more to do.

    Parameters
    ----------
    plan : ScanPlan
        What was asked.
    sections : sequence of ScannedSection
        The sections so far, the two taught ones first.
    step : float
        Length of the step that would follow, metres.

    Notes
    -----
    The length counts from the second taught section, where the scan starts to find its own
    way, and is reached at the step that comes nearest to it. The joint is closed when the scan,
    having left the first section behind, is less than a step from it, before it or past it.
    """
    if plan.length is not None and plan.length - groove_length(sections[1:]) < step / 2:
        return StopReason.LENGTH
    if plan.sections is not None and len(sections) >= plan.sections:
        return StopReason.SECTIONS
    origins = np.array([scan.T_b_g[:3, 3] for scan in sections])
    from_first = np.linalg.norm(origins - origins[0], axis=1)
    if from_first[-1] < step and from_first.max() > 2 * step:
        return StopReason.CLOSED
    return None


@dataclass(frozen=True, slots=True, eq=False)
class ScanResult:
    """What a scan found.

    Parameters
    ----------
    sections : tuple of ScannedSection
        The finished sections in order, the two taught ones first.
    views : tuple of ProfileView
        Every profile taken, in order.
    stop : StopReason
        Why it ended.
    detail : str
        The same in one sentence, with numbers.
    counts : RetryCounts
        How often each kind of retry was made.
    """

    sections: tuple[ScannedSection, ...]
    views: tuple[ProfileView, ...]
    stop: StopReason
    detail: str
    counts: RetryCounts


@dataclass(frozen=True, slots=True, eq=False)
class RecordedScan:
    """The recording of a scan, all its parts together.

    Parameters
    ----------
    started : datetime or None
        When its first message was written, UTC; None if there is none.
    views : tuple of ProfileView
        Every profile taken, in order.
    sections : mapping of int to ScannedSection
        The finished sections by their number, in order, as they were read during the scan.
    events : tuple of RunEvent
        In order.
    """

    started: datetime | None
    views: tuple[ProfileView, ...]
    sections: Mapping[int, ScannedSection]
    events: tuple[RunEvent, ...]

    @property
    def retry_counts(self) -> RetryCounts:
        """How often each kind of retry was made."""
        return RetryCounts.of_events(event.name for event in self.events)

    @property
    def stop_detail(self) -> str:
        """Reason why the scan ended; empty if it did not."""
        last = self.events[-1] if self.events else None
        return last.detail if last is not None and last.name == ScanEvent.STOP else ""

    @property
    def stop(self) -> StopReason:
        """Why the scan ended; `StopReason.CUT` if it did not."""
        known = (reason for reason in StopReason if self.stop_detail.startswith(reason))
        return next(known, StopReason.CUT)

    def reread_sections(self, read: GrooveReader) -> tuple[ScannedSection, ...]:
        """The finished sections, read again from their profiles.

        Parameters
        ----------
        read : callable
            Turns a profile into a groove section: the reader of the scan.
        """
        found: list[ScannedSection] = []
        for one in self.sections.values():
            found.append(read_section(read, one.view, one.T_s_t, found))
        return tuple(found)


class ScanResultsJournal:
    """Journal that keeps a scan's sections, views and events, and passes all on to another.

    Parameters
    ----------
    journal : Journal
        Receives everything next.

    Attributes
    ----------
    sections : list of ScannedSection
        The finished sections in order.
    views : list of ProfileView
        Every profile taken, in order.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self.sections: list[ScannedSection] = []
        self.views: list[ProfileView] = []
        self._event_names: list[str] = []

    @property
    def counts(self) -> RetryCounts:
        """How often each kind of retry was made."""
        return RetryCounts.of_events(self._event_names)

    def restore_from_recording(
        self, done: RecordedScan, sections: Iterable[ScannedSection]
    ) -> None:
        """Restore sections, views and events from what was recorded before.

        Parameters
        ----------
        done : RecordedScan
            The recording.
        sections : iterable of ScannedSection
            Its finished sections, read again.
        """
        self.sections, self.views = list(sections), list(done.views)
        self._event_names = [event.name for event in done.events]

    def record(self, message: object) -> None:
        """Keep a message and pass it on."""
        match message:
            case ProfileView():
                self.views.append(message)
            case ScannedSection():
                self.sections.append(message)
            case RunEvent():
                self._event_names.append(message.name)
        self._journal.record(message)

    def record_event(self, name: str, detail: str) -> None:
        """Record an event of the scan.

        Parameters
        ----------
        name : str
            By its stable name; see `tjscan.scanning.journal.ScanEvent`.
        detail : str
            The same in a sentence, with numbers.
        """
        self.record(RunEvent(name, detail))


SURFACE_SPACING: Final = 4e-3
"""Metres between the sections that make the surface of an obstacle: nearer ones add nothing."""


class ScannedSurfaceObstacle:
    """Journal that makes the scanned surface an obstacle that the arm keeps clear of.

    Parameters
    ----------
    clearance : ClearPathPlanner
        Receives the surface after every section.
    sections : iterable of ScannedSection, optional
        What was found before.
    """

    def __init__(
        self, clearance: ClearPathPlanner, sections: Iterable[ScannedSection] = ()
    ) -> None:
        self._clearance = clearance
        self._points_b = [section.points_b for section in sections]
        self._update_obstacle()

    def record(self, message: object) -> None:
        """Add the strip from the last section to this one; false points of profiles are none."""
        if not isinstance(message, ScannedSection):
            return
        points_b = message.points_b
        if self._points_b:
            away = np.linalg.norm(points_b - self._points_b[-1], axis=1)
            if away.max() < SURFACE_SPACING:
                return
        self._points_b.append(points_b)
        self._update_obstacle()

    def _update_obstacle(self) -> None:
        if len(self._points_b) > 1:
            points = np.array(self._points_b)
            triangles = grid_triangles(*points.shape[:2])
            self._clearance.set_measured_surface(points.reshape(-1, 3), triangles)


def grid_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Triangles of the surface through a grid of points, numbered row by row.

    Parameters
    ----------
    rows, columns : int
        Of the grid.

    Returns
    -------
    ndarray, shape (m, 3)
        Numbers of each triangle's corners.
    """
    grid = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns)
    corners = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    a, b, c, d = (corner.ravel() for corner in corners)
    return np.vstack([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
