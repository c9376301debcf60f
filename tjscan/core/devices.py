"""What all devices share: who they are, what they report, and how a driver registers them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar

from tjscan.core import errors
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

    def __exit__(self, *error: Any) -> None:
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

    not_connected: ClassVar[tuple[type[errors.TjscanError], str]]
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


F = TypeVar("F")


@dataclass(frozen=True)
class DriverRegistry(Generic[F]):
    """Every driver of a kind of device by name; each is imported only when it is loaded.

    Another package adds to it by an entry point in the group ``tjscan.<kind>``; see
    `DriverFactory`.

    Parameters
    ----------
    kind : str
        What its entries are, in one word for messages, for instance ``arm``.
    own : mapping of str to str
        Name of each entry of this package, and where it is: ``module:attribute``.
    extras : mapping of str to str
        For an entry that needs more than a plain install: the extra to install.
    key : str, optional
        Where a job file names an entry, for messages, for instance ``arm.driver``.
    type : type, optional
        What every entry is an instance of.
    clients : mapping of str to str, optional
        For a driver whose client library is imported in a process of its own alone: the library's
        module.
    """

    kind: str
    own: Mapping[str, str]
    extras: Mapping[str, str] = field(default_factory=dict)
    key: str | None = None
    type: type[Any] = object
    clients: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def _places(self) -> dict[str, str]:
        added = entry_points(group=f"tjscan.{self.kind}")
        return {**{point.name: point.value for point in added}, **self.own}

    @property
    def table_key(self) -> str:
        """Table of a job file that names an entry."""
        return (self.key or self.kind).partition(".")[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all entries, in alphabetical order."""
        return tuple(sorted(self._places))

    def load(self, name: str) -> F:
        """Import and return the entry of a name.

        Raises
        ------
        ConfigurationError
            If there is none, what it needs is not installed, or a package registered something
            else by that name.
        """
        if name not in self._places:
            raise self._error_at_key(
                f"there is no {self.kind} {name!r}; did you mean: "
                f"{errors.nearest_word(name, self.names)}? Known: {', '.join(self.names)}"
            )
        place = self._places[name]
        registered = f"the {self.kind} {name!r} is registered as {place}, which"
        try:
            with self.explain_missing_package(name):
                loaded: F = EntryPoint(name, place, f"tjscan.{self.kind}").load()
        except AttributeError as error:
            raise self._error_at_key(f"{registered} can't be loaded: {error}") from error
        if not isinstance(loaded, self.type):
            raise self._error_at_key(f"{registered} is no {self.type.__name__}")
        return loaded

    def _error_at_key(self, message: str) -> errors.ConfigurationError:
        return errors.ConfigurationError(message, key=self.key)

    def explain_missing_package(self, name: str) -> AbstractContextManager[None]:
        """Name what to install if the block can't import a package that an entry needs."""
        return errors.explain_missing_package(
            f"the {self.kind} {name!r}", self.extras.get(name), self.key
        )

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
        factory: Any = self.load(name)
        if (client := self.clients.get(name)) is not None and find_spec(client) is None:
            what, extra = f"the {self.kind} {name!r}", self.extras.get(name)
            raise errors.missing_package_error(what, client, extra, self.key)
        with self.explain_missing_package(name):
            return factory.make(inputs, settings)
