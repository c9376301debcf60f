"""What the planner weighs, keeps and trusts, and what it gives. Suzuki et al. (2022), V."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from math import radians
from typing import Protocol

from tjscan.core.frames import Array, PlanarPoints, PlanarPoses, readonly_copy
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.shape.cable import Cable
from tjscan.towing.tables import TargetSettings, WeightSettings


@dataclass(frozen=True, slots=True)
class TowingLimits:
    """Distances that no plan undercuts, metres. The joints' limit is the cable's own.

    Parameters
    ----------
    link_clearance : float
        Of the cable's middle line to walls, pillars and obstacles.
    body_clearance : float
        Of a vehicle's body to the same, and to links that it does not hold.
    vehicle_gap : float
        Between the bodies of two vehicles.
    cable_gap : float
        Between middle lines of parts of the cable.
    free_at_root, free_at_welder : float
        Length of cable at either end to which `link_clearance` does not apply: work starts and
        ends at walls. The welder's body is not looked at either.
    """

    link_clearance: float = 0.02
    body_clearance: float = 0.02
    vehicle_gap: float = 0.05
    cable_gap: float = 0.04
    free_at_root: float = 0.3
    free_at_welder: float = 0.3


@dataclass(frozen=True, slots=True)
class PoseTrust:
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
    limits : TowingLimits
    trust : PoseTrust
        In the vehicles' poses.
    look_ahead : float
        Seconds of an obstacle's way that are kept free: delay and stopping time.
    """

    weights: WeightSettings = field(default_factory=WeightSettings)
    targets: TargetSettings = field(default_factory=TargetSettings)
    limits: TowingLimits = field(default_factory=TowingLimits)
    trust: PoseTrust = field(default_factory=PoseTrust)
    look_ahead: float = 1.0


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


@dataclass(frozen=True, slots=True, eq=False)
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
    rest : ndarray, shape (N, 2), or None
        Towards which the floor holds the links of the estimate, metres; None if it is not known.
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
    rest: PlanarPoints | None = None

    @classmethod
    def of_angles(
        cls,
        cable: Cable,
        held: Sequence[int],
        estimate: Array,
        angles: Array,
        terms: PlanTerms,
        constraint: float,
    ) -> TowingPlan:
        """A plan of these angles for vehicles that hold the links `held`."""
        poses = cable.poses(angles)
        return cls(
            readonly_copy(estimate),
            readonly_copy(angles),
            readonly_copy(poses),
            readonly_copy(poses[list(held)]),
            terms,
            constraint,
        )


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

    def plan(
        self,
        poses: Array,
        welder_pose: Array,
        *,
        dt: float,
        last: TowingPlan | None = None,
        obstacles: Sequence[DiscObstacle] = (),
        stopped: Collection[int] = (),
    ) -> TowingPlan:
        """Estimate the cable's shape, then the best one near it.

        Parameters
        ----------
        poses : ndarray, shape (vehicles, 3)
            Of the vehicles now: x, y, metres, and heading, radians, each of its link's far end.
            A row of NaN is a vehicle with an unknown pose.
        welder_pose : ndarray, shape (3,)
            Where the welder will be one period on.
        dt : float
            The period, seconds.
        last : TowingPlan or None
            The plan before: the next estimate starts from its estimate, and the vehicles' steps are
            counted from the poses that it sent them to. Without, from where they are.
        obstacles : sequence of DiscObstacle
            As they are now.
        stopped : collection of int
            Vehicles that no longer move: their links stay where they are.
        """
