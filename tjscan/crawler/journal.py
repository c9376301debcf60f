"""What a crawl reports while it runs, and its recording: written, and read again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from math import isfinite, nan
from pathlib import Path
from typing import Any, Final

from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from tjscan.core.bead_segments import BeadSegments
from tjscan.core.errors import RecordingError
from tjscan.core.frames import Array, FloatOrNan, array_dataclass
from tjscan.core.signals import delay_ctrl_c
from tjscan.core.sourced import SourcedNumber
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import SlipEstimate
from tjscan.crawler.torch_trace import TorchTrace
from tjscan.laser.profile import Profile
from tjscan.recording import foxglove
from tjscan.recording.foxglove import PROFILE_TOPIC
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import LOG_TOPIC, RecordingWriter, RunEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import RecordedMessage, read_messages
from tjscan.recording.topic import Topic
from tjscan.vehicle.vehicle import AT_REST, Twist, VehicleState

SET_DOWN_EVENT: Final = "set-down"
"""Name of the event that states where a vehicle was set down again, by its operator."""


@dataclass(frozen=True, slots=True)
class CrawlCycle:
    """One cycle of the control loop: what was measured, estimated and asked for.

    Parameters
    ----------
    phase : Phase
        What the crawler was doing.
    number : int
        Of the pass, from 1; 0 before the first.
    travel : float
        Along the joint from where the weld begins, by the encoders, metres.
    state : VehicleState
        What the vehicle reports.
    commanded : Twist
        What it was asked for until then.
    torch : TorchEstimate
        Estimate of where the torch's zero is beside the joint.
    torch_y : float
        Position of the torch's axis, to the right of its zero, metres.
    path : float
        How far beside the joint's centre the pass has the torch at this moment, metres.
    arc : bool
        Whether the arc burns.
    d, d_sigma : float, optional
        Laser minus joint as read, and its standard deviation, metres; NaN if it was not read.
    slip : SlipEstimate, optional
        Estimate of the vehicle's slip, if the method has any.
    profile : Profile, optional
        What the laser saw; of a recording in one cycle a millimetre.
    jog : float, optional
        How much of the path a person added by hand, metres.
    laser_to_centre, laser_to_centre_sigma : float, optional
        How far the laser is ahead of the centre of rotation by the paper's filter, and its standard
        deviation, metres; NaN by a method that takes it as known.
    """

    phase: Phase
    number: int
    travel: float
    state: VehicleState
    commanded: Twist
    torch: TorchEstimate
    torch_y: float
    path: float
    arc: bool
    d: FloatOrNan = nan
    d_sigma: FloatOrNan = nan
    slip: SlipEstimate | None = None
    profile: Profile | None = None
    jog: float = 0.0
    laser_to_centre: FloatOrNan = nan
    laser_to_centre_sigma: FloatOrNan = nan

    @property
    def was_read(self) -> bool:
        """Whether the joint was read."""
        return isfinite(self.d)

    @property
    def deviation(self) -> float:
        """Of the torch from its path, as estimated, metres, positive to the right."""
        return self.torch.offset + self.torch_y - self.path


def is_by_hand(phase: Phase, commanded: Twist) -> bool:
    """Whether a vehicle is driven by hand: nothing else moves it before a crawl begins."""
    return phase is Phase.MANUAL and commanded != AT_REST


@dataclass(frozen=True, slots=True)
class SimulatedPlace:
    """Where a simulated vehicle and its torch truly are.

    Parameters
    ----------
    pose_w : tuple of float
        x, y in metres and heading in radians of the vehicle, in frame w.
    torch : tuple of float
        Of the torch's zero: along the joint and to the right of it, metres.
    """

    pose_w: tuple[float, ...]
    torch: tuple[float, ...]


@array_dataclass
class PlannedPass:
    """A pass as it was planned at *ready* from what the way back showed.

    Parameters
    ----------
    number : int
        From 1.
    unread : float
        Share of the weld that the look did not show, where the bead model goes on.
    gain, torch_offset, shrinkage : float
        What looks taught until then: deposition over what wire and speed give, where the wire
        points beside the torch, metres, and shrinkage over that of the model.
    deviation, deviation_sigma : float or None
        Of the wire from the last pass's path, to the right, as the look shows it, and its standard
        deviation, metres; None if it does not show it.
    s, speed, offset, height, weave, feed : ndarray, shape (n,)
        Rows along the weld, offsets from the bare joint's middle; see `BeadSegments`.
    closed : ndarray, shape (n,), optional
        How far the joint has closed since it was bare, metres; older programs did not state it.
    at_limit : float, optional
        Share of the weld on which a limit of the WPS leaves more than a little to later passes.
    behind : float, optional
        By how much farther than from the laser to the torch the tracks run until the torch is at
        what the laser saw, metres, as the first bead's ends show it; older programs did not state
        it.
    """

    number: int
    unread: float
    gain: float
    torch_offset: float
    shrinkage: float
    deviation: float | None
    deviation_sigma: float | None
    s: Array
    speed: Array
    offset: Array
    height: Array
    weave: Array
    feed: Array
    closed: Array | None = None
    at_limit: float | None = None
    behind: float | None = None

    @property
    def table(self) -> BeadSegments:
        """Its rows."""
        return BeadSegments(self.s, self.speed, self.offset, self.height, self.weave, self.feed)

    @property
    def text(self) -> str:
        """What it is, in words."""
        speed, feed = 1e3 * self.speed, 60 * self.feed
        limit = "" if not self.at_limit else f", {self.at_limit:.0%} of it at a limit of the WPS"
        behind = "" if not self.behind else f", the torch {1e3 * self.behind:.1f} mm behind"
        return (
            f"pass {self.number} at {speed.min():.1f} to {speed.max():.1f} mm/s, wire feed "
            f"{feed.min():.1f} to {feed.max():.1f} m/min{limit}; {1 - self.unread:.0%} was read"
            f"{behind}"
        )


@dataclass(frozen=True, slots=True)
class ArcReading:
    """What the power source reported while an arc burned.

    Parameters
    ----------
    number : int
        Of the pass, from 1.
    travel : float
        Along the weld, metres.
    raised : float
        By how much the current has the torch over the plan, metres.
    current, voltage, feed, gas : SourcedNumber
        A, V, m/s and m³/s.
    """

    number: int
    travel: float
    raised: float
    current: SourcedNumber
    voltage: SourcedNumber
    feed: SourcedNumber
    gas: SourcedNumber


CRAWL_RECORDING: Final = "crawl"
"""What the names of a crawl's recordings begin with."""

