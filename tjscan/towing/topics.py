"""What a tow records, and how its recording is read again."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from tjscan.core.frames import Array, readonly_copy
from tjscan.core.signals import hold_ctrl_c
from tjscan.recording.event import RecordedEvent
from tjscan.recording.foxglove import event_log_message
from tjscan.recording.header import JobSnapshot
from tjscan.recording.json_numbers import to_finite_floats
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import (
    INTEGER_SCHEMA,
    NUMBER_SCHEMA,
    NUMBERS_SCHEMA,
    TEXT_SCHEMA,
    TEXTS_SCHEMA,
    Topic,
    make_json_topic,
    make_protobuf_topic,
)
from tjscan.recording.writer import RecordingWriter
from tjscan.towing.journal import TowCycle, TowTruth
from tjscan.towing.shape.plan import PlanTerms, TowingPlan

TOW_RECORDING: Final = "tow"
"""What the names of a tow's recordings begin with."""

REPLAY: Final = "replay"
"""Name of the event that begins a recording whose plans were made anew."""

CYCLES_TOGETHER: Final = 5
"""Cycles that are written at once, after the first, from which a tow can be gone on with: half a
second is lost at most where the program is killed."""

DIGITS: Final = 9
"""Decimals of metres and radians that are written."""

UNSEEN: Final = 1e6
"""Stands for the coordinates of a vehicle whose pose did not come: JSON knows no NaN."""

CYCLE_ROWS: Final = {"seen": 3, "poses": 3, "sigmas": 2, "targets": 3, "asked": 3, "obstacles": 5}
"""Tables of a cycle, and how many columns each has."""

TERMS: Final = ("bend", "obstacle", "change", "pace", "pull")


def _flat(values: Array) -> list[float]:
    numbers = np.nan_to_num(np.asarray(values, dtype=float), nan=UNSEEN)
    flat: list[float] = np.round(numbers, DIGITS).ravel().tolist()
    return flat


def _rows(values: Any, columns: int) -> Array:
    numbers = np.array(to_finite_floats(values))
    numbers[numbers == UNSEEN] = np.nan
    return readonly_copy(numbers.reshape(-1, columns))


def _from_cycle(cycle: TowCycle) -> dict[str, Any]:
    plan = cycle.plan
    return {
        "time": cycle.time,
        "along": cycle.along,
        "pace": cycle.pace,
        **{name: _flat(getattr(cycle, name)) for name in CYCLE_ROWS},
        "estimate": _flat(plan.estimate),
        "angles": _flat(plan.angles),
        "link_poses": _flat(plan.link_poses),
        "held_poses": _flat(plan.held_poses),
        "terms": [getattr(plan.terms, name) for name in TERMS],
        "constraint": plan.constraint,
        "limits": list(plan.limits),
        "iterations": plan.iterations,
        "halt": plan.halt,
        "seconds": cycle.seconds,
        "host": cycle.host,
        "wait": cycle.wait,
        "stopped": list(cycle.stopped),
    }


def _to_cycle(fields: dict[str, Any]) -> TowCycle:
    plan = TowingPlan(
        _rows(fields["estimate"], 1)[:, 0],
        _rows(fields["angles"], 1)[:, 0],
        _rows(fields["link_poses"], 3),
        _rows(fields["held_poses"], 3),
        PlanTerms(*to_finite_floats(fields["terms"])),
        to_finite_floats((fields["constraint"],))[0],
        tuple(map(str, fields["limits"])),
        int(fields["iterations"]),
        str(fields["halt"]),
    )
    moment, along, pace, seconds, host = to_finite_floats(
        fields[name] for name in ("time", "along", "pace", "seconds", "host")
    )
    return TowCycle(
        moment,
        along,
        pace,
        **{name: _rows(fields[name], columns) for name, columns in CYCLE_ROWS.items()},
        plan=plan,
        seconds=seconds,
        host=host,
        wait=str(fields["wait"]),
        stopped=tuple(map(int, fields["stopped"])),
    )


def _from_truth(truth: TowTruth) -> dict[str, Any]:
    return {
        "time": truth.time,
        "line": _flat(truth.line),
        "poses": _flat(truth.poses),
        "welder_force": _flat(truth.welder_force),
        "vehicle_forces": _flat(truth.vehicle_forces),
        "passers_by": _flat(truth.passers_by),
        "touches": list(truth.touches),
    }


