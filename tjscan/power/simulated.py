"""A power source that follows the laws of an arc, and fails when it is told to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from tjscan.core.sourced import NumberSource, SourcedNumber
from tjscan.core.units import (
    AMPERE_UNIT,
    LITRE_PER_MINUTE,
    MM,
    PERCENT_UNIT,
    SECONDS,
    SettingsTable,
)
from tjscan.power.laws import ArcLaw
from tjscan.power.source import LocalPowerSource, PowerSample, PowerSetting


class PowerFaultOrder(StrEnum):
    """Fault that a simulated power source can be given, or its remedy."""

    NO_IGNITION = "no-ignition"
    """No current flows when it is told to start."""
    ARC_LOST = "arc-lost"
    """The current ends by itself."""
    WIRE_STUCK = "wire-stuck"
    """The wire sticks to the work when the arc ends."""
    NO_GAS = "no-gas"
    """No gas flows."""
    ERROR = "error"
    """The source reports an error, and ends the current."""
    CLEAR = "clear"
    """All is right again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerSimulationSettings(SettingsTable):
    """The table [power.simulated]: how the simulated power source behaves.

    Parameters
    ----------
    law : ArcLaw
    stick_out : float
        From the contact tip to the arc, where nothing else states it, metres.
    ignition : float
        From the start to the first current, seconds.
    stabilisation : float
        From the first current until the arc is stable, seconds.
    current_noise : float
        Standard deviation of the measured current, A.
    feed_error : float
        Share by which the wire is fed faster than it is set; negative slower.
    gas_flow : float
        Shielding gas, m³/s.
    """

    law: ArcLaw = field(default_factory=ArcLaw)
    stick_out: Annotated[float, Gt(0), MM] = 0.015
    ignition: Annotated[float, Ge(0), SECONDS] = 0.16
    stabilisation: Annotated[float, Ge(0), SECONDS] = 0.05
    current_noise: Annotated[float, Ge(0), AMPERE_UNIT] = 2.0
    feed_error: Annotated[float, Ge(-50), PERCENT_UNIT] = 0.0
    gas_flow: Annotated[float, Ge(0), LITRE_PER_MINUTE] = 18.0 * 1e-3 / 60


class SimulatedPowerSource(LocalPowerSource):
    """A simulated power source; see `PowerSource`.

    Parameters
    ----------
    settings : PowerSimulationSettings
    clock : callable
        Gives the seconds of the simulated world.
    raised : callable, optional
        Gives by how much the torch truly is higher at this moment than the settings' stick-out has
        it, metres; not at all if left out.
    seed : int, optional
        Of the noise.
    """

    def __init__(
        self,
        settings: PowerSimulationSettings,
        clock: Callable[[], float],
        raised: Callable[[], float] = float,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self._settings, self._clock = settings, clock
        self._raised = raised
        self._rng = np.random.default_rng(seed)
        self._faults: set[PowerFaultOrder] = set()
        self._flow_from, self._energy, self._last = inf, 0.0, clock()
        self._wire_stuck = False

    def order_fault(self, fault: PowerFaultOrder) -> None:
        """Let something fail from now on, or set all right again."""
        if fault is PowerFaultOrder.CLEAR:
            self._faults.clear()
            self._wire_stuck = False
        else:
            self._faults.add(fault)
            if fault in (PowerFaultOrder.ARC_LOST, PowerFaultOrder.ERROR):
                self._flow_from = inf

    def prepare(self, setting: PowerSetting) -> None:
        """See `PowerSource.prepare`."""
        super().prepare(setting)
        self._energy = 0.0

    def strike(self) -> None:
        """See `PowerSource.strike`."""
        super().strike()
        blocking = {PowerFaultOrder.NO_IGNITION, PowerFaultOrder.ERROR, PowerFaultOrder.ARC_LOST}
        if not blocking & self._faults:
            self._flow_from = self._clock() + self._settings.ignition

    def quench(self) -> None:
        """See `PowerSource.quench`."""
        if self._flows and PowerFaultOrder.WIRE_STUCK in self._faults:
            self._wire_stuck = True
        super().quench()
        self._flow_from = inf

    def state(self) -> PowerSample:
        """See `PowerSource.state`."""
        self.check_connected()
        now, flows = self._clock(), self._flows
        period, self._last = now - self._last, now
        current = voltage = 0.0
        if flows:
            stick_out = self._settings.stick_out + self._raised()
            current = self._settings.law.current(self._fed, stick_out)
            current = max(0.0, current + self._settings.current_noise * self._rng.normal())
            voltage = self._settings.law.voltage(current) + self._setting.correction
            self._energy += current * voltage * period
        gas = self._gas and PowerFaultOrder.NO_GAS not in self._faults
        failed = PowerFaultOrder.ERROR in self._faults
        return PowerSample(
            time=now,
            flow=flows,
            source=NumberSource.SIMULATED,
            ready=not failed,
            stable=flows and now >= self._flow_from + self._settings.stabilisation,
            wire_stuck=self._wire_stuck,
            current=_simulated(current),
            voltage=_simulated(voltage),
            feed=_simulated(self._fed if flows else 0.0),
            gas=_simulated(self._settings.gas_flow if gas else 0.0),
            energy=_simulated(self._energy),
            error="the source was told to fail" if failed else "",
        )

    @property
    def _flows(self) -> bool:
        return self._burning and self._clock() >= self._flow_from

    @property
    def _fed(self) -> float:
        return self._setting.feed * (1 + self._settings.feed_error)


def _simulated(value: float) -> SourcedNumber:
    return SourcedNumber(value, NumberSource.SIMULATED)
