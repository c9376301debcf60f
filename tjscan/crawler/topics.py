"""What a crawl records, and how its recording is read again."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from math import isfinite, nan
from pathlib import Path
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from tjscan.core.signals import hold_ctrl_c
from tjscan.crawler.journal import CrawlCycle, SimulatedPlace
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import SlipEstimate
from tjscan.crawler.slip_model import STATE_COUNT
from tjscan.laser.profile import Profile
from tjscan.recording.event import RecordedEvent
from tjscan.recording.foxglove import (
    event_log_message,
    profile_from_cloud_message,
    profile_to_cloud_message,
)
from tjscan.recording.header import JobSnapshot
from tjscan.recording.json_numbers import to_finite_floats
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import (
    BOOLEAN_SCHEMA,
    INTEGER_SCHEMA,
    NUMBER_SCHEMA,
    NUMBERS_SCHEMA,
    TEXT_SCHEMA,
    Topic,
    make_json_topic,
    make_protobuf_topic,
)
from tjscan.recording.writer import RecordingWriter
from tjscan.vehicle.vehicle import Twist, VehicleState

CRAWL_RECORDING: Final = "crawl"
"""What the names of a crawl's recordings begin with."""

REPLAY: Final = "replay"
"""Name of the event that begins a recording whose estimates were made anew."""

WARNING: Final = "warning"
"""Name of an event that says what may go wrong."""

CYCLES_TOGETHER: Final = 50
"""Cycles that are written at once."""

LONGEST_WAIT: Final = 500_000_000
"""Nanoseconds that cycles wait: no more is lost where the program is killed, and of an arc that was
struck never its first cycle, without which it would not be known that a pass was begun."""

PROFILE_SPACING: Final = 1e-3
"""Metres of travel between two profiles that are recorded."""

CYCLES_PER_TRUTH: Final = 10
"""Cycles for which a simulation's truth is recorded once."""

NUMBERS: Final = (
    "travel",
    "vehicle_time",
    "offset",
    "offset_sigma",
    "heading",
    "torch_y",
    "path",
)
"""Fields of a cycle that are one number each."""


def _from_cycle(cycle: CrawlCycle) -> dict[str, Any]:
    state, odometry, torch = cycle.state, cycle.state.odometry, cycle.torch
    return {
        "phase": str(cycle.phase),
        "pass": cycle.number,
        "travel": cycle.travel,
        "vehicle_time": state.time,
        "odometry": [odometry.speed, odometry.turn_rate],
        "torques": list(state.torques),
        "proximity": [value if isfinite(value) else -1.0 for value in state.proximity],
        "fault": state.fault,
        "commanded": [cycle.commanded.speed, cycle.commanded.turn_rate],
        "offset": torch.offset,
        "offset_sigma": torch.sigma,
        "heading": torch.heading,
        "torch_y": cycle.torch_y,
        "path": cycle.path,
        "arc": cycle.arc,
        "reading": [] if not isfinite(cycle.d) else [cycle.d, cycle.d_sigma],
    }


def _to_cycle(fields: dict[str, Any]) -> CrawlCycle:
    numbers = {name: to_finite_floats((fields[name],))[0] for name in NUMBERS}
    speed, turn_rate = to_finite_floats(fields["odometry"])
    asked_speed, asked_turn = to_finite_floats(fields["commanded"])
    d, d_sigma = to_finite_floats(fields["reading"]) or (nan, nan)
    state = VehicleState(
        numbers["vehicle_time"],
        Twist(speed, turn_rate),
        tuple(to_finite_floats(fields["torques"])),
        tuple(nan if value < 0 else value for value in to_finite_floats(fields["proximity"])),
        str(fields["fault"]),
    )
    return CrawlCycle(
        Phase(fields["phase"]),
        int(fields["pass"]),
        numbers["travel"],
        state,
        Twist(asked_speed, asked_turn),
        TorchEstimate(numbers["offset"], numbers["offset_sigma"], numbers["heading"]),
        numbers["torch_y"],
        numbers["path"],
        bool(fields["arc"]),
        d,
        d_sigma,
    )