WARNING_EVENT: Final = "warning"
"""Name of an event that warns of what may go wrong."""

CYCLES_TOGETHER: Final = 50
"""Cycles that are written at once."""

LONGEST_WRITE_DELAY: Final = 500_000_000
"""Nanoseconds that cycles wait: a killed program loses no more, and never the first cycle of an arc
that was struck, without which it would not be known that a pass was begun."""

PROFILE_SPACING: Final = 1e-3
"""Metres of travel between two profiles that are recorded."""

CYCLES_PER_TRUTH: Final = 10
"""Cycles for which a simulation's truth is recorded once."""

CYCLE_TOPIC: Final = Topic.of("/crawl/cycle", CrawlCycle)
"""A cycle. The points of its profile, if it has one, are the message on `PROFILE_TOPIC` before it;
slip is in the last cycle of those that are written at once."""

PLACE_TOPIC: Final = Topic.of("/simulation/torch", SimulatedPlace)
"""Where a simulated vehicle truly is; no algorithm reads it."""

TRACE_TOPIC: Final = Topic.of("/crawl/torch", TorchTrace)
"""Where the torch was along a pass, once the way back is done, or it was stopped."""

PLANNED_PASS_TOPIC: Final = Topic.of("/crawl/pass", PlannedPass)
"""A pass that was planned from a look."""

ARC_TOPIC: Final = Topic.of("/crawl/arc", ArcReading)
"""The power source, every tenth cycle of an arc."""

TORCH_EVENT: Final = "torch"
"""Name of the event that states the same in words."""

BEND_EVENT: Final = "bend"
"""Name of the event after which the joint is taken for one that bends."""

CRAWL_TOPICS: Final[tuple[Topic[Any], ...]] = (
    CYCLE_TOPIC,
    PLACE_TOPIC,
    TRACE_TOPIC,
    PLANNED_PASS_TOPIC,
    ARC_TOPIC,
    PROFILE_TOPIC,
    LOG_TOPIC,
)
"""Everything that a crawl records."""


