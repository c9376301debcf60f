"""A carrier's way from stop to stop, looked at before anything moves, with the arm as it stands."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, permutations, product
from typing import Final

import numpy as np

from tjscan.carrier.drivers import CarrierDriverInputs
from tjscan.core.errors import CarrierFault, ConfigurationError
from tjscan.core.frames import Array, inverse_pose
from tjscan.job.devices import CarrierSettings
from tjscan.job.files import CellJob
from tjscan.robot.collision import PlacedBody, bodies_of_arm
from tjscan.robot.kinematics import Kinematics

AT_STOP_TOLERANCE: Final = 2e-4
"""Metres and radians by which a carrier that is at its stop may be beside it."""

SWEEP_RESOLUTION, LONGEST_SWEEP_STEP = 2e-3, 0.5
"""Metres that bodies may go between two looks, where they are at their margin and where they are
far from it."""

ALLOWED_APPROACH: Final = 1e-4
"""Metres by which a pair that begins within its margin may come nearer still."""


def carrier_of_job(job: CellJob) -> CarrierSettings:
    """The carrier of a job; ConfigurationError if it has none."""
    if job.carrier is None:
        raise ConfigurationError("there is no [carrier] table", key="carrier")
    return job.carrier


def is_at_stop(values: Array, stop: Array) -> bool:
    """Whether axes are at the values of a stop, metres and radians, shape (n,)."""
    return bool(np.abs(values - stop).max() < AT_STOP_TOLERANCE)


def check_at_station(job: CellJob, values: Array) -> None:
    """Check that the values of a carrier's axes are those of a job's one station.

    Raises
    ------
    CarrierFault
        If they are not.
    """
    kinematics, stop = carrier_of_job(job).kinematics, job.carrier_values
    if not is_at_stop(values, stop):
        raise CarrierFault(
            f"the carrier is at {kinematics.describe(values)}, and station {job.station[0].name} "
            f"is at {kinematics.describe(stop)}: bring it there first, by its own controls"
        )


def check_carrier_at_station(job: CellJob) -> None:
    """Check that the carrier of a job of one station, if it has one, is there; ask no person.

    Raises
    ------
    CarrierFault
        If it is elsewhere.
    """
    if (carrier := job.carrier) is None:
        return
    inputs = CarrierDriverInputs(carrier.kinematics, job.carrier_values, lambda text: True)
    with carrier.make_device(inputs) as device:
        check_at_station(job, device.state())


class CarrierSweep:
    """What an arm in one posture, and what goes with its base, sweeps over as a carrier moves.

    Parameters
    ----------
    job : CellJob
        A job of one station with a carrier.
    arm : Kinematics
        Its arm.
    q : ndarray, shape (n,)
        Its joint angles, radians.
    """

    def __init__(self, job: CellJob, arm: Kinematics, q: Array) -> None:
        self._kinematics, table = carrier_of_job(job).kinematics, job.clearance
        self._margin = table.solids
        moving = bodies_of_arm(arm, q, [one.solid for one in table.tool])
        moving += [PlacedBody.of_solid(one.solid) for one in table.solid if one.frame == "b"]
        fixed = [PlacedBody.of_solid(one.solid) for one in table.solid if one.frame == "w"]
        self._pairs = list(product(moving, fixed))
        self._farthest = max(body.farthest for body in moving)

    def _distances(self, values: Array) -> Array:
        """Distances of all pairs, metres, shape (p,)."""
        T_b_w = inverse_pose(self._kinematics.T_w_b(values))
        return np.array([one.distance(other, T_b_w) for one, other in self._pairs], dtype=float)

    def check_line(self, start: Array, goal: Array) -> None:
        """Check a move of all axes together.

        Raises
        ------
        CarrierFault
            If something would come too near to something else on the way.
        """
        margin, s = self._margin, 0.0
        distances = self._distances(start)
        least = np.where(distances < margin, distances - ALLOWED_APPROACH, margin)
        most = self._most_motion(start, goal)
        while True:
            distances = self._distances(start + s * (goal - start))
            if (distances < least).any():
                i = int((least - distances).argmax())
                moving, fixed = self._pairs[i]
                raise CarrierFault(
                    f"{s:.0%} of the way of the carrier to {self._kinematics.describe(goal)}, "
                    f"{moving.name} would come within {1e3 * distances[i]:.0f} mm of "
                    f"{fixed.name}, where {1e3 * margin:g} mm are asked for. Carry the arm in "
                    "another posture (home_deg), or choose other stops"
                )
            if s == 1.0 or most == 0.0:
                return
            spare = (distances - least).min(initial=LONGEST_SWEEP_STEP)
            s = min(1.0, s + max(float(spare), SWEEP_RESOLUTION) / most)

    def _most_motion(self, start: Array, goal: Array) -> float:
        """Metres that no body moves more than from start to goal."""
        most, T_w_b = 0.0, self._kinematics.T_w_b_zero
        ends = self._kinematics.from_base(goal)
        for (axis, value), (_, end) in zip(self._kinematics.from_base(start), ends, strict=True):
            away = 1.0
            if axis.point is not None:
                away = float(np.linalg.norm(T_w_b[:3, 3] - axis.point))
                away += self._farthest + most
            most += abs(end - value) * away
            T_w_b = axis.motion(value) @ T_w_b
        return most

    def clear_way(self, start: Array, goal: Array) -> tuple[Array, ...]:
        """Values to move to, one after the other, so that nothing comes too near.

        All axes together if that is clear; else one by one, or with one axis drawn to its end.

        Raises
        ------
        CarrierFault
            What is in the direct way, if none of them is clear.
        """
        blocked: CarrierFault | None = None
        for way in self._ways(start, goal):
            try:
                for one, other in pairwise((start, *way)):
                    self.check_line(one, other)
            except CarrierFault as error:
                blocked = blocked or error
            else:
                return way
        raise blocked or CarrierFault("there is no way")

    def _ways(self, start: Array, goal: Array) -> Iterator[tuple[Array, ...]]:
        yield (goal,)
        moving = np.flatnonzero(start != goal)
        for order in permutations(moving.tolist()) if len(moving) > 1 else ():
            way, at = [], start
            for i in order:
                at = np.where(np.arange(len(goal)) == i, goal, at)
                way.append(at)
            yield tuple(way)
        for i, axis in enumerate(self._kinematics.axes):
            for end in axis.bounds:
                drawn = np.arange(len(goal)) == i
                yield np.where(drawn, end, start), np.where(drawn, end, goal), goal