def _from_slip(slip: SlipEstimate) -> dict[str, Any]:
    return {"state": slip.x.tolist(), "covariance": slip.P.ravel().tolist()}


def _to_slip(fields: dict[str, Any]) -> SlipEstimate | None:
    x = np.array(to_finite_floats(fields["state"]))
    P = np.array(to_finite_floats(fields["covariance"]))
    if len(x) != STATE_COUNT and len(P) == len(x) ** 2:
        return None  # of an earlier estimator, with other quantities
    return SlipEstimate(x.reshape(STATE_COUNT), P.reshape(STATE_COUNT, STATE_COUNT))


CYCLE: Final = make_json_topic(
    "/crawl/cycle",
    "tjscan.CrawlCycle",
    {
        "phase": TEXT_SCHEMA,
        "pass": INTEGER_SCHEMA,
        **dict.fromkeys(NUMBERS, NUMBER_SCHEMA),
        **dict.fromkeys(
            ("odometry", "torques", "proximity", "commanded", "reading"), NUMBERS_SCHEMA
        ),
        "fault": TEXT_SCHEMA,
        "arc": BOOLEAN_SCHEMA,
    },
    _from_cycle,
    _to_cycle,
)
"""A cycle; metres, radians, seconds. A corner whose sensor saw nothing is -1."""

SLIP: Final[Topic[Any]] = make_json_topic(
    "/crawl/slip",
    "tjscan.CrawlSlip",
    {"state": NUMBERS_SCHEMA, "covariance": NUMBERS_SCHEMA},
    _from_slip,
    _to_slip,
)
"""What is estimated of slip, as `SlipState` orders it; None where an earlier estimator did."""

TRUTH: Final = make_json_topic(
    "/simulation/torch",
    "tjscan.SimulatedTorch",
    {"pose": NUMBERS_SCHEMA, "place": NUMBERS_SCHEMA},
    lambda truth: {"pose": list(truth.pose_w), "place": list(truth.torch)},
    lambda fields: SimulatedPlace(
        tuple(to_finite_floats(fields["pose"])), tuple(to_finite_floats(fields["place"]))
    ),
)
"""Where a simulated vehicle truly is; no algorithm reads it."""

PROFILE: Final = make_protobuf_topic("/profile", PointCloud)
LOG: Final = make_protobuf_topic("/log", Log)

TOPICS: Final[tuple[Topic[Any], ...]] = (CYCLE, SLIP, TRUTH, PROFILE, LOG)
"""Everything that a crawl records."""


