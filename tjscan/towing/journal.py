"""What a tow reports while it runs, for listeners that write it down or show it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from tjscan.core.array_fields import ArrayForm, PlanarPoints, PlanarPoses
from tjscan.core.frames import Array
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