def _to_truth(fields: dict[str, Any]) -> TowTruth:
    return TowTruth(
        to_finite_floats((fields["time"],))[0],
        _rows(fields["line"], 2),
        _rows(fields["poses"], 3),
        _rows(fields["welder_force"], 3)[0],
        _rows(fields["vehicle_forces"], 1)[:, 0],
        _rows(fields["passers_by"], 3),
        tuple(map(str, fields["touches"])),
    )


CYCLE: Final = make_json_topic(
    "/tow/cycle",
    "tjscan.TowCycle",
    {
        **dict.fromkeys(("time", "along", "pace", "constraint", "seconds", "host"), NUMBER_SCHEMA),
        **dict.fromkeys(
            (*CYCLE_ROWS, "estimate", "angles", "link_poses", "held_poses", "terms", "stopped"),
            NUMBERS_SCHEMA,
        ),
        "limits": TEXTS_SCHEMA,
        "iterations": INTEGER_SCHEMA,
        "halt": TEXT_SCHEMA,
        "wait": TEXT_SCHEMA,
    },
    _from_cycle,
    _to_cycle,
)
"""A cycle; metres, radians, seconds; tables row by row. A pose that did not come is `UNSEEN`."""

TRUTH: Final = make_json_topic(
    "/simulation/tow",
    "tjscan.SimulatedTow",
    {
        "time": NUMBER_SCHEMA,
        **dict.fromkeys(
            ("line", "poses", "welder_force", "vehicle_forces", "passers_by"), NUMBERS_SCHEMA
        ),
        "touches": TEXTS_SCHEMA,
    },
    _from_truth,
    _to_truth,
)
"""What a simulation truly did; no algorithm reads it."""

LOG: Final = make_protobuf_topic("/log", Log)

TOPICS: Final[tuple[Topic[Any], ...]] = (CYCLE, TRUTH, LOG)
"""Everything that a tow records."""


class RecordingTowJournal:
    """The journal that writes a tow's recording.

    Parameters
    ----------
    recording : RecordingWriter
        Open, with `TOPICS`.
    truth : callable, optional
        Gives the `TowTruth` of a simulation.
    """

    def __init__(
        self, recording: RecordingWriter, truth: Callable[[], TowTruth] | None = None
    ) -> None:
        self._recording, self._truth = recording, truth
        self._start = self._now = time.time_ns()
        self._first: float | None = None
        self._waiting: list[tuple[int, Topic[Any], Any]] = []
        self._cycles = 0

    @hold_ctrl_c()
    def record_cycle(self, cycle: TowCycle) -> None:
        """Write a cycle, and what a simulation knows then."""
        if self._first is None:
            self._first = cycle.time
        self._now = self._start + round(1e9 * (cycle.time - self._first))
        self._waiting.append((self._now, CYCLE, cycle))
        if self._truth is not None:
            self._waiting.append((self._now, TRUTH, self._truth()))
        self._cycles += 1
        if self._cycles % CYCLES_TOGETHER == 1:
            self.flush()

    @hold_ctrl_c()
    def record_event(self, name: str, detail: str) -> None:
        """Write an event, and bring everything until then to the disk."""
        level = Log.Level.ERROR if name == "stop" else Log.Level.INFO
        self._waiting.append((self._now, LOG, event_log_message(self._now, level, name, detail)))
        self.flush()
        self._recording.sync_to_disk()

    @hold_ctrl_c()
    def flush(self) -> None:
        """Write what waits."""
        waiting, self._waiting = self._waiting, []
        self._recording.write_timed(waiting)


@contextmanager
def record_tow(
    file: Path,
    origin: JobSnapshot | None = None,
    truth: Callable[[], TowTruth] | None = None,
) -> Iterator[RecordingTowJournal]:
    """Record a tow into a new file while the block runs; see `RecordingTowJournal`.

    Raises
    ------
    RecordingError
        On entering or writing, if the file can't be written.
    """
    with RecordingWriter(file, TOPICS, origin) as recording:
        journal = RecordingTowJournal(recording, truth)
        try:
            yield journal
        finally:
            journal.flush()


def read_tow(directory: Path) -> Iterator[TowCycle | TowTruth | RecordedEvent]:
    """Yield everything that a tow recorded, in its order, over all its parts.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    files = recording_files(directory, TOW_RECORDING)
    for entry in chain.from_iterable(read_messages(file, TOPICS) for file in files):
        if entry.topic is LOG:
            yield RecordedEvent(entry.when, entry.message.name, entry.message.message)
        else:
            yield entry.message
