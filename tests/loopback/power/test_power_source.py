"""The driver of a power source against the loopback one, over its registers."""

from collections.abc import Iterator

import pytest

pytest.importorskip("pymodbus", reason="pymodbus is not installed: pip install 'tjscan[power]'")

from _arc import HOST, RealTimeArc, free_port, loopback_power_source
from power_jobs import modbus_settings, modbus_table

from tjscan.core.errors import PowerFault, PowerLinkLost, WeldStopped
from tjscan.core.sourced import NumberSource
from tjscan.power.modbus.registers import ModbusPowerSettings
from tjscan.power.modbus.source import ModbusPowerSource
from tjscan.power.sequence import ArcFault, ArcPhase
from tjscan.power.source import PowerSetting
from tjscan_loopback.process import PowerLoopbackProcess

Link = tuple[PowerLoopbackProcess, ModbusPowerSource]


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[PowerLoopbackProcess, ModbusPowerSettings]]:
    with loopback_power_source(modbus_settings()) as found:
        yield found


@pytest.fixture
def link(served: tuple[PowerLoopbackProcess, ModbusPowerSettings]) -> Iterator[Link]:
    process, settings = served
    process.schedule_fault("clear")
    process.unread_output()
    with ModbusPowerSource(settings) as source:
        yield process, source


def test_sound_arc_is_measured_and_ends(link: Link) -> None:
    process, source = link
    arc = RealTimeArc(source)
    arc.run_to(ArcPhase.WELDING)
    for _ in range(5):
        arc.cycle()
    sample = arc.arc.sample
    assert sample is not None
    assert sample.current.source is NumberSource.MEASURED
    assert sample.current.value == pytest.approx(290.0, abs=12.0)
    assert sample.feed.value == pytest.approx(9 / 60, abs=1e-4)
    assert sample.energy.source is NumberSource.ABSENT
    arc.run_to(ArcPhase.DONE)
    assert arc.arc.may_retract
    began = process.wait_for_current(on=True)
    assert process.wait_for_current(on=False) > began


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("arc-lost", ArcFault.ARC_LOST),
        ("no-gas", ArcFault.NO_GAS),
        ("error", ArcFault.SOURCE),
        ("link-dead", ArcFault.LINK_LOST),
        ("register-frozen", ArcFault.LINK_LOST),
    ],
)
def test_fault_while_welding_is_named_and_the_arc_is_off(
    link: Link, fault: str, expected: ArcFault
) -> None:
    process, source = link
    arc = RealTimeArc(source)
    arc.run_to(ArcPhase.WELDING)
    process.schedule_fault(fault)
    error = arc.until_stopped()
    assert error.fault is expected
    assert arc.speed == 0.0
    process.wait_for_current(on=False)


def test_no_ignition_and_stuck_wire_are_named(link: Link) -> None:
    process, source = link
    process.schedule_fault("no-ignition")
    arc = RealTimeArc(source)
    arc.begin()
    assert arc.until_stopped().fault is ArcFault.NO_IGNITION
    process.schedule_fault("clear")
    process.schedule_fault("wire-stuck")
    arc = RealTimeArc(source)
    arc.run_to(ArcPhase.WELDING)
    assert arc.until_stopped(at_end=True).fault is ArcFault.WIRE_STUCK
    assert not arc.arc.may_retract


def test_source_that_hears_nothing_puts_its_arc_out(link: Link) -> None:
    process, source = link
    RealTimeArc(source).run_to(ArcPhase.WELDING)
    process.wait_for_line("watchdog")
    process.wait_for_current(on=False)


def test_setting_out_of_its_range_strikes_nothing(link: Link) -> None:
    _, source = link
    arc = RealTimeArc(source)
    with pytest.raises(WeldStopped, match=r"feed is 30, and .* allows 1 to 25"):
        arc.begin(30 / 60)
    assert not source.state().flow


def test_reported_value_out_of_its_range_puts_the_arc_out(
    served: tuple[PowerLoopbackProcess, ModbusPowerSettings],
) -> None:
    registers = [dict(one) for one in modbus_table()["register"]]
    for one in registers:
        if one["name"] == "current":
            one["range"] = [0.0, 200.0]  # 9 m/min take 290 A
    narrow = modbus_settings(register=registers, host=served[1].host, port=served[1].port)
    served[0].schedule_fault("clear")
    served[0].unread_output()
    with ModbusPowerSource(narrow) as source:
        arc = RealTimeArc(source)
        arc.begin()
        error = arc.until_stopped()
        assert error.fault is ArcFault.SOURCE
        assert "current is" in str(error)
        served[0].wait_for_current(on=False)


def test_registers_that_are_not_there_are_named(
    served: tuple[PowerLoopbackProcess, ModbusPowerSettings],
) -> None:
    other = modbus_settings(host=served[1].host, port=served[1].port, read=[200, 9])
    with pytest.raises(PowerFault, match="refuses"), ModbusPowerSource(other):
        pass


def test_nothing_that_answers_is_named() -> None:
    settings = modbus_settings(host=HOST, port=free_port())
    with pytest.raises(PowerLinkLost, match="no power source answers"), ModbusPowerSource(settings):
        pass


def test_arc_is_set_anew_while_it_burns(link: Link) -> None:
    _, source = link
    arc = RealTimeArc(source)
    arc.run_to(ArcPhase.WELDING)
    arc.arc.set(PowerSetting(6 / 60))
    for _ in range(3):
        arc.cycle()
    sample = arc.arc.sample
    assert sample is not None
    assert sample.feed.value == pytest.approx(6 / 60, abs=1e-4)


def test_gas_ends_at_once_and_not_with_the_next_arc(link: Link) -> None:
    _, source = link
    source.prepare(PowerSetting(9 / 60))

    def gas() -> bool:
        (word,) = source._client.read_holding_registers(100, count=1).registers
        return bool(word & 1 << 3)

    assert gas()
    source.end_gas()
    assert not gas()
