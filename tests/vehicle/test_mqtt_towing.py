"""Vehicles at a cable through a real broker: the command, its vehicles, its tracker, its faults."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import tjscan

from tjscan.core.errors import DriveFault
from tjscan.vehicle.vehicle import Twist
from tjscan_loopback.broker import MosquittoProcess, find_mosquitto
from tjscan_loopback.process import VehicleLoopbackProcess

pytest.importorskip("paho.mqtt", reason="paho-mqtt is not installed")
for package in ("mujoco", "numba", "proxsuite", "shapely"):
    pytest.importorskip(package, reason=f"{package} is not installed: pip install 'tjscan[towing]'")
pytestmark = pytest.mark.skipif(find_mosquitto() is None, reason="mosquitto is not installed")

from tjscan.vehicle.mqtt.localisation import MqttLocalisation  # noqa: E402
from tjscan.vehicle.mqtt.settings import MqttLocalisationSettings, MqttSettings  # noqa: E402
from tjscan.vehicle.mqtt.vehicle import MqttVehicle  # noqa: E402

LONGEST = 120.0
"""Seconds that anything may take on a busy machine."""

JOB = """
[cable]
length_mm = 1200
link_mm = 100

[vehicles]
count = 2

[area]
outline_mm = [[-500, -1500], [2500, -1500], [2500, 1500], [-500, 1500]]

[seam]
points_mm = [[800, 300], [800, 400]]
speed_mm_min = 600
heading_deg = 60

[[obstacles]]
radius_mm = 100
points_mm = [[2000, -1200], [2000, 1200]]
speed_mm_min = 600
"""


@pytest.fixture(scope="module")
def broker() -> Iterator[MosquittoProcess]:
    with MosquittoProcess() as process:
        yield process


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("tow") / "tow.toml"
    file.write_text(JOB, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def running(broker: MosquittoProcess, job: Path) -> Iterator[VehicleLoopbackProcess]:
    with VehicleLoopbackProcess(broker.address, "--settings", str(job)) as process:
        yield process


def vehicle(broker: MosquittoProcess, number: int) -> MqttVehicle:
    return MqttVehicle(
        MqttSettings(port=broker.port, prefix=f"tjscan/vehicle/{number}", connect_limit=LONGEST)
    )


def until(true: Callable[[], Any]) -> None:
    """Go on until that is true."""
    last = time.monotonic() + LONGEST
    while not true():
        assert time.monotonic() < last


def test_the_welder_drives_sideways_and_is_seen_to(
    running: VehicleLoopbackProcess, broker: MosquittoProcess
) -> None:
    settings = MqttLocalisationSettings(port=broker.port, connect_limit=LONGEST)
    start = np.array(running.ask_for_truth()["poses"])
    with MqttLocalisation(settings, 2) as eyes, vehicle(broker, 2) as welder:
        assert welder.identity.model == "loopback towing vehicle"
        seen: list[float] = []

        def has_moved() -> bool:
            welder.command(Twist(0.0, 0.0, -0.02))
            welder.next_state()
            pose = eyes.read()[1]
            if pose is not None:
                seen.append(float(np.hypot(pose.x - start[1, 0], pose.y - start[1, 1])))
            return bool(seen) and seen[-1] > 0.02

        until(has_moved)
        assert [disc.radius for disc in eyes.read_passers_by()] == [0.1]
    moved = np.array(running.ask_for_truth()["poses"]) - start
    assert np.hypot(*moved[1, :2]) > 0.015
    assert np.hypot(*moved[0, :2]) < 0.01


def test_a_stopped_vehicle_says_so_and_the_other_drives_on(
    running: VehicleLoopbackProcess, broker: MosquittoProcess
) -> None:
    with vehicle(broker, 1) as first, vehicle(broker, 2) as welder:
        running.schedule_fault("stop 1")

        def has_failed() -> bool:
            welder.command(Twist(0.0, 0.0, 0.0))
            welder.next_state()
            return "jammed" in first.next_state().fault

        until(has_failed)
        with pytest.raises(DriveFault, match="jammed"):
            first.command(Twist(0.0, 0.0))
        welder.command(Twist(0.0, 0.0))
        running.schedule_fault("clear")


def test_a_crawlers_fault_is_refused(running: VehicleLoopbackProcess) -> None:
    running.write_line("edge")
    assert "can't have the fault edge" in running.wait_for_line("refused")


def test_another_number_of_vehicles_is_refused(
    job: Path, broker: MosquittoProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ("vehicle-loopback", "--vehicles", "3", "--settings", job)
    assert tjscan(*command, "--broker", broker.address, pictures=True) == 2
    assert "the job has 2 vehicles (found 3)" in capsys.readouterr().err
