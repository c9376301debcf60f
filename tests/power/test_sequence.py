"""An arc goes out before anything is named, and motion starts once per strike."""

from collections.abc import Callable
from typing import Final

import pytest

from tjscan.core.errors import PowerFault, PowerLinkLost, WeldStopped
from tjscan.core.sourced import NumberSource
from tjscan.power.sequence import ArcFault, ArcLimits, ArcPhase, ArcSequence
from tjscan.power.simulated import (
    PowerFaultOrder,
    PowerSimulationSettings,
    SimulatedPowerSource,
)
from tjscan.power.source import ManualPowerSource, PowerSample, PowerSetting

PERIOD: Final = 0.01
SPEED: Final = 5e-3
SETTING: Final = PowerSetting(9 / 60)


class Bench:
    """A power source and a torch that goes at once as it may, with a clock of their own."""

    def __init__(self) -> None:
        self.now, self.speed, self.way, self.quenched = 0.0, 0.0, 0.0, 0
        self.stands = False
        self.source = SimulatedPowerSource(PowerSimulationSettings(), lambda: self.now)
        self.source.__enter__()
        self.events: list[tuple[str, str]] = []
        self.arc = ArcSequence(
            self.source, ArcLimits(), lambda name, detail: self.events.append((name, detail))
        )

    def cycle(self, *, at_end: bool = False) -> None:
        self.now += PERIOD
        self.arc.advance(self.speed, SPEED, at_end=at_end)
        self.speed = SPEED if self.arc.may_move and not self.stands else 0.0
        self.way += self.speed * PERIOD

    def run_to(self, phase: ArcPhase) -> None:
        if self.arc.phase is ArcPhase.IDLE and phase is not ArcPhase.IDLE:
            self.arc.begin(SETTING, self.speed)
        at_end = phase in (ArcPhase.CRATER, ArcPhase.EXTINCTION, ArcPhase.AFTER_GAS, ArcPhase.DONE)
        for _ in range(1000):
            if self.arc.phase is phase:
                return
            self.cycle(at_end=at_end)
        raise AssertionError(f"never {phase}")

    def stand(self) -> None:
        self.stands, self.speed = True, 0.0

    @property
    def flows(self) -> bool:
        return self.source.state().flow

    def until_stopped(self, **keys: bool) -> WeldStopped:
        try:
            for _ in range(1000):
                self.cycle(**keys)
        except WeldStopped as error:
            return error
        raise AssertionError("nothing stopped it")


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_phases_of_a_sound_arc_come_in_their_order(bench: Bench) -> None:
    bench.run_to(ArcPhase.DONE)
    names = [name for name, _ in bench.events]
    assert names == [
        "gas flows",
        "ignition",
        "current flows",
        "motion released",
        "welding",
        "crater",
        "extinction",
        "gas flows on",
        "done",
    ]
    assert bench.arc.may_retract
    assert not bench.flows


def test_torch_moves_only_between_release_and_crater(bench: Bench) -> None:
    for phase in ArcPhase:
        if phase is ArcPhase.FAILED:
            continue
        bench.run_to(phase)
        assert bench.arc.may_move == (phase in (ArcPhase.RELEASED, ArcPhase.WELDING))


