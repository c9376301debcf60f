"""From a crawl job to its vehicle, laser and torch."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from math import cos, sin
from time import monotonic
from typing import Any, Final

import numpy as np

from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.crawler.journal import SimulatedPlace
from tjscan.crawler.plan import PassSettings
from tjscan.crawler.torch_axes import SimulatedTorchAxes, TorchAxes
from tjscan.job.crawl.job import CrawlJob, CrawlSimulationSettings, TorchDriverInputs
from tjscan.job.crawl.weld import CrawlWeld
from tjscan.job.devices import DeviceGroup, make_laser_without_arm
from tjscan.joint.hull import hull_section, joint_line_pose, laser_offset, place_beside_joint
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.section_laser import SectionLaserModel, SectionLaserPose, SimulatedSectionLaser
from tjscan.power.drivers import PowerDriverInputs
from tjscan.power.source import PowerSource
from tjscan.vehicle.drivers import VEHICLE_DRIVERS, VehicleDriverFactory, VehicleDriverInputs
from tjscan.vehicle.simulated import SimulatedVehicle
from tjscan.vehicle.vehicle import Vehicle, VehicleState

LASER_RANDOM_STREAM: Final = 2
"""Keeps the random numbers of the laser apart from the vehicle's, which has the bare seed."""


@dataclass(slots=True)
class SimulatedWeld:
    """The joint of a simulation: it is welded along the path of the burning arc.

    Parameters
    ----------
    job : CrawlJob
    world : CrawlSimulationSettings
        The simulation of that job.
    pose : callable
        Gives the vehicle's true pose T_w_v, shape (4, 4).
    torch : TorchAxes
        Whose arc it is.
    disturb : callable
        Called with whether the arc burns, which disturbs the vehicle's sensors.
    welded : list of list of float
        From where to where along the joint each arc burned so far, metres.
    clock : callable
        Gives the seconds.
    metal : CrawlWeld, optional
        Of the bead model; without, each pass leaves the bead that the joint states for it.
    planned : PassSettings, optional
        The pass that is welded now, if it was planned from a look.
    cut_arcs : int
        Arcs that welded no whole pass.
    """

    job: CrawlJob
    world: CrawlSimulationSettings
    pose: Callable[[], Array]
    torch: TorchAxes
    disturb: Callable[[bool], None]
    welded: list[list[float]] = field(default_factory=list)
    clock: Callable[[], float] = monotonic
    metal: CrawlWeld | None = None
    planned: PassSettings | None = None
    cut_arcs: int = 0
    _arc_burned_before: bool = False

    def pose_ahead(self, ahead: float) -> tuple[float, float, float]:
        """x, y and heading of a point ahead of the vehicle's centre, in frame w."""
        T = self.pose()
        heading = float(np.arctan2(T[1, 0], T[0, 0]))
        x, y = T[:2, 3] + ahead * T[:2, 0]
        return float(x), float(y), heading

    def torch_place(self) -> tuple[float, float]:
        """Where the torch's zero truly is: along the joint, and to the right of it, metres.

        Its places count from the laser's zero, as far as it is registered rightly.
        """
        x, y, heading = self.pose_ahead(-self.job.vehicle.centre_to_torch)
        off = self.world.torch_aside - self.job.torch.aside
        x, y = x - off * sin(heading), y + off * cos(heading)
        return place_beside_joint(self.world.joint, x, y)

    def torch_beside_joint(self) -> tuple[float, float]:
        """Where the torch itself truly is: along the joint, and to the right of it, metres."""
        along, right = self.torch_place()
        y = self.torch.y if isinstance(self.torch, SimulatedTorchAxes) else 0.0
        return along, right + y + self.job.torch.aside

    def simulated_place(self) -> SimulatedPlace:
        """True place of the vehicle and of its torch."""
        return SimulatedPlace(self.pose_ahead(0.0), self.torch_place())

    def section_below_laser(self) -> tuple[Array, SectionLaserPose]:
        """Section below the laser, and the laser's pose over it."""
        self._weld_below_torch()
        vehicle, joint = self.job.vehicle, self.world.joint
        place = self.pose_ahead(vehicle.laser_to_torch - vehicle.centre_to_torch)
        along, offset = laser_offset(joint, *place)
        relative = place[2] - joint_line_pose(joint, along)[2]
        if self.metal is not None:
            section = self.metal.outline(along)
            return section, SectionLaserPose(offset=offset, heading=relative)
        passes = sum(start <= along <= end for start, end in self.welded)
        return hull_section(joint, along, passes), SectionLaserPose(offset=offset, heading=relative)

    def laser_model(self) -> SectionLaserModel:
        """Optics of the laser: while the arc burns, it blinds some of its columns."""
        return replace(self.world.laser, arc=self.world.arc_points if self.torch.arc else 0.0)

    def pass_of_arc(self, arc: int) -> PassSettings:
        """The pass that an arc welds, by its number."""
        number = min(arc - self.cut_arcs, len(self.job.passes) - 1)
        return self.planned or self.job.passes[number]

    def torch_raised(self) -> float:
        """By how much the torch is higher than its pass has it, metres."""
        if not isinstance(self.torch, SimulatedTorchAxes) or not self.welded:
            return 0.0
        along, _ = self.torch_beside_joint()
        here = self.pass_of_arc(len(self.welded) - 1).table.at(np.array(along))
        return self.torch.z - float(here.height)

    def take_plan(self, planned: PassSettings) -> None:
        """Take in how the pass that comes next is welded."""
        self.planned = planned

    def _weld_below_torch(self) -> None:
        self.disturb(self.torch.arc)
        if self.torch.arc:
            along, right = self.torch_beside_joint()
            if not self._arc_burned_before:
                self.welded.append([along, along])
            self.welded[-1][1] = max(self.welded[-1][1], along)
            if self.metal is not None:
                self.metal.burn(self.clock(), along, right)
        elif self._arc_burned_before and self.metal is not None:
            self.metal.end_arc(self.pass_of_arc(len(self.welded) - 1))
        self._arc_burned_before = self.torch.arc


