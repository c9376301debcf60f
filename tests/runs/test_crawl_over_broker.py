"""A crawl with a vehicle behind a real broker, whose drive fails on the way."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("paho.mqtt")

from crawls import SHORT

from tjscan.core.errors import VehicleFault
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.phases import Phase
from tjscan.job.crawl.job import read_crawl_job
from tjscan.runs.crawl.results import read_recorded_crawl
from tjscan.runs.crawl.run import CrawlContext, resume_crawl, run_crawl
from tjscan_loopback.broker import MosquittoProcess, find_mosquitto
from tjscan_loopback.process import VehicleLoopbackProcess

pytestmark = pytest.mark.skipif(find_mosquitto() is None, reason="mosquitto is not installed")


class DriveFaultInWeld:
    """A journal that makes a drive of the vehicle fail where the arc has burned for a while."""

    def __init__(self, vehicles: VehicleLoopbackProcess) -> None:
        self._vehicles, self._done = vehicles, False

    def record(self, cycle: object) -> None:
        if isinstance(cycle, CrawlCycle) and cycle.arc and cycle.travel > 0.01 and not self._done:
            self._done = True
            self._vehicles.schedule_fault("drive-fault 1")


def test_a_drive_fault_stops_it_and_no_pass_is_lost(tmp_path: Path) -> None:
    with MosquittoProcess() as broker:
        file = tmp_path / "short.toml"
        text = SHORT.replace('id = "crawler-1"', 'id = "crawler-1"\ndriver = "mqtt"')
        mqtt = f'[torch]\ndriver = "mqtt"\n[vehicle.mqtt]\nport = {broker.port}\nsilence_s = 10.0\n'
        # A machine that does much else at a time hears late where the torch is.
        text = text.replace("[guards]", "[guards]\ntorch_off_mm = 20.0")
        file.write_text(text.replace("[alignment]", mqtt + "[alignment]"))
        job = read_crawl_job(file)
        out = tmp_path / "run"
        with VehicleLoopbackProcess(broker.address, "--settings", str(file)) as vehicles:
            with pytest.raises(VehicleFault, match="over temperature"):
                run_crawl(CrawlContext(job, file, DriveFaultInWeld(vehicles)), out)
            cut = read_recorded_crawl(out)
            assert cut.events[-1].name == Phase.STOP
            assert cut.passes[0].length < 0.03
            vehicles.schedule_fault("clear")
            copied = out / "job.toml"
            resume_crawl(CrawlContext(read_crawl_job(copied), copied), overlap=0.005)
        found = read_recorded_crawl(out)
        assert [one.number for one in found.passes] == [1, 2]
        assert found.passes[0].stops == 1
        # On a busy machine a cycle comes late, and the arc goes on and off as late.
        late = np.abs(np.diff([cycle.travel for cycle in found.cycles])).max()
        assert all(one.length == pytest.approx(0.03, abs=2e-3 + late) for one in found.passes)
