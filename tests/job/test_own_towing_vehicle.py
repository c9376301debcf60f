"""A package's own vehicles and what sees them, found by entry points, tow a cable."""

from collections.abc import Iterator
from importlib.metadata import EntryPoint
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest

from tjscan.core.config import validate_table
from tjscan.core.devices import DriverRegistry, EventListener, LocalDevice, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.job.tow.cell import check_seam, make_shape_planner, make_tow_cell
from tjscan.job.tow.job import TowJob
from tjscan.runs.tow.run import make_tow
from tjscan.towing.following import velocity_from_twist
from tjscan.vehicle.drivers import (
    LOCALISATION_DRIVERS,
    TOWING_VEHICLE_DRIVERS,
    LocalisationDriverFactory,
    LocalisationInputs,
    TowingVehicleDriverFactory,
    TowingVehicleInputs,
)
from tjscan.vehicle.localisation import TrackedDisc, VehiclePose
from tjscan.vehicle.vehicle import AT_REST, LocalVehicle, VehicleState

for package in ("numba", "proxsuite", "shapely"):
    pytest.importorskip(package, reason=f"{package} is not installed: pip install 'tjscan[towing]'")

POSES: dict[int, Array] = {}
"""Of the vehicles, by their number."""

JOB = {
    "cable": {"length_mm": 1200, "link_mm": 100},
    "vehicles": {"driver": "acme", "count": 2, "acme": {"left_mm": 30}},
    "localisation": {"driver": "acme"},
    "area": {"outline_mm": [[-500, -1500], [2500, -1500], [2500, 1500], [-500, 1500]]},
    "seam": {"points_mm": [[800, 300], [800, 310]], "speed_mm_min": 600, "heading_deg": 60},
}


class AcmeVehicle(LocalVehicle):
    """Goes exactly as told, on this computer's clock."""

    def __init__(self, number: int) -> None:
        self.number, self._then = number, monotonic()

    @property
    def time(self) -> float:
        return monotonic()

    def next_state(self) -> VehicleState:
        sleep(0.01)
        now, twist = monotonic(), self.twist_to_drive() or AT_REST
        pose, period, self._then = POSES[self.number], now - self._then, now
        POSES[self.number] = pose + period * velocity_from_twist(twist, pose[2])
        return VehicleState(now, twist)


class AcmeTracker(LocalDevice):
    def read(self) -> tuple[VehiclePose | None, ...]:
        noise = 1e-5 * np.random.default_rng().standard_normal((len(POSES), 3))
        poses = [POSES[number] + noise[number - 1] for number in sorted(POSES)]
        return tuple(VehiclePose(monotonic(), *pose.tolist()) for pose in poses)

    def read_passers_by(self) -> tuple[TrackedDisc, ...]:
        return ()

    def report_events_to(self, listener: EventListener) -> None: ...


def _make_vehicle(inputs: TowingVehicleInputs, settings: NoSettings) -> AcmeVehicle:
    return AcmeVehicle(inputs.number)


def _make_tracker(inputs: LocalisationInputs, settings: NoSettings) -> AcmeTracker:
    return AcmeTracker()


VEHICLE = TowingVehicleDriverFactory(_make_vehicle)
TRACKER = LocalisationDriverFactory(_make_tracker)


@pytest.fixture
def acme(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    points = {"tjscan.towing-vehicle": "VEHICLE", "tjscan.localisation": "TRACKER"}
    monkeypatch.setattr(
        "tjscan.core.devices.entry_points",
        lambda group: (
            [EntryPoint("acme", f"{__name__}:{points[group]}", group)] if group in points else []
        ),
    )
    registries: tuple[DriverRegistry[Any], ...] = (TOWING_VEHICLE_DRIVERS, LOCALISATION_DRIVERS)
    for registry in registries:
        registry.__dict__.pop("_entries", None)
    yield
    for registry in registries:
        registry.__dict__.pop("_entries", None)


class Kept:
    def record(self, message: object) -> None: ...


@pytest.mark.usefixtures("acme")
def test_own_vehicles_tow_a_cable_along_a_seam() -> None:
    job = validate_table(TowJob, {**JOB, "vehicles": {"driver": "acme", "count": 2}})
    planner = make_shape_planner(job)
    start = check_seam(job, planner).start
    POSES.update(enumerate(start.held_poses.copy(), 1))
    with make_tow_cell(job, start.angles) as cell:
        make_tow(job, cell, planner, Kept()).run(0.0, start)
    np.testing.assert_allclose(POSES[2][:2], (0.8, 0.31), atol=2e-3)


@pytest.mark.usefixtures("acme")
def test_a_wrong_key_of_an_own_driver_is_named_with_its_table() -> None:
    with pytest.raises(ConfigurationError) as refused:
        validate_table(TowJob, JOB)
    assert refused.value.key == "vehicles.acme.left_mm"


def test_a_driver_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(ConfigurationError, match="Known: mqtt, simulated"):
        validate_table(TowJob, {**JOB, "vehicles": {"driver": "acme"}})