@dataclass(frozen=True, slots=True, eq=False)
class InterruptedWorld:
    """How an interrupted run left a simulated world.

    Parameters
    ----------
    pose_w : ndarray, shape (3,)
        x, y and heading of the vehicle, in frame w.
    time : float
        What its clock showed, seconds.
    arcs : tuple of (PassSettings, ndarray)
        The pass that each arc welded, and the torch's true way meanwhile, shape (k, 3): seconds,
        place along the joint, and to the right of it, metres.
    passes_done : int
        How many passes are whole.
    """

    pose_w: Array
    time: float
    arcs: tuple[tuple[PassSettings, Array], ...] = ()
    passes_done: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class CrawlCell(DeviceGroup):
    """Vehicle, laser and torch of a crawl; a context manager for the devices.

    Parameters
    ----------
    vehicle : Vehicle
    laser : LineLaser
    torch : TorchAxes
    world : SimulatedWeld or None
        The truth of a simulation, which no algorithm sees.
    clock : callable
        Gives the seconds on the clock that the laser's profiles are dated by.
    power : PowerSource, optional
        Of the arc; without, the torch has one of its own.
    """

    vehicle: Vehicle
    laser: LineLaser
    torch: TorchAxes
    world: SimulatedWeld | None = None
    clock: Callable[[], float] = monotonic
    power: PowerSource | None = None

    @property
    def simulated_place(self) -> Callable[[], SimulatedPlace] | None:
        """Function that returns the true place of a simulated vehicle; None for a real one."""
        return None if self.world is None else self.world.simulated_place

    @property
    def devices(self) -> tuple[AbstractContextManager[Any], ...]:
        """Vehicle, laser, torch, and the power source if there is one."""
        power = () if self.power is None else (self.power,)
        return self.vehicle, self.laser, self.torch, *power


def make_crawl_cell(
    job: CrawlJob,
    left: InterruptedWorld | None = None,
    ask: Callable[[str], bool] = lambda question: True,
) -> CrawlCell:
    """Make the devices that a crawl job names; connect nothing.

    Parameters
    ----------
    job : CrawlJob
    left : InterruptedWorld, optional
        What an interrupted run left of a simulation; a new one begins if left out.
    ask : callable, optional
        Asks a person to strike an arc by hand, or to end it.

    Raises
    ------
    ConfigurationError
        If the job lacks what a driver needs.
    """
    world = job.simulation
    factory: VehicleDriverFactory = VEHICLE_DRIVERS.load(job.vehicle.driver)
    inputs = VehicleDriverInputs(
        job.vehicle.tracks,
        seed=0 if world is None else world.seed,
        simulation=None if world is None else world.vehicle,
        left=None if left is None else (left.pose_w, left.time),
        recording=_refuse_recording,
    )
    vehicle: Vehicle = job.vehicle.make_device(inputs)
    link = job.vehicle.driver_settings
    torch: TorchAxes = job.torch.make_device(
        TorchDriverInputs(reach=job.torch.reach, speed=job.torch.speed, vehicle=link)
    )
    if world is None:
        laser = make_laser_without_arm(job.laser)
        return CrawlCell(vehicle, laser, torch, power=_make_power_source(job, ask, monotonic))
    body = vehicle.body if isinstance(vehicle, SimulatedVehicle) else None

    def disturb(burning: bool) -> None:
        if body is not None:
            body.arc_burning = burning

    # Over a broker the loopback's vehicle reports its true place; a real one does not.
    truth = partial(factory.truth, vehicle)
    arcs = () if left is None else left.arcs
    welded = [[float(way[:, 1].min()), float(way[:, 1].max())] for _, way in arcs]
    clock = monotonic if body is None else lambda: body.time
    metal = None if world.weld is None else CrawlWeld(world.joint, world.weld, world.seed)
    weld = SimulatedWeld(job, world, truth, torch, disturb, welded, clock, metal)
    if left is not None:
        weld.cut_arcs = len(arcs) - left.passes_done
    if metal is not None:
        for one, way in arcs:
            for sample in way.tolist():
                metal.burn(*sample)
            metal.end_arc(one)
    power = _make_power_source(job, ask, clock, weld.torch_raised)
    if job.laser.driver_kind is not DriverKind.SIMULATED:
        laser = make_laser_without_arm(job.laser)
        return CrawlCell(vehicle, laser, torch, weld, power=power)
    rng = np.random.default_rng([world.seed, LASER_RANDOM_STREAM])
    section_laser = SimulatedSectionLaser(
        weld.section_below_laser, weld.laser_model, clock, rng=rng
    )
    return CrawlCell(vehicle, section_laser, torch, weld, clock, power)


def _make_power_source(
    job: CrawlJob,
    ask: Callable[[str], bool],
    clock: Callable[[], float],
    raised: Callable[[], float] = float,
) -> PowerSource | None:
    """The power source of a job; None if the torch has an arc of its own."""
    if job.power is None:
        return None
    seed = 0 if job.simulation is None else job.simulation.seed
    inputs = PowerDriverInputs(ask=ask, clock=clock, raised=raised, seed=seed)
    source: PowerSource = job.power.make_device(inputs)
    return source


def _refuse_recording() -> tuple[VehicleState, ...]:
    raise ConfigurationError("a crawl names no recording to replay", key="vehicle.driver")
