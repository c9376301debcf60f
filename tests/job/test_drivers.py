"""A job names its arm and its laser, each on its own."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from cells import PAPER
from command import tjscan
from ur_cell import address

from tjscan.calibration.wizard.operator import JoggedProbe
from tjscan.core.config import table_to_dict
from tjscan.core.errors import ConfigurationError
from tjscan.job.files import read_calibration_job, read_scan_job
from tjscan.laser.drivers import LASER_DRIVERS
from tjscan.robot.drivers import ARM_DRIVERS
from tjscan.runs.calibration.run import make_calibration_cell
from tjscan.runs.scan.run import ScanContext
from tjscan_loopback.process import UrLoopbackProcess

ACME = """
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt

from tjscan.core.units import FileUnit, SettingsTable
from tjscan.laser.drivers import LaserDriverFactory


@dataclass(frozen=True)
class Acme(SettingsTable):
    host: str
    exposure: Annotated[float, Gt(0), FileUnit("us", 1e-6)] = 1e-4


def make(context, settings):
    import no_such_package


DRIVER = LaserDriverFactory(make, Acme)
"""
"""A driver of another package."""

UR: dict[str, Any] = {"arm.driver": "ur", "arm.ur.host": "127.0.0.9"}
REPLAY: dict[str, Any] = {"laser.driver": "replay", "laser.recording": "run"}


@pytest.fixture
def acme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    (tmp_path / "acme_laser.py").write_text(ACME)
    monkeypatch.syspath_prepend(tmp_path)
    driver = EntryPoint("acme", "acme_laser:DRIVER", "tjscan.laser")
    monkeypatch.setitem(vars(LASER_DRIVERS), "_entries", {**LASER_DRIVERS._entries, "acme": driver})
    yield
    sys.modules.pop("acme_laser", None)


def bare(folder: Path, overrides: dict[str, Any]) -> Path:
    """The example without a simulated world and without a joint."""
    data = table_to_dict(read_scan_job(PAPER, overrides))
    del data["simulation"], data["joint"]
    file = folder / "bare.toml"
    file.write_text(tomli_w.dumps(data), encoding="utf-8")
    return file


def test_a_real_arm_scans_with_a_replayed_laser_and_nothing_simulated(tmp_path: Path) -> None:
    pytest.importorskip("rtde_control")
    sections, run, again = ("--scan.sections", "4"), tmp_path / "run", tmp_path / "again"
    assert tjscan("scan", PAPER, *sections, "--out", run) == 0
    file = bare(tmp_path, UR | REPLAY)
    with UrLoopbackProcess(address(), "--fast") as loopback:
        options = ("--arm.ur.host", loopback.host, "--laser.recording", run, "--out", again)
        assert tjscan("scan", file, *sections, *options) == 0
        assert any(line.startswith("move") for line in loopback.unread_output())
    first, second = (json.loads((d / "summary.json").read_text()) for d in (run, again))
    assert (first["frame"], second["frame"]) == ("j", "b")
    assert first["sections"] == second["sections"] == 4
    # The arm stands within hundredths of a millimetre of where the profiles were taken.
    assert second["groove_length_mm"] == pytest.approx(first["groove_length_mm"], abs=0.1)


def test_a_simulated_arm_scans_with_a_replayed_laser(tmp_path: Path) -> None:
    sections, run, again = ("--scan.sections", "4"), tmp_path / "run", tmp_path / "again"
    assert tjscan("scan", PAPER, *sections, "--out", run) == 0
    replay = ("--laser.driver", "replay", "--laser.recording", run, "--out", again)
    assert tjscan("scan", PAPER, *sections, *replay) == 0
    assert rows_of(run) == rows_of(again)


def rows_of(run: Path) -> list[str]:
    """The rows of a run's sections, without the comments that say when they were written."""
    lines = (run / "sections.csv").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if not line.startswith("#")]


