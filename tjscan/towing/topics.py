"""What a tow records, and how its recording is read again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

from tjscan.core.signals import hold_ctrl_c
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import LOG_TOPIC, RecordingJournal, RunEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import Topic
from tjscan.towing.journal import TowCycle, TowTruth

TOW_RECORDING: Final = "tow"
"""What the names of a tow's recordings begin with."""

REPLAY_EVENT: Final = "replay"
"""Name of the event that begins a recording whose plans were made by a replay."""

CYCLES_TOGETHER: Final = 5
"""Cycles that are written at once, after the first, from which a tow can be gone on with: half a
second is lost at most if the program is killed."""

ARRAY_DECIMALS: Final = 9
"""Decimals of metres and radians that are written."""

CYCLE_TOPIC: Final = Topic.of("/tow/cycle", TowCycle, decimals=ARRAY_DECIMALS)
"""A cycle; metres, radians, seconds. Where the floor holds the links is not recorded."""

TRUTH_TOPIC: Final = Topic.of("/simulation/tow", TowTruth, decimals=ARRAY_DECIMALS)
"""What a simulation truly did; no algorithm reads it."""

TOW_TOPICS: Final[tuple[Topic[Any], ...]] = (CYCLE_TOPIC, TRUTH_TOPIC, LOG_TOPIC)
"""Everything that a tow records."""


class TowRecording(RecordingJournal):
    """The journal that writes a tow's recording; a context manager.

    Parameters
    ----------
    file, origin
        As of `RecordingWriter`.
    truth : callable, optional
        Gives the `TowTruth` of a simulation.
    """

    def __init__(
        self,
        file: Path,
        origin: JobSnapshot | None = None,
        truth: Callable[[], TowTruth] | None = None,
    ) -> None:
        super().__init__(file, TOW_TOPICS, origin, errors=("stop",))
        self._truth, self._cycles = truth, 0

    @hold_ctrl_c()
    def record(self, message: object) -> None:
        """Write a cycle, and what a simulation knows then; or an event, up to the disk."""
        match message:
            case TowCycle():
                self.set_time(message.time)
                plan = replace(message.plan, rest=None)
                self.add(CYCLE_TOPIC, replace(message, plan=plan))
                if self._truth is not None:
                    self.add(TRUTH_TOPIC, self._truth())
                self._cycles += 1
                if self._cycles % CYCLES_TOGETHER == 1:
                    self.flush()
            case RunEvent():
                self.add_event(message)
                self.flush()
                self.sync_to_disk()


def read_tow(directory: Path) -> Iterator[TowCycle | TowTruth | RunEvent]:
    """Yield everything that a tow recorded, in its order, over all its parts.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    files = recording_files(directory, TOW_RECORDING)
    for entry in chain.from_iterable(read_messages(file, TOW_TOPICS) for file in files):
        yield RunEvent.of_log(entry) if entry.topic is LOG_TOPIC else entry.message
