"""Vehicles that go exactly as told, their poses, and a planner that keeps them in a row."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.core.errors import DriveFault, VehicleFault
from tjscan.core.frames import Array
from tjscan.towing.following import velocity_from_twist
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.shape.plan import PlanInputs, PlanTerms, TowingPlan
from tjscan.vehicle.localisation import TrackedDisc, VehiclePose
from tjscan.vehicle.vehicle import AT_REST, Twist, VehicleState


class KinematicVehicle:
    def __init__(self, pose: Sequence[float]) -> None:
        self.pose: Array = np.array(pose, dtype=float)
        self.twist, self.stopped, self.jammed, self.fault = AT_REST, False, False, ""

    def command(self, twist: Twist) -> None:
        if self.fault:
            raise DriveFault(self.fault)
        self.twist = twist

    def stop(self) -> None:
        self.twist, self.stopped = AT_REST, True

    def advance(self, period: float) -> VehicleState | VehicleFault:
        twist = AT_REST if self.jammed or self.fault else self.twist
        middle = self.pose[2] + twist.turn_rate * period / 2
        self.pose = self.pose + period * velocity_from_twist(twist, middle)
        return VehicleState(0.0, AT_REST if self.fault else self.twist, fault=self.fault)


class KinematicTeam:
    """A team on a clock of its own; `disturb` is called at each time before anything moves."""

    def __init__(self, poses: Array, disturb: Callable[[float], None] = lambda time: None) -> None:
        self.vehicles = [KinematicVehicle(pose) for pose in poses]
        self.time, self.disturb = 0.0, disturb

    def advance_to(self, time: float) -> list[VehicleState | VehicleFault]:
        self.disturb(self.time)
        period, self.time = time - self.time, time
        return [vehicle.advance(period) for vehicle in self.vehicles]


@dataclass
class ExactLocalisation:
    """Poses as they are but for a trace of noise; `change` may bend each, or lose it."""

    team: KinematicTeam
    change: Callable[[int, VehiclePose], VehiclePose | None] = lambda v, pose: pose
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    identity = DeviceIdentity()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None: ...

    def report_events_to(self, listener: EventListener) -> None: ...

    def read_passers_by(self) -> tuple[TrackedDisc, ...]:
        return ()

    def read(self) -> tuple[VehiclePose | None, ...]:
        noise = 1e-6 * self.rng.standard_normal((len(self.team.vehicles), 3))
        return tuple(
            self.change(v, VehiclePose(self.team.time, *(vehicle.pose + noise[v]).tolist()))
            for v, vehicle in enumerate(self.team.vehicles)
        )


@dataclass
class RowPlanner:
    """Keeps vehicles in a straight row behind the welder; halts where it is told."""

    links: int
    spacing: float
    vehicles: int
    halt: Callable[[Array], str] = lambda tip: ""
    bend: Callable[[Array], float] = lambda tip: 0.0
    asked: list[Collection[int]] = field(default_factory=list)

    def starts(
        self, welder_pose: Array, obstacles: Sequence[DiscObstacle] = ()
    ) -> list[TowingPlan]:
        return [self.start(welder_pose)]

    def start(self, welder_pose: Array) -> TowingPlan:
        angles = np.full(self.links, self.bend(welder_pose))
        behind = self.spacing * np.arange(self.vehicles - 1, -1, -1.0)
        heading = np.array((np.cos(welder_pose[2]), np.sin(welder_pose[2])))
        held = np.column_stack(
            (
                welder_pose[:2] - behind[:, None] * heading,
                np.full(self.vehicles, welder_pose[2]),
            )
        )
        links = np.tile(welder_pose, (self.links, 1))
        return TowingPlan(angles, angles, links, held, PlanTerms(1.0, 2.0, 0.0), 0.0)

    def plan(self, inputs: PlanInputs) -> TowingPlan:
        self.asked.append(inputs.stopped)
        return replace(self.start(inputs.welder_pose), halt=self.halt(inputs.welder_pose))
