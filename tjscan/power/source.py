"""The protocol that every power source, real or simulated, fulfils."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import Final, Protocol

from tjscan.core.devices import Device, LocalDevice
from tjscan.core.errors import PowerFault, PowerLinkLost
from tjscan.core.sourced import ABSENT_NUMBER, NumberSource, SourcedNumber

FEED_STEP: Final = 0.05 / 60
"""By which the wire feed must change for a source to be set again, m/s."""


@dataclass(frozen=True, slots=True)
class PowerSetting:
    """What a power source is set to.

    Parameters
    ----------
    feed : float
        Of the wire, m/s.
    correction : float, optional
        Of the voltage, V.
    job : int or None, optional
        Number of a job that the source keeps; left as it is if None.
    """

    feed: float
    correction: float = 0.0
    job: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerSample:
    """What a power source reports at a moment.

    Parameters
    ----------
    time : float
        Seconds on its clock.
    flow : bool
        Whether current flows.
    source : NumberSource
        Where `flow` comes from: a person who strikes the arc is believed.
    ready : bool
        Whether it takes a start.
    stable : bool
        Whether it lets the robot move.
    wire_stuck : bool or None
        Whether the wire sticks to the work; None if it can't show that.
    current, voltage, feed, gas, energy : SourcedNumber
        A, V, m/s, m³/s and J since the arc was struck.
    error : str
        Its error, in words; empty if it is well.
    """

    time: float
    flow: bool
    source: NumberSource
    ready: bool = True
    stable: bool = False
    wire_stuck: bool | None = None
    current: SourcedNumber = ABSENT_NUMBER
    voltage: SourcedNumber = ABSENT_NUMBER
    feed: SourcedNumber = ABSENT_NUMBER
    gas: SourcedNumber = ABSENT_NUMBER
    energy: SourcedNumber = ABSENT_NUMBER
    error: str = ""


class PowerSource(Device, Protocol):
    """A power source with its wire feeder; no current flows when it connects or disconnects."""

    def prepare(self, setting: PowerSetting) -> None:
        """Set it before an arc, and let the gas flow.

        Raises
        ------
        PowerFault
            If it does not take the setting.
        """

    def strike(self) -> None:
        """Strike the arc; returns at once."""

    def set(self, setting: PowerSetting) -> None:
        """Set it while the arc burns; returns at once."""

    def state(self) -> PowerSample:
        """Exchange orders and state with it; to be called again and again while an arc burns.

        A simulated source goes by its own clock.

        Raises
        ------
        PowerLinkLost
            If it does not answer, or answers the same again and again.
        PowerFault
            If what it reports lies out of the ranges that are stated for it.
        """

    def quench(self) -> None:
        """End the arc; never raises, may be repeated, and waits for nothing but one answer."""

    def end_gas(self) -> None:
        """End the gas, once it has flowed over the crater for long enough."""

    def reset(self) -> None:
        """Take back an error of the source once its cause is gone."""


class LocalPowerSource(LocalDevice):
    """Base of power sources without a link: holds the setting."""

    not_connected = (PowerLinkLost, "the power source is not connected: use it in a 'with' block")

    def __init__(self) -> None:
        self._setting, self._burning, self._gas = PowerSetting(0.0), False, False

    def __exit__(self, *error: object) -> None:
        self.quench()
        self.end_gas()
        super().__exit__(*error)

    def prepare(self, setting: PowerSetting) -> None:
        """See `PowerSource.prepare`."""
        self.check_connected()
        self._setting, self._gas = setting, True

    def set(self, setting: PowerSetting) -> None:
        """See `PowerSource.set`."""
        self.check_connected()
        self._setting = setting

    def strike(self) -> None:
        """See `PowerSource.strike`."""
        self.check_connected()
        self._burning = True

    def quench(self) -> None:
        """See `PowerSource.quench`."""
        self._burning = False

    def end_gas(self) -> None:
        """See `PowerSource.end_gas`."""
        self._gas = False

    def reset(self) -> None:
        """See `PowerSource.reset`."""


class ManualPowerSource(LocalPowerSource):
    """No power source that the program reaches: a person strikes the arc and ends it.

    Nothing is measured. What the person confirms is believed.

    Parameters
    ----------
    ask : callable
        Asks a person to do something, and returns whether it is done.
    clock : callable, optional
        Gives seconds.
    """

    def __init__(self, ask: Callable[[str], bool], clock: Callable[[], float] = monotonic) -> None:
        super().__init__()
        self._ask, self._clock = ask, clock

    def strike(self) -> None:
        """Ask for the arc.

        Raises
        ------
        PowerFault
            If the person does not strike it.
        """
        self.check_connected()
        if not self._is_done("strike the arc"):
            raise PowerFault("the arc was not struck by hand")
        self._burning = True

    def quench(self) -> None:
        """Ask for its end; until the person confirms that, it counts as burning."""
        if self._burning:
            self._burning = not self._is_done("end the arc")

    def state(self) -> PowerSample:
        """What was asked for; see `PowerSource.state`."""
        self.check_connected()
        burning = self._burning
        return PowerSample(
            time=self._clock(), flow=burning, stable=burning, source=NumberSource.BELIEVED
        )

    def _is_done(self, what: str) -> bool:
        try:
            return self._ask(what)
        except KeyboardInterrupt:
            return False
