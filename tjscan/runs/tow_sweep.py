"""Whether a cable can be towed along its whole seam, found before anything moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.job.tow_cell import standing_obstacles
from tjscan.job.tow_job import TowJob
from tjscan.towing.plan import ShapePlanner, TowingPlan
from tjscan.towing.seam import Seam

STEP: Final = 0.01
"""Metres of seam from one plan to the next."""

DT: Final = 1.0
"""Seconds that the vehicles have for a step of the sweep: time is no limit in it."""


@dataclass(frozen=True, slots=True, eq=False)
class SeamSweep:
    """What a sweep along the seam found.

    Parameters
    ----------
    start : TowingPlan
        Shape at the seam's beginning.
    length : float
        Of the seam, metres.
    reached : float
        How far along it the planner came, metres.
    why : str
        Why no farther; empty where it came to the end.
    plans : tuple of TowingPlan
        On the way.
    """

    start: TowingPlan
    length: float
    reached: float
    why: str
    plans: tuple[TowingPlan, ...]

    def refuse_if_blocked(self) -> None:
        """Refuse a seam along which the cable can't be towed.

        Raises
        ------
        ConfigurationError
            With where along it, and why.
        """
        if self.why:
            raise ConfigurationError(
                f"the cable can't follow beyond {1e3 * self.reached:.0f} of "
                f"{1e3 * self.length:.0f} mm: {self.why}",
                key="seam.points_mm",
            )


def sweep_seam(job: TowJob, planner: ShapePlanner) -> SeamSweep:
    """Plan along the whole seam with vehicles that are always where they were sent.

    Obstacles that move are left out: nobody knows yet where they will be.

    Parameters
    ----------
    job : TowJob
    planner : ShapePlanner

    Raises
    ------
    ConfigurationError
        If the seam lies beyond the cable's reach.
    """
    seam, cable = Seam(job.seam), job.chain
    _refuse_beyond_reach(seam, cable.length, job.root.position)
    obstacles = standing_obstacles(job)
    plan = start = planner.start(seam.pose_at(0.0), obstacles)
    if start.halt:
        return SeamSweep(start, seam.length, 0.0, start.halt, (start,))
    plans, reached = [start], 0.0
    for along in np.linspace(0, seam.length, 1 + int(np.ceil(seam.length / STEP)))[1:]:
        plan = planner.plan(
            plan.held_poses, seam.pose_at(along), dt=DT, last=plan, obstacles=obstacles
        )
        if plan.halt:
            return SeamSweep(start, seam.length, reached, plan.halt, (*plans, plan))
        reached = float(along)
        plans.append(plan)
    return SeamSweep(start, seam.length, reached, "", tuple(plans))


def _refuse_beyond_reach(seam: Seam, length: float, root: tuple[float, float]) -> None:
    along = np.unique(np.concatenate((seam.path.corners, np.arange(0, seam.length, STEP))))
    places = np.array([seam.path.point_at(s) for s in along])
    off = np.hypot(*(places - root).T)
    worst = int(np.argmax(off))
    if off[worst] > length:
        raise ConfigurationError(
            f"{1e3 * along[worst]:.0f} mm from its beginning the seam is "
            f"{1e3 * off[worst]:.0f} mm from the root, {1e3 * (off[worst] - length):.0f} mm "
            "beyond the cable's length",
            key="seam.points_mm",
        )
