"""A map of registers is refused by name where it can't be, and holds what was put in."""

from typing import Any

import pytest
from power_jobs import REGISTERS, modbus_settings, modbus_table

from tjscan.core.errors import ConfigurationError, PowerFault
from tjscan.core.sourced import NumberSource
from tjscan.power.simulated import PowerSimulationSettings, SimulatedPowerSource
from tjscan.power.source import PowerSetting
from tjscan_loopback.power.registers import read_orders, write_states


def changed(name: str, **keys: Any) -> dict[str, Any]:
    registers = [dict(one) | (keys if one["name"] == name else {}) for one in REGISTERS]
    return modbus_table(register=registers)


def without(name: str) -> dict[str, Any]:
    return modbus_table(register=[dict(one) for one in REGISTERS if one["name"] != name])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (without("start"), "start is missing"),
        (without("flow"), "flow is missing"),
        (changed("gas", bit=0), "gas and start overlap in bit 0 of word 100"),
        (changed("feed", word=100), "feed and start overlap"),
        (changed("feed", word=101), "constant and feed overlap"),
        (changed("feed", word=120), "feed is word 120, and write reaches from 100 to 107"),
        (changed("current", word=107), "current is word 107, and read reaches from 200 to 207"),
        (changed("flow", bit=None), "flow is a bit"),
        (changed("current", bit=2), "current is no bit"),
        (changed("current", range=[5.0, 5.0]), "range of current"),
        (modbus_table(read=[104, 104]), "write and read overlap from word 104"),
        (modbus_table(constant=[{"word": 99, "value": 1}]), "word 99 is not in the block"),
        (
            modbus_table(register=[*modbus_table()["register"], dict(REGISTERS[0])]),
            "start is there twice",
        ),
    ],
)
def test_map_that_can_not_be_is_refused_by_name(table: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        modbus_settings(**table)


def test_orders_reach_the_source_as_they_were_given() -> None:
    settings = modbus_settings()
    bits = {"start": True, "robot_ready": True, "gas": False, "error_reset": False}
    image = settings.encode_orders(bits, {"feed": 9.5 / 60, "correction": -1.5})
    orders = read_orders(settings, settings.write[0], image)
    assert (orders.start, orders.ready, orders.gas, orders.reset) == (True, True, False, False)
    assert orders.feed == pytest.approx(9.5 / 60)
    assert orders.correction == pytest.approx(-1.5)
    assert image[1] == 9


def test_states_reach_the_program_to_half_a_count() -> None:
    settings, now = modbus_settings(), 0.0
    source = SimulatedPowerSource(PowerSimulationSettings(), lambda: now)
    with source:
        source.prepare(PowerSetting(9 / 60))
        source.strike()
        now = 1.0
        sample = source.state()
        bits, words = settings.decode_states(write_states(settings, sample))
    assert bits == {"ready": True, "flow": True, "stable": True, "wire_stuck": False}
    assert sample.current.source is NumberSource.SIMULATED
    assert words["current"] == pytest.approx(sample.current.value, abs=0.05 + 1e-9)
    assert words["measured_feed"] == pytest.approx(sample.feed.value, abs=0.005 / 60 + 1e-9)
    assert words["gas_flow"] == pytest.approx(sample.gas.value, abs=0.05e-3 / 60 + 1e-9)


def test_number_out_of_its_range_is_neither_written_nor_believed() -> None:
    settings = modbus_settings()
    with pytest.raises(PowerFault, match=r"feed is 30, and power.modbus.register allows 1 to 25"):
        settings.encode_orders({}, {"feed": 30 / 60})
    image = [0] * 8
    image[3] = 6000
    settings.decode_states(image)  # no current flows: what it measures then is nothing
    image[0] = 1 << 3
    with pytest.raises(PowerFault, match="current is 600"):
        settings.decode_states(image)
