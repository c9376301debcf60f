"""From a tow job to its planner, its vehicles and their localisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from tjscan.core.devices import DriverKind, EventListener
from tjscan.core.errors import ConfigurationError, explain_missing_package
from tjscan.core.frames import Array
from tjscan.job.devices import DeviceGroup
from tjscan.job.tow.job import TOWING_EXTRA, TowJob
from tjscan.towing.journal import TowTruth
from tjscan.towing.loop import Team
from tjscan.towing.seam import Seam
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.shape.plan import PlanInputs, ShapePlanner, TowingPlan
from tjscan.vehicle.drivers import (
    LOCALISATION_DRIVERS,
    LocalisationInputs,
    TowingVehicleInputs,
)
from tjscan.vehicle.localisation import Localisation
from tjscan.vehicle.mqtt.settings import MqttLocalisationSettings
from tjscan.vehicle.paced_team import PacedTeam

if TYPE_CHECKING:
    from tjscan.vehicle.cable.world import TowingWorld

UNNAMED_OBSTACLE: Final = "an obstacle that the job does not name"
"""Name of what the localisation sees, if the job has fewer moving obstacles."""

LONGEST_OBSTACLE_EXTRAPOLATION: Final = 1.0
"""Seconds for which a moving obstacle is taken to go on at its last velocity."""


def make_shape_planner(job: TowJob) -> ShapePlanner:
    """Make the planner that a job names.

    Raises
    ------
    ConfigurationError
        If a package that it needs is not installed.
    """
    known, limit = job.localisation, job.chain.joint_limit
    with explain_missing_package("towing", TOWING_EXTRA, "method"):
        from tjscan.towing.shape.paper_planner import PaperPlanner
        from tjscan.towing.shape.plan import PlannerSettings, PoseAccuracy
        from tjscan.towing.shape.planner import TowingPlanner
    accuracy = PoseAccuracy(known.position_sigma, known.heading_sigma)
    settings = PlannerSettings(job.weights, job.targets, job.hard_limits, accuracy, limit)
    kind = PaperPlanner if job.method == "paper" else TowingPlanner
    return kind(job.cable_with_bend_reserve, job.team, job.floor, settings)


class ConnectedTeam(Team, AbstractContextManager["ConnectedTeam"], Protocol):
    """A team that is a context manager: entering connects all vehicles."""


@dataclass(frozen=True, slots=True, eq=False)
class TowCell(DeviceGroup):
    """Vehicles and localisation of a tow; a context manager for the devices.

    Parameters
    ----------
    team : ConnectedTeam
    localisation : Localisation
    fixed_obstacles : sequence of DiscObstacle
        Obstacles that never move.
    moving_names : tuple of str
        Of the obstacles of the job that move, in its order.
    world : TowingWorld or None
        The truth of a simulation, which no algorithm sees.
    """

    team: ConnectedTeam
    localisation: Localisation
    fixed_obstacles: Sequence[DiscObstacle]
    moving_names: tuple[str, ...]
    world: TowingWorld | None = None

    @property
    def devices(self) -> tuple[ConnectedTeam, Localisation]:
        """The team and the localisation."""
        return self.team, self.localisation

    def report_events_to(self, listener: EventListener) -> None:
        """Report the events of the devices to a listener."""
        self.localisation.report_events_to(listener)
        if hasattr(self.team, "report_events_to"):
            self.team.report_events_to(listener)

    def obstacles(self, time: float) -> list[DiscObstacle]:
        """Obstacles at a time on the team's clock: what moves has gone on as it was seen."""
        moving = []
        discs = self.localisation.read_passers_by()
        for name, disc in zip_longest(self.moving_names[: len(discs)], discs):
            late = min(max(0.0, time - disc.time), LONGEST_OBSTACLE_EXTRAPOLATION)
            x, y = disc.x + late * disc.vx, disc.y + late * disc.vy
            velocity = disc.vx, disc.vy
            moving.append(DiscObstacle(x, y, disc.radius, velocity, name or UNNAMED_OBSTACLE))
        return [*self.fixed_obstacles, *moving]

    @property
    def truth(self) -> Callable[[], TowTruth] | None:
        """Function that returns the true state of the simulation; None for real vehicles."""
        world = self.world
        return None if world is None else lambda: _make_truth(world)


def make_tow_cell(job: TowJob, angles: Array, left: TowTruth | None = None) -> TowCell:
    """Make the devices that a job names; connect nothing.

    Parameters
    ----------
    job : TowJob
    angles : ndarray, shape (N,)
        Of the cable's joints at the beginning of a simulation, radians.
    left : TowTruth, optional
        Where an interrupted run left the simulation.

    Raises
    ------
    ConfigurationError
        If the job lacks what a driver needs.
    """
    obstacles = fixed_obstacles(job)
    names = tuple(one.name for one in job.obstacles if one.speed)
    if job.vehicles.driver_kind is not DriverKind.SIMULATED:
        localisation = _make_localisation(job, None)
        numbers = range(1, job.vehicles.count + 1)
        vehicles = [job.vehicles.make_device(TowingVehicleInputs(number)) for number in numbers]
        return TowCell(PacedTeam(vehicles), localisation, obstacles, names)
    with explain_missing_package("towing", TOWING_EXTRA, "vehicles.driver"):
        from tjscan.job.tow.simulation import FaultyTeam, towing_world_of_job
        from tjscan.vehicle.cable.world import TowingWorld
    begin = 0.0
    if left is not None:
        steps, begin = np.diff(left.line, axis=0), left.time
        headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        angles = np.diff(headings, prepend=job.root.heading)
    settings = job.simulation
    world = TowingWorld(towing_world_of_job(job), angles, seed=settings.seed, time=begin)
    localisation = _make_localisation(job, world)
    team = FaultyTeam(world, localisation, settings.faults)
    return TowCell(team, localisation, obstacles, names, world)


