"""What all devices share: who they are, what they report, and how a driver registers them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.util import find_spec
from types import TracebackType
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar

from tjscan.core.errors import TjscanError
from tjscan.core.registry import Registry
from tjscan.core.units import SettingsTable

C = TypeVar("C")
D = TypeVar("D")

EventListener = Callable[[str, str], None]
"""Receives an event: its name in one word, and a sentence."""


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """Which device it is, as far as it reports that; empty if it does not.

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


class Device(Protocol):
    """What every device has. It is a context manager: entering connects it, leaving disconnects."""

    def __enter__(self) -> Self:
        """Connect."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
        /,
    ) -> None:
        """Bring it to rest and disconnect."""

    @property
    def identity(self) -> DeviceIdentity:
        """Which device it is; known while connected."""

    def report_events_to(self, listener: EventListener) -> None:
        """Report events to a listener from now on."""


class DeviceBase:
    """Base of drivers whose device reports neither its identity nor any events."""

    @property
    def identity(self) -> DeviceIdentity:
        """Which device it is; known while connected."""
        return DeviceIdentity()

    def report_events_to(self, listener: EventListener) -> None:
        """Send the device's events to a listener from now on; a device of this base has none."""


class LocalDevice(DeviceBase):
    """Base of simulated and replayed devices: a ``with`` block connects them."""

    not_connected: ClassVar[tuple[type[TjscanError], str]]
    """Error of a call outside a ``with`` block, and its message."""

    _connected = False

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *error: object) -> None:
        self._connected = False

    def check_connected(self) -> None:
        """Refuse a call outside a ``with`` block."""
        if not self._connected:
            error, message = self.not_connected
            raise error(message)


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
    by name in `ARM_DRIVERS` there, or a `tjscan.laser.drivers.LaserDriverFactory`, in
    `LASER_DRIVERS`. A package of its own registers it by an entry point::

        [project.entry-points."tjscan.laser"]
        acme = "acme_tjscan:DRIVER"

    Then a job may have ``laser.driver = "acme"``, and its table ``[laser.acme]`` is checked against
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


F = TypeVar("F", bound=DriverFactory[Any, Any])


@dataclass(frozen=True)
class DriverRegistry(Registry[F]):
    """Every driver of a kind of device by name; see `DriverFactory` for how to add one.

    Parameters
    ----------
    clients : mapping of str to str, optional
        For a driver whose client library is imported in a process of its own alone: the library's
        module.
    """

    clients: Mapping[str, str] = field(default_factory=dict)

    def make(self, name: str, inputs: Any, settings: Any) -> Any:
        """Make the device of a driver, not yet connected.

        Parameters
        ----------
        name : str
            Name of the driver.
        inputs : object
            What every driver of this kind is given, for instance `ArmDriverInputs`.
        settings : object
            Settings of the driver, an instance of its `DriverFactory.table`.

        Raises
        ------
        ConfigurationError
            If there is no such driver, or a package is missing that it needs.
        """
        factory = self.load(name)
        client = self.clients.get(name)
        if client is not None and find_spec(client) is None:
            raise self.missing_package_error(name, client)
        with self.explain_missing_package(name):
            return factory.make(inputs, settings)
