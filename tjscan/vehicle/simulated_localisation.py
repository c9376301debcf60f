"""Localisation of simulated vehicles: what is true, disturbed."""

from __future__ import annotations

from math import isfinite
from typing import Final

from tjscan.core.devices import DeviceIdentity, EventListener, LocalDevice
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.localisation import TrackedDisc, VehiclePose
from tjscan.vehicle.mqtt.wire import REPORTED_COUNTS
from tjscan.vehicle.pose_disturbance import DisturbedPoses, LocalisationSimulationSettings

NOT_A_POSE: Final = "it holds NaN"
OUT_OF_ORDER: Final = "it came after a later one"


class SimulatedLocalisation(LocalDevice):
    """Sees the vehicles of a simulated world, behind the `Localisation` protocol.

    Its clock is the world's. Passers-by are seen as they are.

    Parameters
    ----------
    world : TowingWorld
    settings : LocalisationSimulationSettings
        Noise, loss and delay.
    seed : int, optional
    """

    def __init__(
        self, world: TowingWorld, settings: LocalisationSimulationSettings, *, seed: int = 0
    ) -> None:
        self.poses = DisturbedPoses(settings, seed)
        """On their way; their faults may be set."""
        self.dropped = 0
        self._world = world
        self._seen = world.time
        self._given = [-float("inf")] * world.vehicles
        self._listener: EventListener = lambda name, sentence: None

    @property
    def identity(self) -> DeviceIdentity:
        """Which device it is."""
        return DeviceIdentity("simulated localisation")

    def report_events_to(self, listener: EventListener) -> None:
        """Report dropped poses. See `Localisation.report_events_to`."""
        self._listener = listener

    def read(self) -> tuple[VehiclePose | None, ...]:
        """Give the newest poses. See `Localisation.read`."""
        for time, poses in self._world.poses_before:
            if time > self._seen:
                self.poses.see(time, poses)
        self._seen = self._world.time
        newest: list[VehiclePose | None] = [None] * self._world.vehicles
        for vehicle, pose in self.poses.arrived(self._world.time):
            if not isfinite(pose.x + pose.y + pose.heading):
                self._report_dropped(vehicle, NOT_A_POSE)
            elif pose.time <= self._given[vehicle]:
                self._report_dropped(vehicle, OUT_OF_ORDER)
            else:
                newest[vehicle], self._given[vehicle] = pose, pose.time
        return tuple(newest)

    def read_passers_by(self) -> tuple[TrackedDisc, ...]:
        """Give where they are now. See `Localisation.read_passers_by`."""
        return tuple(
            TrackedDisc(self._world.time, *disc) for disc in self._world.passers_by.tolist()
        )

    def _report_dropped(self, vehicle: int, why: str) -> None:
        self.dropped += 1
        if self.dropped in REPORTED_COUNTS:
            self._listener(
                "message-dropped", f"pose of vehicle {vehicle + 1}, number {self.dropped}: {why}"
            )
