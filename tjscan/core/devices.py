"""What all devices share: who they are, what they report, and how a driver registers them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Generic, TypeVar

from tjscan.core.units import SettingsTable

C = TypeVar("C")
D = TypeVar("D")

EventListener = Callable[[str, str], None]
"""Receives an event: its name in one word, and a sentence."""


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """Which device it is, as far as it reports that; empty where it does not.

    Parameters
    ----------
    model, serial, software : str
        Model, serial number, and version of its firmware or controller software.
    """

    model: str = ""
    serial: str = ""
    software: str = ""

    def __bool__(self) -> bool:
        return any((self.model, self.serial, self.software))

    def __str__(self) -> str:
        parts = (("serial number", self.serial), ("software", self.software))
        return ", ".join((self.model or "unnamed", *(f"{k} {v}" for k, v in parts if v)))


class DeviceBase:
    """Base of drivers whose device reports neither its identity nor any events."""

    @property
    def identity(self) -> DeviceIdentity:
        """Which device it is; known while connected."""
        return DeviceIdentity()

    def report_events_to(self, listener: EventListener) -> None:
        """Send the device's events to a listener from now on; a device of this base has none."""


class DriverKind(StrEnum):
    """Whether a driver's device is real, simulated or replayed from a recording."""

    REAL = "real"
    SIMULATED = "simulated"
    REPLAYED = "replayed"


@dataclass(frozen=True)
class NoSettings(SettingsTable):
    """Empty table of a driver that has no settings."""


@dataclass(frozen=True)
class DriverFactory(Generic[C, D]):
    """How a driver makes its device from the settings in a job file.

    A driver is a module with one of these: a `tjscan.robot.drivers.ArmDriverFactory`, registered
    by name in `ARMS` there, or a `tjscan.laser.drivers.LaserDriverFactory`, in `LASER_DRIVERS`. A
    package of its own registers it by an entry point::

        [project.entry-points."tjscan.laser"]
        acme = "acme_tjscan:DRIVER"

    Then a job may say ``laser.driver = "acme"``, and its table ``[laser.acme]`` is checked against
    `table`. Import what is heavy inside `make`: tables are checked without it.

    Parameters
    ----------
    make : callable
        Makes the device, not yet connected, from its inputs (`ArmDriverInputs`,
        `LaserDriverInputs`) and the settings, an instance of `table`.
    table : type of SettingsTable, optional
        Its own table in the job file.
    kind : DriverKind, optional
        A device, a simulation or a recording.
    """

    make: Callable[[C, Any], D]
    table: type[SettingsTable] = NoSettings
    kind: DriverKind = DriverKind.REAL
