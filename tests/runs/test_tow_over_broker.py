"""A tow with vehicles behind a real broker: a pose that jumps, and then a drive that fails."""

from pathlib import Path

import pytest

pytest.importorskip("paho.mqtt")
pytest.importorskip("mujoco")
pytest.importorskip("proxsuite")

from tjscan.core.errors import VehicleFault
from tjscan.job.tow.job import read_tow_job
from tjscan.runs.tow.results import read_recorded_tow
from tjscan.runs.tow.run import TowContext, run_tow
from tjscan.towing.journal import TowCycle
from tjscan_loopback.broker import MosquittoProcess, find_mosquitto
from tjscan_loopback.process import VehicleLoopbackProcess

pytestmark = pytest.mark.skipif(find_mosquitto() is None, reason="mosquitto is not installed")

JOB = """
[vehicles]
driver = "mqtt"
[vehicles.mqtt]
port = {port}
silence_s = 10.0
connect_s = 60.0
[area]
outline_mm = [[0, -5000], [2600, -5000], [2600, 5000], [0, 5000]]
[seam]
points_mm = [[2600, -300], [2600, -270]]
speed_mm_min = 600
[following]
patience_s = 10
"""


class Saboteur:
    """A journal that lets things go wrong: first poses of a vehicle, then the welder's drive."""

    def __init__(self, vehicles: VehicleLoopbackProcess) -> None:
        self._vehicles, self._cycles = vehicles, 0

    def record(self, cycle: object) -> None:
        if not isinstance(cycle, TowCycle):
            return
        self._cycles += 1
        if self._cycles == 5:
            self._vehicles.schedule_fault("pose-jump 1")
        elif cycle.wait and "jumped" in cycle.wait:
            self._vehicles.schedule_fault("clear")
        elif cycle.along > 0.015 and self._cycles > 5:
            self._vehicles.schedule_fault("drive-fault 6")


def test_a_jump_is_waited_out_and_a_failed_drive_of_the_welder_ends_it(tmp_path: Path) -> None:
    with MosquittoProcess() as broker:
        file, out = tmp_path / "job.toml", tmp_path / "run"
        file.write_text(JOB.format(port=broker.port))
        with VehicleLoopbackProcess(broker.address, "--settings", str(file)) as vehicles:
            with pytest.raises(VehicleFault, match=r"the welder is stopped: .*left drive"):
                run_tow(TowContext(read_tow_job(file), file, Saboteur(vehicles)), out)
            truth = vehicles.ask_for_truth()
    assert truth["touches"] == []
    assert truth["bend_deg"] < 44.2
    found = read_recorded_tow(out)
    names = [event.name for event in found.events]
    assert "waits" in names
    assert "goes on" in names
    assert names[-1] == "stop"
    assert 0.01 < found.cycles[-1].along < 0.03