FAULTS: Final[dict[str, tuple[Callable[[Bench], None], dict[ArcPhase, ArcFault]]]] = {
    "no ignition": (
        lambda bench: bench.source.order_fault(PowerFaultOrder.NO_IGNITION),
        {ArcPhase.GAS: ArcFault.NO_IGNITION},
    ),
    "arc lost": (
        lambda bench: bench.source.order_fault(PowerFaultOrder.ARC_LOST),
        {
            ArcPhase.GAS: ArcFault.NO_IGNITION,
            ArcPhase.IGNITION: ArcFault.NO_IGNITION,
            ArcPhase.ESTABLISHED: ArcFault.ARC_LOST,
            ArcPhase.RELEASED: ArcFault.ARC_LOST,
            ArcPhase.WELDING: ArcFault.ARC_LOST,
            ArcPhase.CRATER: ArcFault.ARC_LOST,
        },
    ),
    "no gas": (
        lambda bench: bench.source.order_fault(PowerFaultOrder.NO_GAS),
        dict.fromkeys((ArcPhase.GAS, ArcPhase.RELEASED, ArcPhase.WELDING), ArcFault.NO_GAS),
    ),
    "wire stuck": (
        lambda bench: bench.source.order_fault(PowerFaultOrder.WIRE_STUCK),
        {ArcPhase.WELDING: ArcFault.WIRE_STUCK, ArcPhase.CRATER: ArcFault.WIRE_STUCK},
    ),
    "error": (
        lambda bench: bench.source.order_fault(PowerFaultOrder.ERROR),
        dict.fromkeys(
            (phase for phase in ArcPhase if phase not in (ArcPhase.IDLE, ArcPhase.FAILED, "done")),
            ArcFault.SOURCE,
        ),
    ),
    "torch stands": (
        Bench.stand,
        {
            ArcPhase.GAS: ArcFault.NOT_MOVING,
            ArcPhase.RELEASED: ArcFault.NOT_MOVING,
            ArcPhase.WELDING: ArcFault.STALLED,
        },
    ),
}


@pytest.mark.parametrize(
    ("name", "phase"), [(name, phase) for name, (_, when) in FAULTS.items() for phase in when]
)
def test_fault_at_a_phase_is_named_with_the_arc_off(
    bench: Bench, name: str, phase: ArcPhase
) -> None:
    order, expected = FAULTS[name]
    bench.run_to(phase)
    order(bench)
    error = bench.until_stopped(at_end=name == "wire stuck")
    assert error.fault is expected[phase]
    assert bench.arc.phase is ArcPhase.FAILED
    assert not bench.flows
    assert not bench.arc.may_move


@pytest.mark.parametrize(
    "phase", [p for p in ArcPhase if p not in (ArcPhase.IDLE, ArcPhase.FAILED)]
)
def test_stop_and_lost_link_at_every_phase_put_the_arc_out(bench: Bench, phase: ArcPhase) -> None:
    bench.run_to(phase)
    with pytest.raises(WeldStopped, match="by the operator") as caught:
        bench.arc.stop("by the operator")
    assert caught.value.fault is ArcFault.STOPPED
    assert not bench.flows


