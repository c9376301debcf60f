"""What a weld reports while it runs, and its recording: written, and read again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.frames import Array, array_dataclass
from tjscan.core.signals import delay_ctrl_c
from tjscan.core.sourced import ABSENT_NUMBER, SourcedNumber
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import LOG_TOPIC, RecordingWriter, RunEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import Topic
from tjscan.welding.look import SurfaceLook
from tjscan.welding.replan import NextBead

WELD_RECORDING: Final = "weld"
"""What the names of a weld's recordings begin with."""


@array_dataclass
class PlannedBeadMessage(NextBead):
    """A bead as it is to be laid; see `NextBead`.

    Parameters
    ----------
    weldable : ndarray, shape (n,)
        1 where an arc may burn, 0 where the groove was not read.
    dry : bool, optional
        Whether it was planned alone, by a dry run.
    station : str, optional
        Which lays it, or this part of it.
    """

    weldable: Array
    dry: bool = False
    station: str = ""

    @property
    def name(self) -> str:
        """What it is called."""
        return name_of_bead(self.number, self.station)

    def is_of(self, message: ArcMessage | ArcStretchMessage) -> bool:
        """Whether an arc, or a stretch of one, laid it."""
        return (self.number, self.station) == (message.number, message.station)


@array_dataclass
class ArcMessage:
    """One arc, from its ignition to its end, as the torch was led and the source reported.

    Parameters
    ----------
    number : int
        Of its bead, from 0.
    begin, end : float
        From where to where it burned, metres along the groove.
    seconds : float
        With the torch moving.
    fault : str
        What ended it early; empty if nothing did.
    simulated : bool
        Whether it melted no real metal.
    s, speed, feed, heat_input : ndarray, shape (k,)
        Along the arc: metres, m/s, m/s and J/m.
    station : str, optional
        Of the arm.
    """

    number: int
    begin: float
    end: float
    seconds: float
    fault: str
    simulated: bool
    s: Array
    speed: Array
    feed: Array
    heat_input: Array
    station: str = ""


@dataclass(frozen=True, slots=True)
class ArcStretchMessage:
    """Ten millimetres of an arc.

    Parameters
    ----------
    number : int
        Of the bead, from 0.
    begin, end : float
        Metres along the groove.
    current, current_least, current_most, voltage, feed, gas, speed, heat_input : SourcedNumber
        Means, and the least and the most of the current; A, V, m/s, m³/s, m/s and J/m.
    raised : SourcedNumber
        By how much the torch was led over the plan to follow the current, metres; absent if it
        was not to follow it.
    station : str, optional
        Of the arm.
    """

    number: int
    begin: float
    end: float
    current: SourcedNumber
    current_least: SourcedNumber
    current_most: SourcedNumber
    voltage: SourcedNumber
    feed: SourcedNumber
    gas: SourcedNumber
    speed: SourcedNumber
    heat_input: SourcedNumber
    raised: SourcedNumber = ABSENT_NUMBER
    station: str = ""


@array_dataclass
class LookMessage:
    """A look at the groove, and what it taught.

    Parameters
    ----------
    beads : int
        Passes laid before it: a bead is one from each station.
    time : float
        On the arm's clock, seconds.
    u : ndarray, shape (k,)
        Columns, metres.
    heights : ndarray, shape (n k,)
        At each station, row by row, metres.
    sigma : ndarray, shape (n k,)
        Of each height, metres; `UNSEEN_SIGMA` where it was not seen. Recordings of earlier
        versions hold one at each station, shape (n,).
    read : ndarray, shape (n,)
        1 where it was read.
    deviation, deviation_sigma : float or None
        Of the wire from the last bead's aim, to the leg, as the look shows it, and its standard
        deviation, metres; None if it does not.
    gain, offset, shrinkage : float
        As learnt; see `WeldLearner`.
    station : str, optional
        From which was looked; it shows the sections on that station's stretch.
    """

    beads: int
    time: float
    u: Array
    heights: Array
    sigma: Array
    read: Array
    deviation: float | None
    deviation_sigma: float | None
    gain: float
    offset: float
    shrinkage: float
    station: str = ""

    @property
    def name(self) -> str:
        """What it is called."""
        after = f"after {'pass' if self.station else 'bead'} {self.beads}"
        where = f", from {self.station}" if self.station else ""
        return (after if self.beads else "before welding") + where

    @property
    def seen(self) -> SurfaceLook:
        """The surface that it shows."""
        shape = len(self.read), len(self.u)
        w, sigma = self.heights.reshape(shape), self.sigma.reshape(len(self.read), -1)
        return SurfaceLook(self.u, w, np.broadcast_to(sigma, shape), self.read > 0)


def name_of_bead(number: int, station: str) -> str:
    """What a bead, or a station's part of it, is called."""
    return f"bead {number + 1}" + (f" from {station}" if station else "")


TOPIC_OF_MESSAGE: Final[dict[type, Topic[Any]]] = {
    PlannedBeadMessage: Topic.of("/weld/bead", PlannedBeadMessage),
    ArcMessage: Topic.of("/weld/arc", ArcMessage),
    ArcStretchMessage: Topic.of("/weld/stretch", ArcStretchMessage),
    LookMessage: Topic.of("/weld/look", LookMessage),
}

WELD_TOPICS: Final[tuple[Topic[Any], ...]] = (*TOPIC_OF_MESSAGE.values(), LOG_TOPIC)
"""Everything that a weld records."""

WELD_STOP_EVENT: Final = "stop"
"""Name of the event that a weld was stopped."""

ARC_BEGUN_EVENT: Final = "arc begun"
"""Name of the event that an arc is about to be struck: an `ArcMessage` follows."""

HEIGHT_EVENT: Final = "height"
"""The event of an arc whose current asked for more height than the torch may take."""

WIDE_POOLS_EVENT: Final = "wide pools"
"""The event of a weld whose smallest beads are wider than they can stand on its slope."""

SURFACE_EVENT: Final = "finished surface"
"""The event of a weld whose last look shows how far it is off its target."""

STATION_EVENT: Final = "station"
"""The event that the arm stands at another station."""

WeldMessage = PlannedBeadMessage | ArcMessage | ArcStretchMessage | LookMessage | RunEvent


class WeldRecording(RecordingWriter):
    """The journal that writes a weld's recording, each message up to the disk; a context manager.

    Parameters
    ----------
    file, origin
        As of `RecordingWriter`.
    """

    def __init__(self, file: Path, origin: JobSnapshot | None = None) -> None:
        super().__init__(file, WELD_TOPICS, origin, errors=(WELD_STOP_EVENT,))

    @delay_ctrl_c()
    def record(self, message: object) -> None:
        """Write a message."""
        if isinstance(message, RunEvent):
            self.add_event(message)
        elif (topic := TOPIC_OF_MESSAGE.get(type(message))) is not None:
            self.add(topic, message)
        else:
            return
        self.flush()
        self.sync_to_disk()


def read_weld(directory: Path) -> Iterator[WeldMessage]:
    """Yield everything that a weld recorded, in its order, over all its parts.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    files = recording_files(directory, WELD_RECORDING)
    for entry in chain.from_iterable(read_messages(file, WELD_TOPICS) for file in files):
        yield RunEvent.of_log(entry) if entry.topic is LOG_TOPIC else entry.message