class CrawlRecording(RecordingWriter):
    """The journal that writes a crawl's recording; a context manager.

    Parameters
    ----------
    file, origin
        As of `RecordingWriter`.
    truth : callable, optional
        Gives the `SimulatedPlace` of a simulation.
    """

    def __init__(
        self,
        file: Path,
        origin: JobSnapshot | None = None,
        truth: Callable[[], SimulatedPlace] | None = None,
    ) -> None:
        super().__init__(file, CRAWL_TOPICS, origin, errors=(Phase.STOP,))
        self._truth = truth
        self._cycles = 0
        self._last_profile: tuple[Phase | None, float] = None, 0.0
        self._arc = False

    @delay_ctrl_c()
    def record(self, message: object) -> None:
        """Write a cycle, and one of its profiles a millimetre; or an event, up to the disk."""
        match message:
            case CrawlCycle():
                self._add_cycle(message)
            case TorchTrace():
                self.add(TRACE_TOPIC, message)
            case ArcReading():
                self.add(ARC_TOPIC, message)
            case PlannedPass():
                self.add(PLANNED_PASS_TOPIC, message)
                self.flush()
            case RunEvent():
                self.add_event(message)
                if self._truth is not None and self._cycles:  # a place belongs to a cycle
                    self.add(PLACE_TOPIC, self._truth())
                self.flush()
                self.sync_to_disk()

    @delay_ctrl_c()
    def flush(self) -> None:
        """Write what waits, slip with the last cycle only.

        Whatever a recording ends with, a stop or a killed program, its last cycle has an estimate
        of slip of its own: an older one contradicts what the laser shows there, and would lead a
        filter astray that is sure of it.
        """
        cycles = [k for k, (_, topic, _) in enumerate(self.waiting) if topic is CYCLE_TOPIC]
        for k in cycles[:-1]:
            now, topic, cycle = self.waiting[k]
            self.waiting[k] = now, topic, replace(cycle, slip=None)
        super().flush()

    def _add_cycle(self, cycle: CrawlCycle) -> None:
        self.set_time(cycle.state.time)
        recorded = cycle if self._is_profile_due(cycle) else replace(cycle, profile=None)
        self.waiting.extend(cycle_messages(self.now, recorded))
        if self._truth is not None and self._cycles % CYCLES_PER_TRUTH == 0:
            self.add(PLACE_TOPIC, self._truth())
        self._cycles += 1
        struck, self._arc = cycle.arc and not self._arc, cycle.arc
        is_last = self._cycles % CYCLES_TOGETHER == 0
        if is_last or struck or self.now - self.waiting[0][0] >= LONGEST_WRITE_DELAY:
            self.flush()

    def _is_profile_due(self, cycle: CrawlCycle) -> bool:
        """Whether the cycle's profile is recorded: the first of a phase, then one a millimetre."""
        phase, travel = self._last_profile
        near = cycle.phase is phase and abs(cycle.travel - travel) < PROFILE_SPACING
        if cycle.profile is None or near:
            return False
        self._last_profile = cycle.phase, cycle.travel
        return True


def cycle_messages(time: int, cycle: CrawlCycle) -> Iterator[tuple[int, Topic[Any], Any]]:
    """Messages that record a cycle, at a time in nanoseconds since 1970."""
    if cycle.profile is not None:
        yield time, PROFILE_TOPIC, foxglove.profile_to_cloud_message(time, cycle.profile)
    yield time, CYCLE_TOPIC, cycle


def read_crawl(
    directory: Path,
) -> Iterator[CrawlCycle | RunEvent | SimulatedPlace | TorchTrace | PlannedPass | ArcReading]:
    """Yield everything that a crawl recorded, in its order, over all its parts.

    A cycle has the slip that was recorded last.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    slip: SlipEstimate | None = None
    parts = map(read_crawl_messages, recording_files(directory, CRAWL_RECORDING))
    for entry in chain.from_iterable(parts):
        if isinstance(entry.message, CrawlCycle):
            slip = entry.message.slip or slip
            yield replace(entry.message, slip=slip)
        else:
            yield RunEvent.of_log(entry) if entry.topic is LOG_TOPIC else entry.message


def read_crawl_messages(file: Path) -> Iterator[RecordedMessage]:
    """Yield the messages of one file; each cycle has the points of its profile.

    Raises
    ------
    ConfigurationError, RecordingError
        As `read_messages` does.
    """
    cloud = PointCloud()
    for entry in read_messages(file, CRAWL_TOPICS):
        if entry.topic is PROFILE_TOPIC:
            cloud = entry.message
        elif isinstance(entry.message, CrawlCycle) and entry.message.profile is not None:
            try:
                profile = foxglove.profile_from_cloud_message(cloud, entry.message.profile)
            except (KeyError, ValueError) as error:
                raise RecordingError(f"{file}: is damaged: {error}") from error
            yield replace(entry, message=replace(entry.message, profile=profile))
        else:
            yield entry
