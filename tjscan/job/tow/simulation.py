"""The world of a simulated tow, as a job describes it, and its faults as they happen.

MuJoCo is loaded with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from tjscan.core.errors import VehicleFault
from tjscan.core.frames import Array
from tjscan.job.tow.job import FaultSettings, TowJob
from tjscan.towing.tables import ObstacleSettings
from tjscan.vehicle.cable.model import CableModel, PasserBy, TowingVehicleModel, TowingWorldModel
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.pose_disturbance import PoseFault
from tjscan.vehicle.simulated_team import SimulatedTeam
from tjscan.vehicle.vehicle import VehicleState

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
    walls += [_obstacle_polygon(one) for one in job.obstacles if not one.speed]
    moving = [one for one in job.obstacles if one.speed]
    stated = asdict(job.simulation.towing_vehicle)
    vehicle = {"body_radius": job.vehicles.radius, "force": job.vehicles.force}
    vehicle |= {key: value for key, value in stated.items() if value is not None}
    return TowingWorldModel(
        cable=model,
        vehicle=TowingVehicleModel(**vehicle),
        walls=tuple(walls),
        passers_by=tuple(
            PasserBy(one.radius, np.array(one.points), one.speed, one.start) for one in moving
        ),
        exempt_links=job.limits.free_links,
    )


def _obstacle_polygon(obstacle: ObstacleSettings) -> Array:
    turns = np.linspace(0, 2 * np.pi, ROUND_OBSTACLE_CORNERS, endpoint=False)
    x, y = obstacle.points[0]
    return np.column_stack(
        (x + obstacle.radius * np.cos(turns), y + obstacle.radius * np.sin(turns))
    )


class FaultyTeam(SimulatedTeam):
    """A simulated team in whose world the faults of a job happen; a context manager.

    Parameters
    ----------
    world : TowingWorld
    localisation : object
        The simulated one, which takes faults of poses.
    faults : sequence of FaultSettings
    """

    def __init__(
        self, world: TowingWorld, localisation: Any, faults: Sequence[FaultSettings]
    ) -> None:
        super().__init__(world)
        self._localisation = localisation
        self._to_begin = sorted(faults, key=lambda fault: fault.at)
        self._to_end: list[FaultSettings] = []

    def advance_to(self, time: float) -> tuple[VehicleState | VehicleFault, ...]:
        """Let what is due go wrong, or right again, and the world go on."""
        now = self.time
        while self._to_begin and self._to_begin[0].at <= now:
            fault = self._to_begin.pop(0)
            self._switch_fault(fault, begins=True)
            if fault.seconds is not None:
                self._to_end.append(fault)
        for fault in [one for one in self._to_end if one.at + (one.seconds or 0.0) <= now]:
            self._switch_fault(fault, begins=False)
            self._to_end.remove(fault)
        return super().advance_to(time)

    def _switch_fault(self, fault: FaultSettings, *, begins: bool) -> None:
        world = self.world
        which = None if fault.vehicle is None else fault.vehicle - 1
        if fault.kind == "jam":
            world.set_jammed(which or 0, begins)
        elif fault.kind == "push":
            if begins:
                world.push(which or 0, *fault.push)
        elif fault.kind == "passer-by-stands":
            world.hold_passer_by(which or 0, begins)
        else:
            poses = self._localisation.poses.faults
            (poses.add if begins else poses.discard)((PoseFault(fault.kind), which))
