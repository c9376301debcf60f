"""What a tow reports while it runs, and its recording: written, and read again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np

from tjscan.core.frames import Array, ArrayForm, PlanarPoints, PlanarPoses
from tjscan.core.signals import delay_ctrl_c
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import LOG_TOPIC, RecordingWriter, RunEvent
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_messages
from tjscan.recording.topic import Topic
from tjscan.towing.shape.plan import TowingPlan

WELDED_EVENT: Final = "welded"
"""Name of the event that ends a tow: the whole seam was welded."""


@dataclass(frozen=True, slots=True, eq=False)
class TowCycle:
    """One cycle of the loop: what was measured, estimated, planned and asked for.

    Parameters
    ----------
    time : float
        On the team's clock, seconds.
    along : float
        Where the welder is to be along the seam at the cycle's end, metres.
    pace : float
        Share of the welding speed at which it goes, 0 if it waits.
    seen : ndarray, shape (vehicles, 3)
        Poses as measured since the last cycle: x, y, metres, heading, radians; NaN if none came.
    poses : ndarray, shape (vehicles, 3)
        Poses as estimated.
    sigmas : ndarray, shape (vehicles, 2)
        Standard deviations of position and heading, metres and radians.
    targets : ndarray, shape (vehicles, 3)
        Where the vehicles were sent to.
    asked : ndarray, shape (vehicles, 3)
        Twists asked for: speed, turn rate, sideways; m/s and rad/s.
    obstacles : ndarray, shape (obstacles, 5)
        x, y, radius, metres, and velocity along x and y, m/s.
    plan : TowingPlan
    seconds : float
        Of a processor that the plan took.
    host : float
        Seconds of a processor that the program took since the loop began.
    wait : str
        Why the welder waits, in a sentence; empty if it welds.
    stopped : tuple of int
        Vehicles that stopped for good, by number from 0 at the root.
    forces : ndarray, shape (vehicles, 2)
        Of the cable on them as estimated, mean of the last seconds, newton; empty if not known.
    tension : float
        Largest along the cable, likewise.
    pushes : ndarray, shape (vehicles, 3)
        Of the vehicles' wheels as their drives report them, along x and y, newton, and the moment,
        N m; NaN if not known.
    """

    time: float
    along: float
    pace: float
    seen: Annotated[Array, ArrayForm((-1, 3), may_be_unknown=True)]
    poses: PlanarPoses
    sigmas: PlanarPoints
    targets: PlanarPoses
    asked: PlanarPoses
    obstacles: Annotated[Array, ArrayForm((-1, 5))]
    plan: TowingPlan
    seconds: float
    host: float
    wait: str = ""
    stopped: tuple[int, ...] = ()
    forces: PlanarPoints = field(default_factory=lambda: np.zeros((0, 2)))
    tension: float = 0.0
    pushes: Annotated[Array, ArrayForm((-1, 3), may_be_unknown=True)] = field(
        default_factory=lambda: np.zeros((0, 3))
    )


@dataclass(frozen=True, slots=True, eq=False)
class TowTruth:
    """What a simulation knows of cable and vehicles; no algorithm sees it.

    Parameters
    ----------
    time : float
        Seconds.
    line : ndarray, shape (N + 1, 2)
        Of the cable's links, from the root to the tip, metres.
    poses : ndarray, shape (vehicles, 3)
        Of the vehicles.
    welder_force : ndarray, shape (3,)
        Of the cable on the welder: newton along x and y, and N m.
    vehicle_forces : ndarray, shape (vehicles,)
        With which each vehicle pulls at the floor, newton.
    passers_by : ndarray, shape (obstacles, 3)
        x, y and radius of what moves, metres.
    touches : tuple of str
        What touched what since the last record, in words.
    """

    time: float
    line: PlanarPoints
    poses: PlanarPoses
    welder_force: Array
    vehicle_forces: Array
    passers_by: PlanarPoses
    touches: tuple[str, ...] = ()


TOW_RECORDING: Final = "tow"
"""What the names of a tow's recordings begin with."""

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


class TowRecording(RecordingWriter):
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

    @delay_ctrl_c()
    def record(self, message: object) -> None:
        """Write a cycle, and what a simulation knows then; or an event, up to the disk."""
        match message:
            case TowCycle():
                self.set_time(message.time)
                plan = replace(message.plan, rest=None, deviations=None, forces=None, tension=None)
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
