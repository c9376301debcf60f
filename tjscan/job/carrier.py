"""A carrier's way from stop to stop, looked at before anything moves, with the arm as it stands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, permutations
from typing import Final

import numpy as np

from tjscan.core.errors import CarrierFault, ConfigurationError
from tjscan.core.frames import Array, inverse_pose
from tjscan.job.cell import collision_model_of_job
from tjscan.job.devices import CarrierSettings
from tjscan.job.files import CellJob
from tjscan.robot.collision import BodyPair, distances_between_solids
from tjscan.robot.kinematics import Kinematics

FARTHEST_BODY: Final = 2.5
"""Metres from its base that no body of an arm is farther than."""

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
        self._job, self._arm, self._q = job, arm, q
        self._carrier = carrier_of_job(job)
        self._kinematics = self._carrier.kinematics

    def distances(self, values: Array) -> tuple[list[BodyPair], Array]:
        """Pairs of bodies that come nearer as the carrier moves, and their distances, metres."""
        job, T_b_w = self._job, inverse_pose(self._kinematics.T_w_b(values))
        model = collision_model_of_job(job, self._arm, job.clearance.tool, T_b_w)
        near = zip(model.pairs, model.distances(self._q).tolist(), strict=True)
        found = [one for one in near if not one[0].own]
        solids = job.clearance.solid
        found += distances_between_solids(
            [one.solid for one in solids if one.frame == "b"],
            [replace(one.solid, T=T_b_w @ one.solid.T) for one in solids if one.frame == "w"],
        )
        return [pair for pair, _ in found], np.array([distance for _, distance in found])

    def check_line(self, start: Array, goal: Array) -> None:
        """Check a move of all axes together.

        Raises
        ------
        CarrierFault
            If something would come too near to something else on the way.
        """
        margin, s = self._job.clearance.solids, 0.0
        distances = self.distances(start)[1]
        least = np.where(distances < margin, distances - ALLOWED_APPROACH, margin)
        most = self._most_motion(start, goal)
        while True:
            pairs, distances = self.distances(start + s * (goal - start))
            if (distances < least).any():
                i = int((least - distances).argmax())
                raise CarrierFault(
                    f"{s:.0%} of the way of the carrier to {self._kinematics.describe(goal)}, "
                    f"{pairs[i].moving} would come within {1e3 * distances[i]:.0f} mm of "
                    f"{pairs[i].other}, where {1e3 * margin:g} mm are asked for. Carry the arm in "
                    "another posture (home_deg), or choose other stops"
                )
            if s == 1.0 or most == 0.0:
                return
            spare = (distances - least).min(initial=LONGEST_SWEEP_STEP)
            s = min(1.0, s + max(float(spare), SWEEP_RESOLUTION) / most)

    def _most_motion(self, start: Array, goal: Array) -> float:
        """Metres that no body moves more than from start to goal."""
        places = [self._kinematics.T_w_b(values)[:3, 3] for values in (start, goal)]
        most = 0.0
        for axis, way in zip(self._kinematics.axes, np.abs(goal - start).tolist(), strict=True):
            away = 1.0
            if axis.point is not None:
                away = FARTHEST_BODY + max(float(np.linalg.norm(p - axis.point)) for p in places)
            most += way * away
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