@pytest.mark.parametrize(
    "phase", [p for p in ArcPhase if p not in (ArcPhase.IDLE, ArcPhase.FAILED)]
)
def test_lost_link_at_every_phase_is_named(
    bench: Bench, phase: ArcPhase, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.run_to(phase)

    def lost() -> PowerSample:
        raise PowerLinkLost("no answer")

    with monkeypatch.context() as patched:
        patched.setattr(bench.source, "state", lost)
        error = bench.until_stopped()
        assert error.fault is ArcFault.LINK_LOST
        assert not bench.arc.may_retract
    assert not bench.flows


def test_motion_starts_once_per_strike(bench: Bench) -> None:
    """A torch that stalls is not let go again by the release that still holds."""
    bench.run_to(ArcPhase.WELDING)
    bench.stand()
    error = bench.until_stopped()
    assert error.fault is ArcFault.STALLED
    bench.stands, way = False, bench.way
    for _ in range(100):
        bench.cycle()
    assert bench.way == way
    assert bench.arc.phase is ArcPhase.FAILED
    with pytest.raises(ValueError, match="has begun"):
        bench.arc.begin(SETTING, 0.0)


def test_stall_puts_the_arc_out_in_its_time(bench: Bench) -> None:
    bench.run_to(ArcPhase.WELDING)
    for _ in range(50):
        bench.cycle()
    bench.stand()
    stood = bench.now
    bench.until_stopped()
    assert bench.now - stood <= ArcLimits().stall + 2 * PERIOD + 1e-9


def test_stuck_wire_is_not_drawn_off_until_it_is_free(bench: Bench) -> None:
    bench.run_to(ArcPhase.WELDING)
    bench.source.order_fault(PowerFaultOrder.WIRE_STUCK)
    bench.until_stopped(at_end=True)
    bench.cycle()
    assert not bench.arc.may_retract
    bench.source.order_fault(PowerFaultOrder.CLEAR)
    bench.cycle()
    assert bench.arc.may_retract


def test_nothing_begins_with_a_moving_torch_or_current(bench: Bench) -> None:
    with pytest.raises(WeldStopped) as caught:
        bench.arc.begin(SETTING, 2e-3)
    assert caught.value.fault is ArcFault.NOT_AT_REST
    bench = Bench()
    bench.source.prepare(SETTING)
    bench.source.strike()
    bench.now += 1.0
    with pytest.raises(WeldStopped) as caught:
        bench.arc.begin(SETTING, 0.0)
    assert caught.value.fault is ArcFault.UNASKED
    assert not bench.flows


def test_no_arc_is_struck_or_waited_for_without_gas(bench: Bench) -> None:
    bench.source.order_fault(PowerFaultOrder.NO_GAS)
    bench.run_to(ArcPhase.GAS)
    assert bench.until_stopped().fault is ArcFault.NO_GAS
    assert "ignition" not in [name for name, _ in bench.events]
    bench = Bench()
    bench.source.order_fault(PowerFaultOrder.NO_IGNITION)
    bench.run_to(ArcPhase.IGNITION)
    bench.source.order_fault(PowerFaultOrder.NO_GAS)
    assert bench.until_stopped().fault is ArcFault.NO_GAS


@pytest.mark.parametrize(
    ("phase", "fault"),
    [(ArcPhase.GAS, ArcFault.UNASKED), (ArcPhase.AFTER_GAS, ArcFault.FLOWS_ON)],
)
def test_unasked_current_is_noticed(bench: Bench, phase: ArcPhase, fault: ArcFault) -> None:
    bench.run_to(phase)
    bench.source.strike()
    assert bench.until_stopped().fault is fault
    assert not bench.flows


def test_setting_that_is_not_taken_puts_the_arc_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.run_to(ArcPhase.WELDING)

    def refuse(setting: PowerSetting) -> None:
        raise PowerFault("feed is 30")

    monkeypatch.setattr(bench.source, "set", refuse)
    with pytest.raises(WeldStopped, match="feed is 30") as caught:
        bench.arc.set(PowerSetting(30 / 60))
    assert caught.value.fault is ArcFault.SOURCE
    assert not bench.flows


def test_what_no_device_gave_is_absent() -> None:
    asked: list[str] = []

    def ask(what: str) -> bool:
        asked.append(what)
        return True

    source = ManualPowerSource(ask, lambda: 0.0)
    with source:
        source.prepare(SETTING)
        source.strike()
        sample = source.state()
    assert asked == ["strike the arc", "end the arc"]
    assert sample.source is NumberSource.BELIEVED
    for number in (sample.current, sample.voltage, sample.feed, sample.gas, sample.energy):
        assert number.value is None
        assert number.source is NumberSource.ABSENT


def test_arc_that_no_one_strikes_is_none() -> None:
    with ManualPowerSource(lambda what: False) as source:
        with pytest.raises(PowerFault, match="not struck by hand"):
            source.strike()
        assert not source.state().flow


def test_arc_by_hand_burns_until_its_end_is_confirmed() -> None:
    answers: list[bool | None] = [True, False, None, True]

    def ask(what: str) -> bool:
        answer = answers.pop(0)
        if answer is None:
            raise KeyboardInterrupt
        return answer

    with ManualPowerSource(ask) as source:
        source.strike()
        for flows in (True, True, False):  # "no", Ctrl-C, "yes"
            source.quench()
            assert source.state().flow is flows
    with ManualPowerSource(lambda what: ask(what)) as source:
        answers.append(None)
        with pytest.raises(PowerFault, match="not struck by hand"):
            source.strike()
