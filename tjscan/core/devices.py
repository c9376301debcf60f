"""What all devices share: who they are, what they report, and how a driver registers them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property, wraps
from importlib.metadata import entry_points
from importlib.util import find_spec
from inspect import getattr_static, isfunction
from ipaddress import ip_address
from typing import Any, ClassVar, Final, Generic, Protocol, Self, TypeVar, cast

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
    """Base of drivers: a device of unknown identity, which reports its events to one listener."""

    _listener: EventListener = staticmethod(lambda name, sentence: None)

    @property
    def identity(self) -> DeviceIdentity:
        """Which device it is; known while connected."""
        return DeviceIdentity()

    def report_events_to(self, listener: EventListener) -> None:
        """Report the device's events to a listener from now on, in the thread that calls it."""
        self._listener = listener


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

    A driver is a module with one of these, registered by name in the table of its kind: an
    `ArmDriverFactory` in `ARM_DRIVERS`, a `LaserDriverFactory` in `LASER_DRIVERS`. A package of its
    own registers it by an entry point of the group that is named after the kind; see
    docs/own-devices.md. Then a job may have ``laser.driver = "acme"``, and its table
    ``[laser.acme]`` is checked against `table`. Import what is heavy inside `make`: tables are
    checked without it.

    Parameters
    ----------
    make : callable
        Makes the device, not yet connected, from its inputs (`ArmDriverInputs`,
        `LaserDriverInputs`) and the settings, an instance of `table`.
    table : type of SettingsTable, optional
        Its own table in the job file.
    kind : DriverKind, optional
        A device, a simulation or a recording.
    extra : str, optional
        What to install if it needs more than a plain install.
    client : str, optional
        Module of its client library, if that is imported in a process of its own alone.
    """

    make: Callable[[C, Any], D]
    table: type[SettingsTable] = NoSettings
    kind: DriverKind = DriverKind.REAL
    extra: str | None = None
    client: str | None = None


F = TypeVar("F", bound=DriverFactory[Any, Any])


@dataclass(frozen=True)
class DriverRegistry(Generic[F]):
    """Every driver of a kind of device by name; another package's is imported when it is loaded.

    Another package adds to it by an entry point in the group ``tjscan.<device>``; see
    `DriverFactory`.

    Parameters
    ----------
    device : str
        What its drivers drive, in one word for messages, for instance ``arm``.
    own : mapping of str to DriverFactory
        The drivers of this package.
    key : str
        Where a job file names a driver, for messages, for instance ``arm.driver``.
    type : type, optional
        What every entry is an instance of.
    """

    device: str
    own: Mapping[str, F]
    key: str
    type: type[Any] = DriverFactory

    @cached_property
    def _entries(self) -> dict[str, Any]:  # drivers, and entry points of any importlib's
        added = entry_points(group=f"tjscan.{self.device}")
        return {**{point.name: point for point in added}, **self.own}

    @property
    def table_key(self) -> str:
        """Table of a job file that names an entry."""
        return self.key.partition(".")[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all drivers, in alphabetical order."""
        return tuple(sorted(self._entries))

    def load(self, name: str) -> F:
        """Return the driver of a name, imported if it is another package's.

        Raises
        ------
        ConfigurationError
            If there is none, what it needs is not installed, or a package registered something
            else by that name.
        """
        entry = self._entries.get(name)
        if entry is None:
            raise self._error_at_key(
                f"there is no {self.device} {name!r}; did you mean: "
                f"{errors.nearest_word(name, self.names)}? Known: {', '.join(self.names)}"
            )
        if isinstance(entry, self.type):
            return cast("F", entry)
        registered = f"the {self.device} {name!r} is registered as {entry.value}, which"
        try:
            with errors.explain_missing_package(f"the {self.device} {name!r}", None, self.key):
                loaded: F = entry.load()
        except AttributeError as error:
            raise self._error_at_key(f"{registered} can't be loaded: {error}") from error
        if not isinstance(loaded, self.type):
            raise self._error_at_key(f"{registered} is no {self.type.__name__}")
        return loaded

    def _error_at_key(self, message: str) -> errors.ConfigurationError:
        return errors.ConfigurationError(message, key=self.key)

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
        factory, what = self.load(name), f"the {self.device} {name!r}"
        if factory.client is not None and find_spec(factory.client) is None:
            raise errors.missing_package_error(what, factory.client, factory.extra, self.key)
        with errors.explain_missing_package(what, factory.extra, self.key):
            device = factory.make(inputs, settings)
        if name in self.own:
            return device
        return guard_device(device, what, FAULT_OF_DEVICE.get(self.device, errors.VehicleFault))


FAULT_OF_DEVICE: Final[dict[str, type[errors.TjscanError]]] = {
    "arm": errors.ArmFault,
    "laser": errors.LaserFault,
    "power_source": errors.PowerFault,
    "carrier": errors.CarrierFault,
}
"""Of what a device of another package fails with; of all others it is a fault of the vehicle."""


def guard_device(device: D, what: str, fault: type[errors.TjscanError]) -> D:
    """Let what a driver of another package raises end a run as a fault of its device.

    Its methods and properties raise the fault instead of OSError, and of a library that is missing,
    with the driver's name; so a run ends as with any fault, and its results are written.

    Parameters
    ----------
    device : object
        The device, which is changed.
    what : str
        What messages call it.
    fault : type
        The fault of such a device.
    """

    def guarded(method: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(method)
        def call(*arguments: Any, **options: Any) -> Any:
            try:
                return method(*arguments, **options)
            except ImportError as error:
                raise fault(f"{what} needs a library that is not installed: {error}") from error
            except OSError as error:
                raise fault(f"{what} failed: {error or type(error).__name__}") from error

        return call

    kind, own = type(device), dict[str, Any]()
    for name in dir(kind):
        found = getattr_static(kind, name)
        if name.startswith("_") and name not in ("__enter__", "__exit__"):
            continue
        if isfunction(found):
            own[name] = guarded(found)
        elif isinstance(found, property) and found.fget is not None:
            own[name] = found.getter(guarded(found.fget))
    if not own:
        return device
    # Of the object itself: a frozen dataclass refuses any other way.
    object.__setattr__(device, "__class__", type(kind.__name__, (kind,), {"__slots__": (), **own}))
    return device


def is_loopback_host(name: str) -> bool:
    """Whether a name or an address is of this machine alone."""
    try:
        return name == "localhost" or ip_address(name).is_loopback
    except ValueError:
        return False
