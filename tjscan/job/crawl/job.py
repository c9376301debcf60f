"""The job of a crawler: vehicle, laser, joint, passes, guards, and the world of a simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import tan
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from pydantic import Field

from tjscan.core.config import StrictFileModel
from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.core.units import (
    DEG,
    LIST_OR_WORD_IN_FILE,
    M_PER_MIN,
    MM,
    MM_S,
    FileUnit,
    SettingsTable,
)
from tjscan.crawler import plan
from tjscan.crawler.guards import ProximitySettings
from tjscan.crawler.paper_method import PaperSettings
from tjscan.crawler.sizing import SizeSettings
from tjscan.crawler.slip_aware import SteeringSettings
from tjscan.crawler.slip_estimator import CrawlerGeometry, SlipUncertainty
from tjscan.crawler.torch_axes import FixedTorch, SimulatedTorchAxes, TorchAxes
from tjscan.job.devices import DeviceSettings, PowerSettings
from tjscan.job.reading import read_job
from tjscan.joint.hull import HullJoint
from tjscan.laser.drivers import LASER_DRIVERS
from tjscan.laser.section_laser import LASER_STAND_OFF, SectionLaserModel
from tjscan.vehicle.drivers import VEHICLE_DRIVERS
from tjscan.vehicle.mqtt.settings import MqttSettings
from tjscan.vehicle.simulated_body import VehicleSimulationSettings
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.welding.world import WeldFaults


@dataclass(frozen=True, slots=True, kw_only=True)
class TorchDriverInputs:
    """What a torch's driver makes its torch from, beside its own settings.

    Parameters
    ----------
    reach : float
        To either side of the vehicle's middle, metres.
    speed : float
        Across the joint, m/s.
    vehicle : SettingsTable or object
        Settings of the vehicle's driver: a torch may hang on the same link.
    """

    reach: float
    speed: float
    vehicle: object


TorchDriverFactory = DriverFactory[TorchDriverInputs, TorchAxes]


def _make_mqtt_torch(context: TorchDriverInputs, settings: NoSettings) -> TorchAxes:
    if not isinstance(context.vehicle, MqttSettings):
        raise ConfigurationError(
            'the torch "mqtt" hangs on the link of its vehicle: vehicle.driver must be "mqtt" too',
            key="torch.driver",
        )
    from tjscan.vehicle.mqtt.torch import MqttTorch

    return MqttTorch(context.vehicle, context.reach)


TORCH_DRIVERS: Final = DriverRegistry(
    "torch",
    {
        "simulated": TorchDriverFactory(
            lambda context, settings: SimulatedTorchAxes(context.reach, context.speed),
            kind=DriverKind.SIMULATED,
        ),
        "none": TorchDriverFactory(lambda context, settings: FixedTorch()),
        "mqtt": TorchDriverFactory(_make_mqtt_torch, extra="vehicle"),
    },
    key="torch.driver",
)
"""Every torch driver by name."""


LEAST_HULL_EACH_SIDE: Final = 5e-3
"""Metres of a plate at least: its pose needs ten points, and half as many may be missing."""

PERCENT_UNIT: Final = FileUnit("percent", 0.01)
WATT_UNIT: Final = FileUnit("W")


@dataclass(frozen=True, kw_only=True)
class VehicleSettings(DeviceSettings):
    """The table [vehicle]: which vehicle, and where laser and torch sit on it.

    Parameters
    ----------
    laser_to_torch : float
        How far the laser's line is ahead of the torch, metres.
    centre_to_torch : float
        How far the vehicle's centre is ahead of the torch, metres.
    body_length, body_width : float
        Between its proximity sensors, along and across, metres.
    tracks : TrackGeometry
        Sprockets and gauge.
    """

    registry: ClassVar[DriverRegistry[Any]] = VEHICLE_DRIVERS

    laser_to_torch: Annotated[float, Ge(10), Le(5000), MM] = 0.50
    centre_to_torch: Annotated[float, Ge(-5000), Le(5000), MM] = 0.0
    body_length: Annotated[float, Ge(50), Le(1e4), MM] = 0.80
    body_width: Annotated[float, Ge(50), Le(1e4), MM] = 0.50
    tracks: TrackGeometry = field(default_factory=TrackGeometry)

    @property
    def geometry(self) -> CrawlerGeometry:
        """Where laser and torch sit."""
        return CrawlerGeometry(self.laser_to_torch, self.centre_to_torch)

    @property
    def device_id(self) -> str:
        """Id of the vehicle in calibrations: its own id, or else its driver."""
        return self.id or self.driver


@dataclass(frozen=True, kw_only=True)
class CrawlLaserSettings(DeviceSettings):
    """The table [laser] of a crawl: which line laser looks at the joint ahead of the torch.

    It is mounted with x_s to the vehicle's right and z_s into the hull.
    """

    registry: ClassVar[DriverRegistry[Any]] = LASER_DRIVERS


@dataclass(frozen=True, kw_only=True)
class TorchSettings(DeviceSettings):
    """The table [torch]: which torch the crawler carries, and what its axes can do.

    Parameters
    ----------
    reach : float
        To either side of the vehicle's middle, metres.
    speed : float
        Across the joint, m/s.
    aside : float
        How far the torch is to the right of the laser's zero where its axis is at zero, metres, as
        ``tjscan crawl register`` finds it.
    jog : float
        How far a person may move it beside its path, to either side, metres.
    """

    registry: ClassVar[DriverRegistry[Any]] = TORCH_DRIVERS

    reach: Annotated[float, Gt(0), Le(500), MM] = 0.030
    speed: Annotated[float, Gt(0), Le(1000), MM_S] = 0.1
    aside: Annotated[float, Ge(-100), Le(100), MM] = 0.0
    jog: Annotated[float, Ge(0), Le(20), MM] = 3e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedWeldSettings(WeldFaults):
    """The table [simulation.weld]: beads of the bead model lie where the torch truly was.

    Parameters
    ----------
    wire_diameter : float
        Of the wire, metres.
    efficiency : float
        Share of the molten wire that ends in the weld.
    wire_feed : float
        Of passes that state none, m/s.
    heat_power : float
        Of the arc in the weld, k U I, in watts.
    tilt : float
        Of gravity in the section, to the left plate; zero if the joint is level or climbs; radians.
    """

    wire_diameter: Annotated[float, Gt(0), Le(10), MM] = 1.2e-3
    efficiency: Annotated[float, Gt(0), Le(1)] = 0.95
    wire_feed: Annotated[float, Gt(0), Le(30), M_PER_MIN] = 9 / 60
    heat_power: Annotated[float, Gt(0), Le(50e3), WATT_UNIT] = 5600.0
    tilt: Annotated[float, Ge(-90), Le(90), DEG] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CrawlSimulationSettings(SettingsTable):
    """The table [simulation]: the world of a simulated crawl.

    Parameters
    ----------
    seed : int
        Of all random numbers.
    arc_points : float
        Share of the laser's columns that show the arc's light while it burns.
    joint : HullJoint
        The joint as it truly is. It starts at x = 0 of the hull.
    laser : SectionLaserModel
    vehicle : VehicleSimulationSettings
    torch_aside : float
        How far the torch truly is to the right of the laser's zero, metres.
    weld : SimulatedWeldSettings, optional
        Without, each pass leaves the bead that the joint states for it.
    """

    seed: Annotated[int, Ge(0)] = 1
    arc_points: Annotated[float, Ge(0), Le(90), PERCENT_UNIT] = 0.05
    joint: HullJoint = field(default_factory=HullJoint)
    laser: SectionLaserModel = field(default_factory=SectionLaserModel)
    vehicle: VehicleSimulationSettings = field(default_factory=VehicleSimulationSettings)
    torch_aside: Annotated[float, Ge(-100), Le(100), MM] = 0.0
    weld: SimulatedWeldSettings | None = None

    def contradictions(self, stated_radius: float | None) -> Iterator[tuple[str, str]]:
        """Yield key and message of what of the joint does not fit the job or the laser."""
        joint = self.joint
        if (stated_radius or 0.0) * (joint.radius or 0.0) < 0:
            yield (
                "course.radius_m",
                f"is {stated_radius:g} m, and the simulated joint bends the other way with "
                f"{joint.radius:g} m: both are positive if the joint bends to the right",
            )
        line = 2 * LASER_STAND_OFF * tan(self.laser.half_angle)
        if not joint.width + 2 * LEAST_HULL_EACH_SIDE < line:
            yield (
                "simulation.joint.width_mm",
                f"the joint is {1e3 * joint.width:g} mm wide, and the laser's line "
                f"{1e3 * line:.0f} mm: it must see {1e3 * LEAST_HULL_EACH_SIDE:g} mm of hull on "
                "both sides. Take a wider simulation.laser.half_angle_deg",
            )


class CrawlJob(StrictFileModel):
    """A job file that describes a crawl."""

    method: Literal["slip-aware", "paper"] = "slip-aware"
    calibration: Annotated[str | None, MinLen(1)] = None
    vehicle: VehicleSettings = VehicleSettings()
    course: plan.CourseSettings = plan.CourseSettings()
    alignment: plan.AlignmentSettings = plan.AlignmentSettings()
    weld: plan.WeldSettings = plan.WeldSettings()
    passes: Annotated[
        tuple[plan.PassSettings, ...],
        MinLen(1),
        MaxLen(50),
        LIST_OR_WORD_IN_FILE,
        Field(alias="pass"),
    ] = (plan.PassSettings(),)
    laser: CrawlLaserSettings = CrawlLaserSettings()
    torch: TorchSettings = TorchSettings()
    power: PowerSettings | None = None
    steering: SteeringSettings = SteeringSettings()
    slip: SlipUncertainty = SlipUncertainty()
    paper: PaperSettings = PaperSettings()
    proximity: ProximitySettings = ProximitySettings()
    guards: plan.GuardSettings = plan.GuardSettings()
    size: SizeSettings = SizeSettings()
    simulation: CrawlSimulationSettings | None = None

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Yield key and message of devices, course, passes and simulation that do not fit."""
        for table in filter(None, (self.vehicle, self.laser, self.torch, self.power)):
            registry = table.registry
            if self.simulation is None and table.driver_kind is DriverKind.SIMULATED:
                device = registry.device.replace("_", " ")
                real = ", ".join(sorted(set(registry.names) - {table.driver, "replay"}))
                yield (
                    "simulation",
                    f"a simulated {device} needs a [simulation] table; {registry.key} names a real "
                    f"one: {real}",
                )
            if table.driver_kind is DriverKind.REPLAYED:
                yield str(registry.key), "a crawl replays with tjscan crawl replay"
        radius, least = self.course.radius, self.steering.least_radius
        if radius is not None and not abs(radius) > least:
            yield (
                "course.radius_m",
                f"the joint bends with {abs(radius):g} m, and the vehicle turns no tighter than "
                f"steering.least_radius_mm allows, {least:g} m",
            )
        for number, one in enumerate(self.passes, start=1):
            farthest = float((np.abs(one.table.offset) + one.table.weave).max())
            farthest += abs(self.torch.aside)
            if farthest > self.torch.reach:
                yield (
                    "torch.reach_mm",
                    f"pass {number} has the torch up to {1e3 * farthest:g} mm beside the joint, "
                    f"and its axis reaches {1e3 * self.torch.reach:g} mm: make offset_mm or "
                    "weave_mm of the pass smaller",
                )
            if one.edge_gap is not None and self.method == "paper":
                yield "pass.edge_gap_mm", f"pass {number}: the paper's method reads no edges"
            if one.edge_gap is not None and self.weld.layers:
                reason = "passes planned from looks weave as stated: give weave_mm instead"
                yield "pass.edge_gap_mm", f"pass {number}: {reason}"
        if self.simulation is not None:
            yield from self.simulation.contradictions(radius)
        yield from self._contradictions_of_weld()

    def _contradictions_of_weld(self) -> Iterator[tuple[str, str]]:
        """Of passes that are planned from looks, and of an arc by a power source."""
        weld, power = self.weld, self.power
        if weld.wps is None and (weld.layers or power is not None):
            yield "weld.wps", "an arc by [power], and passes planned from looks, need a WPS"
        if power is not None:
            is_real = not power.is_on_this_machine
            if is_real and self.vehicle.driver_kind is DriverKind.SIMULATED:
                yield "power.driver", "a real arc would burn in one spot: the vehicle is simulated"
            if weld.height is not None and power.driver == "none":
                yield "weld.height", "no one measures the current of an arc that is struck by hand"
        elif weld.height is not None:
            yield "weld.height", "the torch's height follows the current of an arc by [power]"
        if not (weld.layers or power is not None):
            return
        for number, one in enumerate(self.passes, start=1):
            if not np.isfinite(one.table.feed).all():
                yield "pass", f"pass {number} states no feed_m_min, by which it is welded"
        if self.torch.driver == "none" and (weld.layers or weld.height is not None):
            yield "torch.driver", "a plan, and the height by the current, need axes that move it"
        if weld.layers:
            yield from self._contradictions_of_layers()

    def _contradictions_of_layers(self) -> Iterator[tuple[str, str]]:
        """Of passes that are planned from looks."""
        weld = self.weld
        if self.method == "paper":
            yield "weld.layers", "the paper's method reads no edges, from which passes are planned"
        if sum(weld.layers) != len(self.passes):
            yield (
                "weld.layers",
                f"holds {sum(weld.layers)} beads, and the job has {len(self.passes)} passes",
            )
        if weld.run_up < self.vehicle.laser_to_torch:
            yield (
                "weld.run_up_mm",
                "the laser, ahead of the torch, has to see the start of the weld on the way back: "
                f"it must be {1e3 * self.vehicle.laser_to_torch:g} or more",
            )


def read_crawl_job(file: Path, overrides: dict[str, Any] | None = None) -> CrawlJob:
    """Read the job of a crawler, with single keys replaced; see `read_job`."""
    return read_job(CrawlJob, file, overrides)
