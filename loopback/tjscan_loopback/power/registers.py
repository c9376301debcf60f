"""The registers of the loopback power source: what was ordered, and what it reports.

Words are taken apart and put together here, and not by the driver's own functions: a mistake in one
of them is not in the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tjscan.power.modbus.registers import ModbusPowerSettings
from tjscan.power.source import PowerSample

METRES_PER_MINUTE: Final = 60.0
LITRES_PER_MINUTE: Final = 60e3


@dataclass(frozen=True, slots=True)
class Orders:
    """What a program orders.

    Parameters
    ----------
    start, gas, ready, reset : bool
    feed : float
        m/s.
    correction : float
        V.
    """

    start: bool
    gas: bool
    ready: bool
    reset: bool
    feed: float
    correction: float


def read_orders(settings: ModbusPowerSettings, first: int, image: list[int]) -> Orders:
    """Read orders from registers that begin at an address."""

    def bit(name: str, otherwise: bool) -> bool:
        for one in settings.register:
            if one.name == name:
                found = image[one.word - first] // 2 ** (one.bit or 0) % 2 == 1
                return found is not one.inverted
        return otherwise

    def number(name: str) -> float:
        for one in settings.register:
            if one.name == name:
                counts = image[one.word - first]
                return float(counts - 65536 if one.signed and counts > 32767 else counts) * (
                    one.scale
                )
        return 0.0

    start = bit("start", otherwise=False)
    return Orders(
        start=start,
        gas=bit("gas", otherwise=start),
        ready=bit("robot_ready", otherwise=True),
        reset=bit("error_reset", otherwise=False),
        feed=number("feed") / METRES_PER_MINUTE,
        correction=number("correction"),
    )


def write_states(settings: ModbusPowerSettings, sample: PowerSample) -> list[int]:
    """Registers of the block that is read, from what the source is like."""
    first, count = settings.read
    image = [0] * count
    bits = {
        "ready": sample.ready,
        "flow": sample.flow,
        "stable": sample.stable,
        "wire_stuck": bool(sample.wire_stuck),
    }
    numbers = {
        "error": 17.0 if sample.error else 0.0,
        "current": sample.current.value or 0.0,
        "voltage": sample.voltage.value or 0.0,
        "measured_feed": METRES_PER_MINUTE * (sample.feed.value or 0.0),
        "gas_flow": LITRES_PER_MINUTE * (sample.gas.value or 0.0),
        "energy": sample.energy.value or 0.0,
    }
    for one in settings.register:
        if one.name in bits:
            if bits[one.name] is not one.inverted:
                image[one.word - first] += 2 ** (one.bit or 0)
        elif one.name in numbers:
            image[one.word - first] = int(numbers[one.name] / one.scale + 0.5) % 65536
    return image