@pytest.mark.parametrize(
    ("overrides", "key", "words"),
    [
        ({"arm.driver": "fanu"}, "arm.driver", "no arm 'fanu'.*Known: abb, fanuc, kuka, replay"),
        ({"laser.driver": "simulatde"}, "laser.driver", "did you mean: simulated"),
        ({"arm.driver": "ur"}, "arm.driver", r"needs a table \[arm.ur\] with host"),
        ({"arm.ur.hots": "10.0.0.1"}, "arm.ur.hots", "unknown key; did you mean: host"),
        ({"arm.ur.host": "x", "arm.ur.payload_kg": -1}, "arm.ur.payload_kg", "greater than"),
        (
            {"arm.driver": "urr", "arm.urr.host": "x"},
            "arm.driver",
            "no arm 'urr'.*Known: abb, fanuc, kuka",
        ),
        ({"arm.urr.host": "10.0.0.1"}, "arm.urr", "unknown key; did you mean: ur"),
        ({"arm.ur": 3}, "arm.ur", "must be a table"),
        ({"arm.driver": "replay"}, "arm.driver", 'laser.driver must be "replay"'),
    ],
)
def test_a_wrong_driver_or_table_is_named_with_what_would_be_right(
    overrides: dict[str, Any], key: str, words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words) as caught:
        read_scan_job(PAPER, overrides)
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({}, "a simulated arm needs"),
        (UR, "a simulated laser needs"),
    ],
)
def test_what_is_simulated_needs_its_world(
    overrides: dict[str, Any], words: str, tmp_path: Path
) -> None:
    file = bare(tmp_path, {})
    with pytest.raises(ConfigurationError, match=words):
        ScanContext(read_scan_job(file, overrides), file).make_cell()


@pytest.mark.parametrize(
    "overrides", [{"laser.driver": "points"}, {"laser.points": {"host": "10.0.0.2"}}], ids=str
)
def test_a_driver_of_another_package_with_the_name_of_a_key_is_refused(
    overrides: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    entries = {**LASER_DRIVERS._entries, "points": LASER_DRIVERS._entries["simulated"]}
    monkeypatch.setitem(vars(LASER_DRIVERS), "_entries", entries)
    assert read_scan_job(PAPER, {"laser.points": 320}).laser.points == 320
    with pytest.raises(
        ConfigurationError, match=r"'points'.*a key of the table \[laser\]"
    ) as caught:
        read_scan_job(PAPER, overrides)
    assert caught.value.key == "laser.driver"


@pytest.mark.usefixtures("acme")
class TestDriverOfAnotherPackage:
    """Its table is checked like our own."""

    def test_its_settings_are_read_in_si_and_written_as_they_stood(self) -> None:
        table = {"host": "10.0.0.2", "exposure_us": 80.0}
        job = read_scan_job(PAPER, UR | {"laser.driver": "acme", "laser.acme": table})
        assert job.laser.driver_settings.exposure == pytest.approx(80e-6)
        assert table_to_dict(job)["laser"]["acme"] == table

    @pytest.mark.parametrize(
        ("table", "key", "words"),
        [
            ({"host": "x", "exposure_ms": 1}, "laser.acme.exposure_ms", "exposure_us"),
            ({"host": "x", "exposure_us": 0}, "laser.acme.exposure_us", "greater than 0"),
            ({}, "laser.acme.host", "required"),
        ],
    )
    def test_what_is_wrong_in_its_table_is_named(
        self, table: dict[str, Any], key: str, words: str
    ) -> None:
        with pytest.raises(ConfigurationError, match=words) as caught:
            read_scan_job(PAPER, UR | {"laser.driver": "acme", "laser.acme": table})
        assert caught.value.key == key

    def test_a_real_laser_needs_the_real_arm_that_carries_it(self) -> None:
        with pytest.raises(ConfigurationError, match="a real laser can't sit on a simulated arm"):
            read_scan_job(PAPER, {"laser.driver": "acme", "laser.acme.host": "x"})

    def test_a_package_that_it_lacks_is_named(self) -> None:
        job = read_scan_job(PAPER, UR | {"laser.driver": "acme", "laser.acme.host": "x"})
        with pytest.raises(ConfigurationError, match="pip install no_such_package") as caught:
            ScanContext(job, PAPER).make_cell()
        assert caught.value.key == "laser.driver"


def test_a_missing_client_library_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(vars(ARM_DRIVERS.load("ur")), "client", "no_such_client")
    with pytest.raises(ConfigurationError, match=r"pip install 'tjscan\[ur\]'") as caught:
        ScanContext(read_scan_job(PAPER, UR), PAPER).make_cell()
    assert caught.value.key == "arm.driver"


def test_every_registered_driver_loads() -> None:
    for registry in (ARM_DRIVERS, LASER_DRIVERS):
        for name in registry.names:
            assert registry.load(name).kind


def test_a_person_jogs_the_arm_onto_the_board_of_a_real_laser(
    acme: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = LASER_DRIVERS.load("acme")
    monkeypatch.setitem(vars(driver), "make", lambda inputs, settings: None)
    keys = {**UR, "laser.driver": "acme", "laser.acme.host": "10.0.0.1"}
    job = read_calibration_job(PAPER.with_name("calibrate.toml"), keys)
    _, probe = make_calibration_cell(job, np.eye(4))
    assert isinstance(probe, JoggedProbe)
