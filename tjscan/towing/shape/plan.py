"""What the planner weighs, keeps and trusts, and what it gives. Suzuki et al. (2022), V."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from math import radians
from typing import Protocol

from tjscan.core.frames import Array, PlanarPoints, PlanarPoses, array_dataclass
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.tables import LimitSettings, TargetSettings, WeightSettings


@dataclass(frozen=True, slots=True)
class PoseAccuracy:
    """How well the vehicles' poses are known.

    Parameters
    ----------
    position_sd : float
        Of x and of y, metres.
    heading_sd : float
        Radians.
    """

    position_sd: float = 3e-3
    heading_sd: float = radians(1.0)


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """What the planner weighs and keeps.

    Parameters
    ----------
    weights : WeightSettings
    targets : TargetSettings
    limits : LimitSettings
        Distances that no plan undercuts. The joints' limit is the cable's own.
    trust : PoseAccuracy
        In the vehicles' poses.
    bend_limit : float
        Radians that no joint of the cable may be bent by as the floor holds it, if that is more
        than the limit of the cable as it is planned.
    """

    weights: WeightSettings = field(default_factory=WeightSettings)
    targets: TargetSettings = field(default_factory=TargetSettings)
    limits: LimitSettings = field(default_factory=lambda: LimitSettings(link_clearance=0.02))
    trust: PoseAccuracy = field(default_factory=PoseAccuracy)
    bend_limit: float = 0.0


@dataclass(frozen=True, slots=True)
class PlanTerms:
    """The terms of the objective at the planned shape, weighted, of 100 at worst.

    Parameters
    ----------
    bend : float
        w_θ f_θ / N.
    obstacle : float
        w_d f_d / N.
    change : float
        w_c f_c / N.
    pace : float
        Of the vehicles' steps, which the paper does not weigh.
    pull : float
        Of the cable's force on the welder, which it does not weigh either.
    """

    bend: float
    obstacle: float
    change: float
    pace: float = 0.0
    pull: float = 0.0

    @property
    def paper(self) -> float:
        """The paper's f: all but pace and pull."""
        return self.bend + self.obstacle + self.change

    @property
    def total(self) -> float:
        """What is minimised."""
        return self.paper + self.pace + self.pull


@array_dataclass
class TowingPlan:
    """A planned shape of the cable. Arrays are read-only.

    Parameters
    ----------
    estimate : ndarray, shape (N,)
        Angles of the joints as estimated from the vehicles' poses, radians: θ_init.
    angles : ndarray, shape (N,)
        As planned, radians: θ*.
    link_poses : ndarray, shape (N, 3)
        Planned, of the links' far ends: x, y, metres, and heading, radians.
    held_poses : ndarray, shape (vehicles, 3)
        Planned, of the links that vehicles hold; the last is the welder's.
    terms : PlanTerms
    constraint : float
        Largest error, metres or radians, of the planned tip's pose from the welder's and of stopped
        vehicles' links from theirs.
    limits : tuple of str
        Limits that are active at the shape, in words.
    iterations : int
        Of the optimisation.
    halt : str
        Why no vehicle may drive on: empty if the plan may be sent. The angles of a halt are those
        of the last shape tried, to be shown, never to be sent.
    retreat : str
        What came too near, if the plan only leads away from it, as far as vehicles can drive; or
        the joint that would bend too far, if vehicles stay for that. Such a plan may be sent, and
        the welder must wait.
    rest : ndarray, shape (N, 2), or None
        Towards which the floor holds the links of the estimate, metres; None if it is not known.
    deviations : ndarray, shape (N,), or None
        Standard deviations of the estimated angles, radians; None if none is near its limit.
    forces : ndarray, shape (vehicles, 2), or None
        Of the cable on the vehicles, newton; None if the floor's share is not known.
    tension : ndarray, shape (N,), or None
        Along the cable, newton; likewise.
    """

    estimate: Array
    angles: Array
    link_poses: PlanarPoses
    held_poses: PlanarPoses
    terms: PlanTerms
    constraint: float
    limits: tuple[str, ...] = ()
    iterations: int = 0
    halt: str = ""
    retreat: str = ""
    rest: PlanarPoints | None = None
    deviations: Array | None = None
    forces: PlanarPoints | None = None
    tension: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlanInputs:
    """What a plan of one period is made from.

    Parameters
    ----------
    poses : ndarray, shape (vehicles, 3)
        Of the vehicles now: x, y, metres, and heading, radians, each of its link's far end. A row
        of NaN is a vehicle with an unknown pose.
    welder_pose : ndarray, shape (3,)
        Where the welder will be one period on.
    period : float
        Seconds.
    last : TowingPlan or None
        The plan before: the next estimate starts from its estimate, and the vehicles' steps are
        counted from the poses that it sent them to. Without, from the best first shape, and from
        where they are.
    obstacles : sequence of DiscObstacle
        As they are now.
    stopped : collection of int
        Vehicles that no longer move: their links stay where they are.
    sigmas : ndarray, shape (vehicles, 2), optional
        Standard deviations of the poses' places, metres, and headings, radians; without, those of
        single poses.
    """

    poses: Array
    welder_pose: Array
    period: float
    last: TowingPlan | None = None
    obstacles: Sequence[DiscObstacle] = ()
    stopped: Collection[int] = ()
    sigmas: Array | None = None


class ShapePlanner(Protocol):
    """What plans the cable's shape: `planner.TowingPlanner`, and the paper's, to compare."""

    def starts(
        self, welder_pose: Array, obstacles: Sequence[DiscObstacle] = ()
    ) -> list[TowingPlan]:
        """Shapes to begin with, best first; there is none to stay near to.

        If no shape keeps the limits, one plan whose halt states that.

        Parameters
        ----------
        welder_pose : ndarray, shape (3,)
            x, y, metres, and heading, radians, of the tip.
        obstacles : sequence of DiscObstacle
        """

    def plan(self, inputs: PlanInputs) -> TowingPlan:
        """Estimate the cable's shape, then the best one near it."""
