"""What is asked for by name is found, or refused with what would be right."""

import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from tjscan.core.devices import DriverFactory, DriverRegistry, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.job.crawl.job import TORCH_DRIVERS
from tjscan.laser.drivers import LASER_DRIVERS
from tjscan.robot.drivers import ARM_DRIVERS
from tjscan.vehicle.drivers import (
    LOCALISATION_DRIVERS,
    TOWING_VEHICLE_DRIVERS,
    VEHICLE_DRIVERS,
)

PI: DriverFactory[Any, float] = DriverFactory(lambda inputs, settings: 3.14159)
TAU: DriverFactory[Any, float] = DriverFactory(lambda inputs, settings: 6.28319)
KNOWN = DriverRegistry("thing", {"pi": PI, "tau": TAU}, "thing.driver")


@pytest.fixture
def added(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that gives a registry to which another package adds a driver at a place."""

    def add(name: str, place: str, kind: type[Any] = EntryPoint) -> DriverRegistry[Any]:
        points = {"tjscan.thing": [kind(name, place, "tjscan.thing")]}
        monkeypatch.setattr("tjscan.core.devices.entry_points", lambda group: points.get(group, []))
        return DriverRegistry("thing", {"pi": PI}, "thing.driver")

    return add


def test_an_entry_is_loaded_when_it_is_asked_for() -> None:
    assert KNOWN.load("pi") is PI
    assert KNOWN.make("tau", None, NoSettings()) == pytest.approx(6.28319)


@pytest.mark.parametrize(
    "registry",
    [
        *(ARM_DRIVERS, LASER_DRIVERS, VEHICLE_DRIVERS),
        *(TOWING_VEHICLE_DRIVERS, LOCALISATION_DRIVERS, TORCH_DRIVERS),
    ],
    ids=lambda registry: registry.device,
)
def test_every_driver_of_this_package_is_of_the_type_that_its_registry_holds(
    registry: DriverRegistry[Any],
) -> None:
    for name in registry.own:
        assert isinstance(registry.load(name), registry.type)


def test_an_unknown_name_is_refused_with_the_nearest_and_all_known() -> None:
    with pytest.raises(ConfigurationError, match=r"did you mean: tau\? Known: pi, tau"):
        KNOWN.load("tua")


def test_a_missing_package_is_named_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, added: Any
) -> None:
    (tmp_path / "needy_driver.py").write_text("import no_such_package\nDRIVER = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigurationError, match="pip install no_such_package"):
        added("needy", "needy_driver:DRIVER").load("needy")
    sys.modules.pop("needy_driver", None)
    needy: DriverFactory[Any, Any] = DriverFactory(
        lambda inputs, settings: __import__("no_such_package"), extra="xy"
    )
    with pytest.raises(ConfigurationError, match=r"no_such_package.*pip install 'tjscan\[xy\]'"):
        DriverRegistry("thing", {"needy": needy}, "thing.driver").make("needy", None, NoSettings())


def test_what_a_package_registered_wrongly_is_named(added: Any) -> None:
    with pytest.raises(ConfigurationError, match="registered as math:pie, which can't be loaded"):
        added("pie", "math:pie").load("pie")
    with pytest.raises(ConfigurationError, match="registered as math:e, which is no DriverFactory"):
        added("e", "math:e").load("e")
    with pytest.raises(ConfigurationError, match="pip install tjscan_acme"):
        added("acme", "tjscan_acme:DRIVER").load("acme")


@pytest.mark.parametrize("module", ["importlib.metadata", "importlib_metadata"])
def test_another_package_adds_an_entry(added: Any, module: str) -> None:
    # Once anything has imported the backport, which Dask does, entry points are of its class.
    registry = added("tau", f"{__name__}:TAU", pytest.importorskip(module).EntryPoint)
    assert registry.names == ("pi", "tau")
    assert registry.load("tau") is TAU
