"""Whether a cable can be towed along its whole seam, found before anything moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.job.tow.cell import fixed_obstacles
from tjscan.job.tow.job import TowJob
from tjscan.towing.seam import Seam
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.shape.plan import PlanInputs, ShapePlanner, TowingPlan

SWEEP_STEP: Final = 0.01
"""Metres of seam from one plan to the next."""

STEP_SECONDS: Final = 1.0
"""Time of the vehicles for a step of the sweep: long enough that it never limits them."""


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
        Why no farther; empty if it came to the end.
    plans : tuple of TowingPlan
        On the way.
    chosen, shapes : int
        Which of how many shapes to begin with this is, the best one being 1.
    """

    start: TowingPlan
    length: float
    reached: float
    why: str
    plans: tuple[TowingPlan, ...]
    chosen: int = 1
    shapes: int = 1

    def refuse_if_blocked(self) -> None:
        """Refuse a seam along which the cable can't be towed.

        Raises
        ------
        ConfigurationError
            With where along it, and why.
        """
        if self.why:
            tried = f", from any of {self.shapes} first shapes" if self.shapes > 1 else ""
            raise ConfigurationError(
                f"the cable can't follow beyond {1e3 * self.reached:.0f} of "
                f"{1e3 * self.length:.0f} mm{tried}: {self.why}",
                key="seam.points_mm",
            )


def sweep_seam(
    job: TowJob, planner: ShapePlanner, along: float = 0.0, last: TowingPlan | None = None
) -> SeamSweep:
    """Plan along the whole seam with vehicles that are always where they were sent.

    Obstacles that move are left out: their places are not known yet. If the cable gets stuck, the
    next best first shape is tried; if all get stuck, the one that came farthest counts.

    Parameters
    ----------
    job : TowJob
    planner : ShapePlanner
    along : float, optional
        Where a tow goes on, metres.
    last : TowingPlan, optional
        Its shape there; searched for if left out.

    Raises
    ------
    ConfigurationError
        If the seam is beyond the cable's reach.
    """
    seam = Seam(job.seam)
    _refuse_beyond_reach(seam, job.chain.length, job.root.position)
    obstacles = fixed_obstacles(job)
    starts = planner.starts(seam.pose_at(along), obstacles) if last is None else [last]
    farthest: SeamSweep | None = None
    for k, start in enumerate(starts):
        sweep = _sweep_from_start(start, planner, seam, along, obstacles)
        if farthest is None or not sweep.why or sweep.reached > farthest.reached:
            farthest = replace(sweep, chosen=k + 1, shapes=len(starts))
        if not sweep.why:
            break
    assert farthest is not None
    return farthest


def _sweep_from_start(
    start: TowingPlan,
    planner: ShapePlanner,
    seam: Seam,
    begin: float,
    obstacles: Sequence[DiscObstacle],
) -> SeamSweep:
    plan, plans, reached = start, [start], begin
    count = 1 + int(np.ceil((seam.length - begin) / SWEEP_STEP))
    steps = np.linspace(begin, seam.length, count)[1:]
    for along in () if start.halt else steps:
        pose = seam.pose_at(along)
        plan = planner.plan(PlanInputs(plan.held_poses, pose, STEP_SECONDS, plan, obstacles))
        plans.append(plan)
        if plan.halt:
            break
        reached = float(along)
    return SeamSweep(start, seam.length, reached, plan.halt, tuple(plans))


def _refuse_beyond_reach(seam: Seam, length: float, root: tuple[float, float]) -> None:
    along = np.unique(np.concatenate((seam.path.corners, np.arange(0, seam.length, SWEEP_STEP))))
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
