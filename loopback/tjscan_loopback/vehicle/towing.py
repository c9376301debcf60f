"""Towing vehicles behind a broker: bodies that share one simulated world."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import cos, degrees, hypot, isnan, sin
from typing import TYPE_CHECKING, Final
from uuid import uuid4

from tjscan.vehicle.localisation import VehiclePose
from tjscan.vehicle.mqtt.link import BrokerLink
from tjscan.vehicle.mqtt.settings import BrokerSettings
from tjscan.vehicle.mqtt.wire import (
    PASSER_BY_TOPIC,
    POSE_TOPIC,
    PasserByMessage,
    PoseMessage,
    PresenceMessage,
)
from tjscan.vehicle.pose_disturbance import (
    DisturbedPoses,
    LocalisationSimulationSettings,
    PoseFault,
)
from tjscan.vehicle.vehicle import Twist, VehicleState
from tjscan_loopback.vehicle.bodies import ON_TRACKS, Faults
from tjscan_loopback.vehicle.faults import VehicleFaultOrder

if TYPE_CHECKING:
    from tjscan.vehicle.cable.world import TowingWorld

PUSH_DISTANCE: Final = 0.2
"""Metres."""

CLOCK_ERROR: Final = 3600.0
"""Seconds by which a clock goes wrong."""

LOOK_PERIOD: Final = 0.1
"""Seconds between two looks at the truth."""

TRACKER_TOPIC: Final = "tracker"
"""Where what sees the vehicles announces itself."""


class TowingBody:
    """One vehicle of a simulated world, as a loopback vehicle drives it.

    Parameters
    ----------
    world : TowingWorld
    which : int
        Its place along the cable, from 0.
    poses : DisturbedPoses
        What sees all vehicles.
    """

    possible_faults = frozenset(VehicleFaultOrder) - ON_TRACKS
    drives_sideways = True

    def __init__(self, world: TowingWorld, which: int, poses: DisturbedPoses) -> None:
        self._world, self._which, self._poses = world, which, poses
        self.arc_burning = False
        self.clock_error = 0.0
        """Seconds by which the clock that its poses are dated by is wrong."""

    @property
    def time(self) -> float:
        """See `LoopbackBody.time`."""
        return self._world.time

    @property
    def at_rest(self) -> bool:
        """See `LoopbackBody.at_rest`."""
        return self._world.is_at_rest(self._which)

    @property
    def braking_time(self) -> float:
        """See `LoopbackBody.braking_time`."""
        model = self._world.model.vehicle
        return model.top_speed / model.braking

    def take_faults(self, faults: Faults) -> None:
        """See `LoopbackBody.take_faults`."""
        world, which = self._world, self._which
        world.set_jammed(which, VehicleFaultOrder.STOP in faults)
        self.clock_error = CLOCK_ERROR if VehicleFaultOrder.POSE_CLOCK in faults else 0.0
        own = {(fault, which) for fault in PoseFault if fault.value in faults}
        self._poses.faults = {f for f in self._poses.faults if f[1] != which} | own

    def push(self) -> None:
        """Be carried to its right. See `LoopbackBody.push`."""
        heading = self._world.plant.poses[self._which, 2]
        self._world.push(self._which, -PUSH_DISTANCE * sin(heading), PUSH_DISTANCE * cos(heading))

    def advance(self, twist: Twist | None, period: float) -> VehicleState:
        """Order a twist; the world goes on when all have: `TowingBodies.advance`."""
        self._world.order(self._which, twist)
        return self._world.state(self._which)

    @property
    def own_pose(self) -> None:
        """None: it does not see itself. See `LoopbackBody.own_pose`."""
        return


@dataclass(slots=True)
class TowingExtremes:
    """What truly happened in a loopback world since it began, to judge a tow by.

    Parameters
    ----------
    bend : float
        Largest angle of a joint, radians.
    force : float
        Largest force of the cable on the welder, newton, each the mean of 0.1 s.
    touches : set of str
        What touched what.
    """

    bend: float = 0.0
    force: float = 0.0
    touches: set[str] = field(default_factory=set)


class TowingBodies:
    """The vehicles of one world, what sees them, and the passers-by.

    Parameters
    ----------
    world : TowingWorld
    localisation : LocalisationSimulationSettings
        How the vehicles are seen.
    seed : int
    """

    def __init__(
        self, world: TowingWorld, localisation: LocalisationSimulationSettings, seed: int
    ) -> None:
        self._world = world
        self._poses = DisturbedPoses(localisation, seed)
        self._session, self._due = uuid4().hex, world.time
        self.extremes, self._looked = TowingExtremes(), world.time
        self.bodies = tuple(
            TowingBody(world, which, self._poses) for which in range(world.vehicles)
        )

    def advance(self, period: float) -> None:
        """Let the world go on, seconds."""
        self._world.advance(period)
        self._poses.observe_vehicles(self._world.time, self._world.plant.poses)

    def look_at_truth(self) -> list[str]:
        """Take note of what happened, ten times a second; what touched for the first time."""
        if self._world.time - self._looked < LOOK_PERIOD:
            return []
        self._looked = self._world.time
        truth, extremes = self._world.truth(), self.extremes
        extremes.bend = max(extremes.bend, float(abs(truth.angles).max()))
        extremes.force = max(extremes.force, float(hypot(*truth.forces[-1, :2])))
        first = [touch for touch in truth.touches if touch not in extremes.touches]
        extremes.touches.update(first)
        return first

    def truth_as_json(self) -> str:
        """What is true, and was since the world began, as JSON."""
        world, extremes = self._world, self.extremes
        return json.dumps(
            {
                "time_s": world.time,
                "bend_deg": degrees(extremes.bend),
                "force_n": extremes.force,
                "touches": sorted(extremes.touches),
                "poses": world.plant.poses.tolist(),
            }
        )

    def hold_passers_by(self, stops: bool) -> None:
        """Hold all passers-by, or let them walk on."""
        for which in range(len(self._world.passers_by)):
            self._world.hold_passer_by(which, stops)

    def link(self, host: str, port: int, prefix: str) -> BrokerLink:
        """What sends where all are, not yet connected."""
        return BrokerLink(
            BrokerSettings(host=host, port=port, prefix=prefix),
            presence_topic=TRACKER_TOPIC,
            presence=PresenceMessage.at_start(self._session, "loopback tracker"),
            topics=(),
            receive=lambda received: None,
            changed=lambda up: None,
        )

    def sightings(self, now: float) -> Iterator[tuple[str, bytes]]:
        """Topic and payload of what is seen now, seconds; a number is when, in milliseconds."""
        world = self._world
        for which, pose in self._poses.poses_arrived_until(world.time):
            taken = now - (world.time - pose.time)
            yield (
                f"{which + 1}/{POSE_TOPIC}",
                _pose_payload(self._session, taken, pose, self.bodies[which].clock_error),
            )
        if world.time < self._due:
            return
        self._due = world.time + self._poses.settings.period
        for number, (x, y, radius, vx, vy) in enumerate(world.passers_by.tolist(), 1):
            message = PasserByMessage(
                session=self._session,
                number=round(1e3 * now),
                time=now,
                x=x,
                y=y,
                radius=radius,
                vx=vx,
                vy=vy,
            )
            yield f"{PASSER_BY_TOPIC}/{number}", message.to_json()


def _pose_payload(session: str, taken: float, pose: VehiclePose, clock_error: float) -> bytes:
    wrong = isnan(pose.x)
    payload = PoseMessage(
        session=session,
        number=round(1e3 * taken),
        time=taken + clock_error,
        x=0.0 if wrong else pose.x,
        y=0.0 if wrong else pose.y,
        heading=0.0 if wrong else pose.heading,
    ).to_json()
    # No message can hold NaN: it is written into one.
    return payload.replace(b'"x":0.0', b'"x":NaN') if wrong else payload
