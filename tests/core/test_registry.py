"""What is asked for by name is found, or refused with what would be right."""

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from tjscan.core.devices import DriverRegistry
from tjscan.core.errors import ConfigurationError
from tjscan.job.crawl.job import TORCH_DRIVERS
from tjscan.laser.drivers import LASER_DRIVERS
from tjscan.robot.drivers import ARM_DRIVERS
from tjscan.vehicle.drivers import (
    LOCALISATION_DRIVERS,
    TOWING_VEHICLE_DRIVERS,
    VEHICLE_DRIVERS,
)

KNOWN: DriverRegistry[object] = DriverRegistry("thing", {"pi": "math:pi", "tau": "math:tau"})


def test_an_entry_is_loaded_when_it_is_asked_for() -> None:
    assert KNOWN.load("pi") == pytest.approx(3.14159, abs=1e-5)


@pytest.mark.parametrize(
    "registry",
    [
        *(ARM_DRIVERS, LASER_DRIVERS, VEHICLE_DRIVERS),
        *(TOWING_VEHICLE_DRIVERS, LOCALISATION_DRIVERS, TORCH_DRIVERS),
    ],
    ids=lambda registry: registry.kind,
)
def test_every_driver_of_this_package_is_where_its_registry_names_it(
    registry: DriverRegistry[object],
) -> None:
    for name in registry.own:
        registry.load(name)


def test_an_unknown_name_is_refused_with_the_nearest_and_all_known() -> None:
    with pytest.raises(ConfigurationError, match=r"did you mean: tau\? Known: pi, tau"):
        KNOWN.load("tua")


def test_a_missing_package_is_named_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "needy_driver.py").write_text("import no_such_package\nDRIVER = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    own = {"needy": "needy_driver:DRIVER"}
    with pytest.raises(ConfigurationError, match=r"no_such_package.*pip install 'tjscan\[xy\]'"):
        DriverRegistry("thing", own, {"needy": "xy"}).load("needy")
    sys.modules.pop("needy_driver", None)
    with pytest.raises(ConfigurationError, match="pip install no_such_package"):
        DriverRegistry("thing", own).load("needy")


def test_what_a_package_registered_wrongly_is_named() -> None:
    with pytest.raises(ConfigurationError, match="registered as math:pie, which can't be loaded"):
        DriverRegistry("thing", {"pi": "math:pie"}).load("pi")
    with pytest.raises(ConfigurationError, match="registered as math:pi, which is no str"):
        DriverRegistry("thing", {"pi": "math:pi"}, type=str).load("pi")
    with pytest.raises(ConfigurationError, match="pip install tjscan_acme"):
        DriverRegistry("thing", {"acme": "tjscan_acme:DRIVER"}).load("acme")


def test_another_package_adds_an_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("e", "math:e", "tjscan.thing")
    monkeypatch.setattr(
        "tjscan.core.devices.entry_points",
        lambda group: [point] if group == "tjscan.thing" else [],
    )
    registry: DriverRegistry[float] = DriverRegistry("thing", {"pi": "math:pi"})
    assert registry.names == ("e", "pi")
    assert registry.load("e") == pytest.approx(2.71828, abs=1e-5)
