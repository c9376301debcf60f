"""The order of events of an arc, and the guards over it: a state machine, cycle by cycle.

Motion starts once per strike. Whatever goes wrong, the arc goes out first and is then named.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Final, NoReturn

from annotated_types import Ge, Gt, Le

from tjscan.core.errors import PowerFault, PowerLinkLost, WeldStopped
from tjscan.core.units import LITRE_PER_MINUTE, MM_S, PERCENT_UNIT, SECONDS, SettingsTable
from tjscan.power.source import PowerSample, PowerSetting, PowerSource

Seconds = Annotated[float, Ge(0), Le(60), SECONDS]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcLimits(SettingsTable):
    """The table of the time limits of an arc.

    Parameters
    ----------
    standing_speed : float
        Below which the torch counts as standing, m/s.
    preflow, postflow : float
        Of the gas before and after the arc, seconds.
    least_gas : float
        Below which gas counts as missing, m³/s.
    ignition : float
        In which current must flow, seconds.
    stabilisation : float
        In which the source must then let the robot move, seconds.
    motion : float
        In which the torch must then move, seconds.
    stall : float
        For which the torch may be too slow, seconds.
    stall_share : float
        Share of the speed asked for, below which it is too slow.
    crater : float
        For which the crater is filled, seconds.
    extinction : float
        In which no current must flow any more, seconds.
    """

    standing_speed: Annotated[float, Gt(0), Le(10), MM_S] = 0.5e-3
    preflow: Seconds = 0.5
    postflow: Seconds = 1.0
    least_gas: Annotated[float, Ge(0), LITRE_PER_MINUTE] = 5.0 * 1e-3 / 60
    ignition: Seconds = 1.2
    stabilisation: Seconds = 0.5
    motion: Seconds = 0.3
    stall: Seconds = 0.09
    stall_share: Annotated[float, Gt(0), Le(90), PERCENT_UNIT] = 0.4
    crater: Seconds = 0.5
    extinction: Seconds = 0.3


class ArcPhase(StrEnum):
    """Where an arc is in the order of events."""

    IDLE = "idle"
    GAS = "gas flows"
    IGNITION = "ignition"
    ESTABLISHED = "current flows"
    RELEASED = "motion released"
    WELDING = "welding"
    CRATER = "crater"
    EXTINCTION = "extinction"
    AFTER_GAS = "gas flows on"
    DONE = "done"
    FAILED = "failed"


class ArcFault(StrEnum):
    """What stops an arc."""

    NOT_AT_REST = "torch not at rest"
    NOT_READY = "source not ready"
    UNASKED = "current unasked"
    NO_GAS = "no gas"
    NO_IGNITION = "no ignition"
    NOT_STABLE = "arc not stable"
    NOT_MOVING = "torch not moving"
    STALLED = "torch stalled"
    ARC_LOST = "arc lost"
    WIRE_STUCK = "wire stuck"
    FLOWS_ON = "current flows on"
    LINK_LOST = "link lost"
    SOURCE = "power source"
    STOPPED = "stopped"


BURNING_PHASES: Final = (
    ArcPhase.ESTABLISHED,
    ArcPhase.RELEASED,
    ArcPhase.WELDING,
    ArcPhase.CRATER,
)
"""Phases in which current must flow."""

PHASES_AFTER_THE_ARC: Final = (
    ArcPhase.EXTINCTION,
    ArcPhase.AFTER_GAS,
    ArcPhase.DONE,
    ArcPhase.FAILED,
)
"""Phases in which it must not, or not for long."""


class ArcSequence:
    """One arc, from the gas before it to the gas after it; `advance` is called every cycle.

    Parameters
    ----------
    source : PowerSource
        Connected.
    limits : ArcLimits
    report : callable
        Receives each phase and what led to it, a sentence.

    Attributes
    ----------
    phase : ArcPhase
        Where it is.
    sample : PowerSample or None
        The last that came.
    fault : ArcFault or None
        What stopped it.
    """

    def __init__(
        self, source: PowerSource, limits: ArcLimits, report: Callable[[str, str], None]
    ) -> None:
        self._source, self._limits, self._report = source, limits, report
        self.phase, self.sample = ArcPhase.IDLE, None
        self.fault: ArcFault | None = None
        self._setting, self._since, self._moved = PowerSetting(0.0), 0.0, 0.0
        self._stuck_or_flowing = False

    sample: PowerSample | None
    _no_gas: float | None = None

    @property
    def may_move(self) -> bool:
        """Whether the torch may move along the bead at this moment."""
        return self.phase in (ArcPhase.RELEASED, ArcPhase.WELDING)

    @property
    def may_retract(self) -> bool:
        """Whether the torch may be drawn back: no current flows, and the wire is free."""
        ended = self.phase in (ArcPhase.IDLE, ArcPhase.AFTER_GAS, ArcPhase.DONE, ArcPhase.FAILED)
        return ended and not self._stuck_or_flowing

    def begin(self, setting: PowerSetting, speed: float) -> None:
        """Set the source with the torch at rest above the bead's start, and let gas flow.

        Parameters
        ----------
        setting : PowerSetting
        speed : float
            Of the torch as measured, m/s.

        Raises
        ------
        WeldStopped
            If the torch moves, or the source is not ready or does not take the setting.
        """
        if self.phase is not ArcPhase.IDLE:
            raise ValueError(f"this arc has begun: it is in phase {self.phase}")
        sample = self._read_source()
        self._refuse_motion(speed)
        if sample.flow:
            self._fail(ArcFault.UNASKED, "current flows before the arc was struck")
        if not sample.ready:
            self._fail(ArcFault.NOT_READY, sample.error or "the source is not ready")
        self._setting = setting
        self._order(self._source.prepare, setting)
        self._enter(ArcPhase.GAS, f"wire feed set to {60 * setting.feed:.2f} m/min")

    def set(self, setting: PowerSetting) -> None:
        """Set the source again while the arc burns, for the segment that the torch has reached."""
        if setting != self._setting:
            self._setting = setting
            self._order(self._source.set, setting)

    def stop(self, reason: str) -> None:
        """Put the arc out at once; raises WeldStopped."""
        self._fail(ArcFault.STOPPED, reason)

    def advance(self, speed: float, asked: float, *, at_end: bool = False) -> None:
        """Go on by one cycle.

        Parameters
        ----------
        speed : float
            Of the torch along the bead as measured, m/s.
        asked : float
            That it is asked for, m/s.
        at_end : bool, optional
            Whether the torch is at the bead's end.

        Raises
        ------
        WeldStopped
            If a guard puts the arc out, or did.
        """
        sample = self._read_source()
        if self.phase is ArcPhase.FAILED:
            return
        waited = sample.time - self._since
        if self.phase is ArcPhase.IGNITION:
            self._watch_gas(sample, grace=0.0)
        match self.phase:
            case ArcPhase.GAS:
                self._wait_for_gas(sample, waited, speed)
            case ArcPhase.IGNITION if sample.flow:
                self._enter(ArcPhase.ESTABLISHED, f"current flows after {1e3 * waited:.0f} ms")
            case ArcPhase.IGNITION if waited > self._limits.ignition:
                self._fail(ArcFault.NO_IGNITION, f"no current flows after {waited:.2f} s")
            case ArcPhase.EXTINCTION if not sample.flow:
                self._enter(ArcPhase.AFTER_GAS, f"no current after {1e3 * waited:.0f} ms")
                self._stuck_or_flowing = sample.wire_stuck is True
            case ArcPhase.EXTINCTION if waited > self._limits.extinction:
                self._fail(ArcFault.FLOWS_ON, f"current flows {waited:.2f} s after the end")
            case ArcPhase.AFTER_GAS:
                self._finish(sample, waited)
        if self.phase in BURNING_PHASES:
            self._burn(sample, speed, asked, at_end)

    def _wait_for_gas(self, sample: PowerSample, waited: float, speed: float) -> None:
        if sample.flow:
            self._fail(ArcFault.UNASKED, "current flows before the arc was struck")
        flowed = waited >= self._limits.preflow
        self._watch_gas(sample, grace=0.0 if flowed else self._limits.preflow)
        if flowed:
            self._strike(speed)

    def _finish(self, sample: PowerSample, waited: float) -> None:
        if sample.flow:
            self._fail(ArcFault.FLOWS_ON, "current flows again after the end")
        if sample.wire_stuck:
            self._fail(ArcFault.WIRE_STUCK, "the wire sticks to the work; free it by hand")
        if waited >= self._limits.postflow:
            self._source.end_gas()
            self._enter(ArcPhase.DONE, "the wire is free")

    def _order(self, order: Callable[..., None], *setting: PowerSetting) -> None:
        """Order something of the source; what it refuses puts the arc out."""
        try:
            order(*setting)
        except PowerFault as error:
            self._fail(_fault_of(error), str(error))

    def _refuse_motion(self, speed: float) -> None:
        if abs(speed) > self._limits.standing_speed:
            self._fail(ArcFault.NOT_AT_REST, f"the torch moves with {1e3 * speed:.1f} mm/s")

    def _strike(self, speed: float) -> None:
        self._refuse_motion(speed)
        self._order(self._source.strike)
        self._enter(ArcPhase.IGNITION, "the arc is struck")

    def _burn(self, sample: PowerSample, speed: float, asked: float, at_end: bool) -> None:
        """Guard a burning arc, and go on to what follows."""
        limits, waited = self._limits, sample.time - self._since
        if not sample.flow:
            self._fail(ArcFault.ARC_LOST, "the current ended by itself")
        self._watch_gas(sample, grace=limits.preflow)
        match self.phase:
            case ArcPhase.ESTABLISHED if sample.stable:
                self._enter(ArcPhase.RELEASED, "the source lets the torch move")
            case ArcPhase.ESTABLISHED if waited > limits.stabilisation:
                self._fail(ArcFault.NOT_STABLE, f"the arc is not stable after {waited:.2f} s")
            case ArcPhase.RELEASED if speed > limits.standing_speed:
                self._enter(ArcPhase.WELDING, f"the torch moves after {1e3 * waited:.0f} ms")
                self._moved = sample.time
            case ArcPhase.RELEASED if waited > limits.motion:
                self._fail(ArcFault.NOT_MOVING, f"the torch stands still for {waited:.2f} s")
            case ArcPhase.WELDING if at_end:
                self._enter(ArcPhase.CRATER, "the torch is at the end")
            case ArcPhase.WELDING:
                self._watch_motion(sample.time, speed, asked)
            case ArcPhase.CRATER if waited >= limits.crater:
                self._source.quench()
                self._enter(ArcPhase.EXTINCTION, "the crater is filled")

    def _watch_motion(self, now: float, speed: float, asked: float) -> None:
        if speed >= self._limits.stall_share * asked:
            self._moved = now
        elif now - self._moved >= self._limits.stall:
            slow = f"the torch moves with {1e3 * speed:.2f} mm/s where {1e3 * asked:.2f} were asked"
            self._fail(ArcFault.STALLED, slow)

    def _watch_gas(self, sample: PowerSample, grace: float) -> None:
        if sample.gas.value is None or sample.gas.value >= self._limits.least_gas:
            self._no_gas = None
            return
        self._no_gas = sample.time if self._no_gas is None else self._no_gas
        if sample.time - self._no_gas >= grace:
            found = sample.gas.value / LITRE_PER_MINUTE.factor
            self._fail(ArcFault.NO_GAS, f"{found:.1f} l/min of gas flow")

    def _read_source(self) -> PowerSample:
        """Exchange state with the source, and look whether it is well."""
        failed = self.phase is ArcPhase.FAILED
        try:
            self.sample = sample = self._source.state()
        except PowerFault as error:
            if failed:
                self._stuck_or_flowing = True  # nothing shows that it is off
                raise
            self._fail(_fault_of(error), str(error))
        if failed:
            self._stuck_or_flowing = sample.flow or sample.wire_stuck is True
            if sample.flow:
                self._source.quench()
        elif sample.error:
            self._fail(ArcFault.SOURCE, f"the power source reports: {sample.error}")
        elif sample.wire_stuck and self.phase not in PHASES_AFTER_THE_ARC:
            self._fail(ArcFault.WIRE_STUCK, "the wire sticks to the work; free it by hand")
        return sample

    def _enter(self, phase: ArcPhase, detail: str) -> None:
        self.phase = phase
        self._since = 0.0 if self.sample is None else self.sample.time
        self._report(str(phase), detail)

    def _fail(self, fault: ArcFault, reason: str) -> NoReturn:
        """Put the arc out, and name why."""
        self._source.quench()
        before, self.fault = self.phase, fault
        self._stuck_or_flowing = before is not ArcPhase.IDLE
        self._enter(ArcPhase.FAILED, f"{fault}: {reason}")
        raise WeldStopped(fault, f"{reason} (in the phase: {before})")


def _fault_of(error: PowerFault) -> ArcFault:
    return ArcFault.LINK_LOST if isinstance(error, PowerLinkLost) else ArcFault.SOURCE
