"""A real crawler's laser and torch are named in its job, from the same registries as an arm's."""

from pathlib import Path
from typing import Any

import pytest

from tjscan.core.devices import DriverFactory, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.crawler.torch_axes import FixedTorch
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.laser.drivers import LASER_DRIVERS, LaserDriverInputs
from tjscan.laser.replay import ReplayedLaser

pytest.importorskip("paho.mqtt")

REAL = """
[vehicle]
driver = "mqtt"
[laser]
driver = "acme"
[torch]
driver = "{torch}"
"""


class AcmeLaser:
    """Stands for a laser of another package."""


def _make(context: LaserDriverInputs, settings: NoSettings) -> Any:
    return AcmeLaser()


ACME: DriverFactory[LaserDriverInputs, Any] = DriverFactory(_make)
OF_AN_ARM: DriverFactory[LaserDriverInputs, Any] = DriverFactory(
    lambda context, settings: ReplayedLaser(*context.recording(), context.carrier.T_b_f, float)
)


def read(tmp_path: Path, text: str) -> CrawlJob:
    file = tmp_path / "job.toml"
    file.write_text(text)
    return read_crawl_job(file)


@pytest.fixture(autouse=True)
def lasers(monkeypatch: pytest.MonkeyPatch) -> None:
    entries = {**LASER_DRIVERS._entries, "acme": ACME, "of-an-arm": OF_AN_ARM}
    monkeypatch.setitem(vars(LASER_DRIVERS), "_entries", entries)


def test_a_real_crawler_has_the_laser_and_the_torch_that_its_job_names(tmp_path: Path) -> None:
    cell = make_crawl_cell(read(tmp_path, REAL.format(torch="none")))
    assert isinstance(cell.laser, AcmeLaser)
    assert isinstance(cell.torch, FixedTorch)
    assert cell.simulated_place is None


def test_its_torch_may_hang_on_the_link_of_its_vehicle(tmp_path: Path) -> None:
    from tjscan.vehicle.mqtt.torch import MqttTorch

    assert isinstance(make_crawl_cell(read(tmp_path, REAL.format(torch="mqtt"))).torch, MqttTorch)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('vehicle.driver = "mqtt"', "a simulated laser needs .*laser.driver names a real one"),
        ('vehicle.driver = "mqtt"\nlaser.driver = "acme"', "a simulated torch needs"),
        (REAL.format(torch="fixed"), "there is no torch 'fixed'"),
        ('laser.driver = "replay"\n[simulation]', "tjscan crawl replay"),
        ('vehicle.driver = "replay"\n[simulation]', "tjscan crawl replay"),
    ],
)
def test_what_can_not_be_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('torch.driver = "mqtt"\n[simulation]', "vehicle.driver must be"),
        (REAL.format(torch="none").replace("acme", "of-an-arm"), "an arm's flange"),
    ],
)
def test_devices_that_do_not_fit_one_another_are_refused(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words):
        make_crawl_cell(read(tmp_path, text))