class RecordingCrawlJournal:
    """The journal that writes a crawl's recording.

    Parameters
    ----------
    recording : RecordingWriter
        Open, with `TOPICS`.
    truth : callable, optional
        Gives the `SimulatedPlace` of a simulation.
    """

    def __init__(
        self, recording: RecordingWriter, truth: Callable[[], SimulatedPlace] | None = None
    ) -> None:
        self._recording, self._truth = recording, truth
        self._start = self._now = time.time_ns()
        self._first: float | None = None
        self._waiting: list[tuple[int, Topic[Any], Any]] = []
        self._cycles = 0
        self._profile_at: tuple[Phase, float] | None = None
        self._arc = False

    @hold_ctrl_c()
    def record_cycle(self, cycle: CrawlCycle, profile: Profile | None) -> None:
        """Write a cycle, and of its profiles one a millimetre."""
        if self._first is None:
            self._first = cycle.state.time
        now = self._now = self._start + round(1e9 * (cycle.state.time - self._first))
        self._waiting.append((now, CYCLE, cycle))
        last = self._profile_at
        new = (
            last is None
            or last[0] is not cycle.phase
            or abs(cycle.travel - last[1]) >= PROFILE_SPACING
        )
        if profile is not None and new:
            self._profile_at = cycle.phase, cycle.travel
            self._waiting.append((now, PROFILE, profile_to_cloud_message(now, profile)))
        if self._truth is not None and self._cycles % CYCLES_PER_TRUTH == 0:
            self._waiting.append((now, TRUTH, self._truth()))
        self._cycles += 1
        struck, self._arc = cycle.arc and not self._arc, cycle.arc
        is_last = self._cycles % CYCLES_TOGETHER == 0
        if is_last or struck or now - self._waiting[0][0] >= LONGEST_WAIT:
            self.flush()

    @hold_ctrl_c()
    def record_event(self, name: str, detail: str) -> None:
        """Write an event, and bring everything until then to the disk."""
        level = Log.Level.ERROR if name == Phase.STOP else Log.Level.INFO
        self._waiting.append((self._now, LOG, event_log_message(self._now, level, name, detail)))
        if self._truth is not None and self._first is not None:  # a place belongs to a cycle
            self._waiting.append((self._now, TRUTH, self._truth()))
        self.flush()
        self._recording.sync_to_disk()

    @hold_ctrl_c()
    def flush(self) -> None:
        """Write what waits."""
        waiting, self._waiting = self._waiting, []
        self._recording.write_timed(with_last_slip(waiting))


def with_last_slip(
    messages: Sequence[tuple[int, Topic[Any], Any]],
) -> Iterator[tuple[int, Topic[Any], Any]]:
    """Messages that are written at once, and before the last cycle what is estimated of slip there.

    So whatever a recording ends with, a stop or a killed program, its last cycle has a estimate of
    its own: an older one contradicts what the laser shows there, and a filter that is sure of it
    would be led astray.
    """
    cycles = [at for at, (_, topic, _) in enumerate(messages) if topic is CYCLE]
    for at, (time_ns, topic, message) in enumerate(messages):
        if cycles and at == cycles[-1] and message.slip is not None:
            yield time_ns, SLIP, message.slip
        yield time_ns, topic, message


@contextmanager
def record_crawl(
    file: Path,
    origin: JobSnapshot | None = None,
    truth: Callable[[], SimulatedPlace] | None = None,
) -> Iterator[RecordingCrawlJournal]:
    """Record a crawl into a new file while the block runs; see `RecordingCrawlJournal`.

    Raises
    ------
    RecordingError
        On entering or writing, if the file can't be written.
    """
    with RecordingWriter(file, TOPICS, origin) as recording:
        journal = RecordingCrawlJournal(recording, truth)
        try:
            yield journal
        finally:
            journal.flush()


@dataclass(frozen=True, slots=True)
class CrawlProfile:
    """A recorded profile, and the cycle it belongs to.

    Parameters
    ----------
    cycle : CrawlCycle
    profile : Profile
    """

    cycle: CrawlCycle
    profile: Profile


def read_crawl(
    directory: Path,
) -> Iterator[CrawlCycle | CrawlProfile | RecordedEvent | SimulatedPlace]:
    """Yield everything that a crawl recorded, in its order, over all its parts.

    A cycle has the slip that was recorded last before it.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    files = recording_files(directory, CRAWL_RECORDING)
    slip: SlipEstimate | None = None
    last: CrawlCycle | None = None
    for entry in chain.from_iterable(read_messages(file, TOPICS) for file in files):
        if entry.topic is SLIP:
            slip = entry.message
        elif entry.topic is CYCLE:
            last = replace(entry.message, slip=slip)
            yield last
        elif entry.topic is PROFILE and last is not None:
            profile = profile_from_cloud_message(entry.message, last.state.time)
            yield CrawlProfile(last, profile)
        elif entry.topic is TRUTH:
            yield entry.message
        elif entry.topic is LOG:
            yield RecordedEvent(entry.when, entry.message.name, entry.message.message)