def _make_localisation(job: TowJob, world: TowingWorld | None) -> Localisation:
    """The localisation that a job names; on the vehicles' broker if it names none."""
    table, name = job.localisation, job.localisation.driver
    own = table.driver_settings
    if job.vehicles.driver == "mqtt" and table.driver_kind is DriverKind.SIMULATED:
        link, name = job.vehicles.driver_settings, "mqtt"
        shared = {key: getattr(link, key) for key in ("host", "port", "prefix", "connect_limit")}
        own = table.drivers.get(name) or MqttLocalisationSettings(**shared)
    inputs = LocalisationInputs(
        vehicles=job.vehicles.count,
        seed=job.simulation.seed,
        world=world,
        simulation=job.simulation.localisation,
    )
    localisation: Localisation = LOCALISATION_DRIVERS.make(name, inputs, own)
    return localisation


def _make_truth(world: TowingWorld) -> TowTruth:
    now = world.truth()
    welder_force, discs = now.forces[-1], now.passers_by[:, :3]
    state = now.time, now.points, now.poses, welder_force
    return TowTruth(*state, now.drive_forces, discs, now.touches)


def fixed_obstacles(job: TowJob) -> list[DiscObstacle]:
    """Obstacles of a job that never move."""
    fixed = (one for one in job.obstacles if not one.speed)
    return [DiscObstacle(*one.points[0], one.radius, name=one.name) for one in fixed]


SEAM_STEP: Final = 0.01
"""Metres of seam from one plan to the next."""

SEAM_STEP_SECONDS: Final = 1.0
"""Time of the vehicles for a step of the sweep: long enough that it never limits them."""


@dataclass(frozen=True, slots=True, eq=False)
class SeamFeasibility:
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


def check_seam(
    job: TowJob,
    planner: ShapePlanner,
    along: float = 0.0,
    last: TowingPlan | None = None,
    show: Callable[[float], object] = bool,
) -> SeamFeasibility:
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
    show : callable, optional
        Is given the share of the seam that is planned, again and again.

    Raises
    ------
    ConfigurationError
        If the seam is beyond the cable's reach.
    """
    seam = Seam(job.seam)
    _refuse_seam_beyond_cable(seam, job.chain.length, job.root.position)
    obstacles = fixed_obstacles(job)
    starts = planner.starts(seam.pose_at(along), obstacles) if last is None else [last]
    sweeps = list[SeamFeasibility]()
    for k, start in enumerate(starts):
        sweep = _plan_seam_from_start(start, planner, seam, along, obstacles, show)
        sweeps.append(replace(sweep, chosen=k + 1, shapes=len(starts)))
        if not sweep.why:
            return sweeps[-1]
    return max(sweeps, key=lambda sweep: sweep.reached)


def _plan_seam_from_start(
    start: TowingPlan,
    planner: ShapePlanner,
    seam: Seam,
    begin: float,
    obstacles: Sequence[DiscObstacle],
    show: Callable[[float], object],
) -> SeamFeasibility:
    plan, plans, reached = start, [start], begin
    count = 1 + int(np.ceil((seam.length - begin) / SEAM_STEP))
    steps = np.linspace(begin, seam.length, count)[1:]
    for along in () if start.halt else steps:
        pose = seam.pose_at(along)
        plan = planner.plan(PlanInputs(plan.held_poses, pose, SEAM_STEP_SECONDS, plan, obstacles))
        plans.append(plan)
        if plan.halt or plan.retreat:
            break
        reached = float(along)
        show(reached / seam.length)
    return SeamFeasibility(start, seam.length, reached, plan.halt or plan.retreat, tuple(plans))


def _refuse_seam_beyond_cable(seam: Seam, length: float, root: tuple[float, float]) -> None:
    along = np.unique(np.concatenate((seam.path.corners, np.arange(0, seam.length, SEAM_STEP))))
    places = seam.path.point_at(along)
    off = np.hypot(*(places - root).T)
    worst = int(np.argmax(off))
    if off[worst] > length:
        raise ConfigurationError(
            f"{1e3 * along[worst]:.0f} mm from its beginning the seam is "
            f"{1e3 * off[worst]:.0f} mm from the root, {1e3 * (off[worst] - length):.0f} mm "
            "beyond the cable's length",
            key="seam.points_mm",
        )
