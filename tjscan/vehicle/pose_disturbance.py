"""What goes wrong with the poses of simulated vehicles on their way to their reader."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import count
from math import nan, radians
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core.frames import Array
from tjscan.core.units import DEG, MM, PERCENT_UNIT, SECONDS, SettingsTable
from tjscan.vehicle.localisation import VehiclePose

NOISE_FAULT_SIGMAS: Final = np.array((3e-3, 3e-3, radians(1.0)))
"""Standard deviation that the fault `PoseFault.NOISE` adds, metres and radians."""

FAULT_JUMP: Final = np.array((0.5, 0.0, 0.0))
"""By how much the fault `PoseFault.JUMP` puts them off, metres and radians."""

FAULT_POSE_DELAY: Final = 0.3
HELD_BACK_DELAY: Final = 0.12
"""Seconds of the faults late and disorder."""


class PoseFault(StrEnum):
    """What can be wrong with the poses of one vehicle, or of all."""

    NOISE = "pose-noise"
    """They scatter by 3 mm and 1° more."""
    LOST = "pose-lost"
    """None comes."""
    LATE = "pose-late"
    """They come 0.3 s later."""
    DISORDER = "pose-disorder"
    """Every second one is held back and comes after its follower."""
    FROZEN = "pose-frozen"
    """The same pose is given again and again, as if it were new."""
    JUMP = "pose-jump"
    """They are 0.5 m off."""
    SWAP = "pose-swap"
    """They and the neighbour's are exchanged: of the first and second vehicle, and so on."""
    NAN = "pose-nan"
    """They hold NaN."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalisationSimulationSettings(SettingsTable):
    """The table [simulation.localisation]: how simulated vehicles are seen.

    Parameters
    ----------
    period : float
        Between two poses of a vehicle, seconds.
    position_noise, heading_noise : float
        Standard deviations, metres and radians.
    lost : float
        Share of the poses that never come.
    delay : float
        With which poses come, seconds.
    """

    period: Annotated[float, Gt(0), Le(1), SECONDS] = 0.05
    position_noise: Annotated[float, Ge(0), Le(1000), MM] = 0.5e-3
    heading_noise: Annotated[float, Ge(0), Le(180), DEG] = radians(0.1)
    lost: Annotated[float, Ge(0), Le(100), PERCENT_UNIT] = 0.0
    delay: Annotated[float, Ge(0), Le(2), SECONDS] = 0.0


class DisturbedPoses:
    """Takes true poses, and gives what comes of them.

    Parameters
    ----------
    settings : LocalisationSimulationSettings
    seed : int
        Of all random numbers.
    """

    def __init__(self, settings: LocalisationSimulationSettings, seed: int) -> None:
        self.settings = settings
        self.faults: set[tuple[PoseFault, int | None]] = set()
        """What is wrong now, and with which vehicle, from 0; None is all of them."""
        self._random = np.random.default_rng(seed)
        self._on_the_way: list[tuple[float, int, int, VehiclePose]] = []
        self._sent = count()
        self._frozen: dict[int, VehiclePose] = {}
        self._due = -np.inf

    def observe_vehicles(self, time: float, poses: Array) -> None:
        """Look at the vehicles, if it is time to: x, y and heading, shape (n, 3)."""
        s = self.settings
        if time < self._due - 1e-9:
            return
        self._due = time + s.period
        scatter = np.array((s.position_noise, s.position_noise, s.heading_noise))
        # The same numbers are drawn whatever is wrong, so a fault of one leaves the others alone.
        noise, more = self._random.standard_normal((2, *poses.shape))
        lost = self._random.random(len(poses))
        for vehicle in range(len(poses)):
            at = poses[self._vehicle_seen_as(vehicle, len(poses))] + scatter * noise[vehicle]
            if self._has_fault(PoseFault.NOISE, vehicle):
                at = at + NOISE_FAULT_SIGMAS * more[vehicle]
            if self._has_fault(PoseFault.JUMP, vehicle):
                at = at + FAULT_JUMP
            if self._has_fault(PoseFault.NAN, vehicle):
                at = np.full(3, nan)
            x, y, heading = at.tolist()
            self._send_pose(vehicle, VehiclePose(time, x, y, heading), lost[vehicle] < s.lost)

    def poses_arrived_until(self, now: float) -> Iterator[tuple[int, VehiclePose]]:
        """Give which vehicles' poses came until now, in the order in which they came."""
        while self._on_the_way and self._on_the_way[0][0] <= now + 1e-9:
            _, _, vehicle, pose = heapq.heappop(self._on_the_way)
            yield vehicle, pose

    def _send_pose(self, vehicle: int, pose: VehiclePose, lost: bool) -> None:
        if self._has_fault(PoseFault.FROZEN, vehicle):
            pose = replace(self._frozen.setdefault(vehicle, pose), time=pose.time)
        else:
            self._frozen.pop(vehicle, None)
        number = next(self._sent)
        delay = self.settings.delay
        if self._has_fault(PoseFault.LATE, vehicle):
            delay += FAULT_POSE_DELAY
        sample = round(pose.time / self.settings.period)
        if self._has_fault(PoseFault.DISORDER, vehicle) and sample % 2:
            delay += HELD_BACK_DELAY
        if not lost and not self._has_fault(PoseFault.LOST, vehicle):
            heapq.heappush(self._on_the_way, (pose.time + delay, number, vehicle, pose))

    def _vehicle_seen_as(self, vehicle: int, vehicles: int) -> int:
        """Whose pose is given as a vehicle's: 0 and 1 are exchanged, 2 and 3, and so on."""
        other = vehicle ^ 1
        swapped = self._has_fault(PoseFault.SWAP, vehicle) or self._has_fault(PoseFault.SWAP, other)
        return other if swapped and other < vehicles else vehicle

    def _has_fault(self, fault: PoseFault, vehicle: int) -> bool:
        return (fault, vehicle) in self.faults or (fault, None) in self.faults
