"""The world of a simulated tow, as a job describes it, and its faults as they happen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from tjscan.core.frames import Array
from tjscan.job.tow.job import FaultSettings, TowJob
from tjscan.towing.tables import ObstacleSettings
from tjscan.vehicle.cable.model import CableModel, PasserBy, TowingWorldModel
from tjscan.vehicle.pose_disturbance import PoseFault

if TYPE_CHECKING:
    from tjscan.vehicle.simulated_team import SimulatedTeam
    from tjscan.vehicle.vehicle import Vehicle

ROUND_OBSTACLE_CORNERS: Final = 24
"""Of the polygon that replaces a round obstacle."""


def towing_world_of_job(job: TowJob) -> TowingWorldModel:
    """The simulated work area that a job describes."""
    cable = job.cable
    model = CableModel(
        links=cable.links,
        link_length=cable.link,
        radius=cable.radius,
        link_mass=cable.mass * cable.link,
        stiffness=cable.stiffness,
        damping=cable.damping,
        friction=cable.friction,
        root=job.root.pose,
        held=job.held_links,
    )
    walls = [np.array(ring) for ring in (job.area.outline, *job.area.holes)]
    walls += [_polygon_of(one) for one in job.obstacles if not one.speed]
    return TowingWorldModel(
        cable=model,
        vehicle=replace(
            job.simulation.towing_vehicle,
            body_radius=job.vehicles.radius,
            force=job.vehicles.force,
        ),
        walls=tuple(walls),
        passers_by=tuple(
            PasserBy(one.radius, np.array(one.points), one.speed, one.start)
            for one in job.obstacles
            if one.speed
        ),
        exempt_links=job.limits.free_links,
    )


def _polygon_of(obstacle: ObstacleSettings) -> Array:
    (x, y), turns = (
        obstacle.points[0],
        np.linspace(0, 2 * np.pi, ROUND_OBSTACLE_CORNERS, endpoint=False),
    )
    return np.column_stack(
        (x + obstacle.radius * np.cos(turns), y + obstacle.radius * np.sin(turns))
    )


class FaultyTeam:
    """A simulated team in whose world the faults of a job happen; a context manager.

    Parameters
    ----------
    team : SimulatedTeam
    localisation : object
        The simulated one, which takes faults of poses.
    faults : sequence of FaultSettings
    """

    def __init__(
        self, team: SimulatedTeam, localisation: Any, faults: Sequence[FaultSettings]
    ) -> None:
        self._team, self._localisation = team, localisation
        self._begin = sorted(faults, key=lambda fault: fault.at)
        self._end: list[FaultSettings] = []

    def __enter__(self) -> Self:
        self._team.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._team.__exit__(*error)

    @property
    def vehicles(self) -> Sequence[Vehicle]:
        """All of them."""
        return self._team.vehicles

    @property
    def time(self) -> float:
        """Seconds on the world's clock."""
        return self._team.time

    def advance_to(self, time: float) -> Any:
        """Let what is due go wrong, or right again, and the world go on."""
        now = self._team.time
        while self._begin and self._begin[0].at <= now:
            fault = self._begin.pop(0)
            self._set(fault, begins=True)
            if fault.seconds is not None:
                self._end.append(fault)
        for fault in [one for one in self._end if one.at + (one.seconds or 0.0) <= now]:
            self._set(fault, begins=False)
            self._end.remove(fault)
        return self._team.advance_to(time)

    def _set(self, fault: FaultSettings, *, begins: bool) -> None:
        world = self._team.world
        which = None if fault.vehicle is None else fault.vehicle - 1
        if fault.kind == "jam":
            (world.jam if begins else world.release)(which or 0)
        elif fault.kind == "push":
            if begins:
                world.push(which or 0, *fault.push)
        elif fault.kind == "passer-by-stands":
            world.hold_passer_by(which or 0, begins)
        else:
            poses = self._localisation.poses.faults
            (poses.add if begins else poses.discard)((PoseFault(fault.kind), which))
