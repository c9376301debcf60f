"""Run a loopback power source as this process."""

from __future__ import annotations

import asyncio
import sys
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from time import monotonic
from typing import Any, Final

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from tjscan.core.config import read_toml, validate_table
from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.signals import survive_background_terminal_read
from tjscan.power.modbus.registers import ModbusPowerSettings
from tjscan.power.simulated import (
    PowerFaultOrder,
    PowerSimulationSettings,
    SimulatedPowerSource,
)
from tjscan.power.source import PowerSetting
from tjscan_loopback.power.registers import Orders, read_orders, write_states
from tjscan_loopback.process import check_is_loopback_address, print_line

TICK_TIME: Final = 1e-3
"""Seconds between two looks at orders, watchdog and current."""


class LinkFaultOrder(StrEnum):
    """Fault of the link that a loopback power source can be given."""

    LINK_DEAD = "link-dead"
    """It does not answer any more."""
    REGISTERS_FROZEN = "register-frozen"
    """It answers the same again and again."""


FAULT_NAMES: Final = (*PowerFaultOrder, *LinkFaultOrder)


class LoopbackPowerSource:
    """A simulated power source in real time, behind registers.

    It puts the arc out if it hears nothing for the time of its watchdog.

    Parameters
    ----------
    settings : ModbusPowerSettings
        Where its registers are.
    simulation : PowerSimulationSettings
    watchdog : float
        Seconds.
    """

    def __init__(
        self, settings: ModbusPowerSettings, simulation: PowerSimulationSettings, watchdog: float
    ) -> None:
        self._settings, self._watchdog = settings, watchdog
        self._source = SimulatedPowerSource(simulation, monotonic)
        self._source.__enter__()
        self._heard, self._started, self._flowed = monotonic(), False, False
        self._frozen: list[int] | None = None
        self.answers = True
        blocks = [
            SimData(first, count=count, values=0, datatype=DataType.REGISTERS)
            for first, count in sorted((settings.write, settings.read))
        ]
        self.device = SimDevice(id=settings.unit, simdata=blocks, action=self._act)

    def order_fault(self, name: str) -> None:
        """Let something fail, or set all right again."""
        if name == LinkFaultOrder.LINK_DEAD:
            self.answers = False
        elif name == LinkFaultOrder.REGISTERS_FROZEN:
            self._frozen = write_states(self._settings, self._source.state())
        else:
            self._source.order_fault(PowerFaultOrder(name))
        if name == PowerFaultOrder.CLEAR:
            self.answers, self._frozen = True, None

    async def tick(self) -> None:
        """Look at watchdog and current, for ever."""
        while True:
            now = monotonic()
            if self._started and now - self._heard > self._watchdog:
                self._end_arc(f"watchdog {now:.6f}")
            flows = self._source.state().flow
            if flows != self._flowed:
                self._flowed = flows
                print_line(f"current {'on' if flows else 'off'} {now:.6f}")
            await asyncio.sleep(TICK_TIME)

    async def _act(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        written: list[Any] | None,
    ) -> ExcCodes | None:
        if not self.answers:
            await asyncio.sleep(3600.0)
        if written is not None:
            if (address, count) != self._settings.write:
                return ExcCodes.ILLEGAL_ADDRESS
            self._heard = monotonic()
            self._obey(read_orders(self._settings, address, written))
            return None
        first, length = self._settings.read
        if first <= address < first + length:
            image = self._frozen or write_states(self._settings, self._source.state())
            registers[first - start : first - start + length] = image
        return None

    def _obey(self, orders: Orders) -> None:
        setting = PowerSetting(orders.feed, orders.correction)
        if orders.gas:
            self._source.set(setting)
            if not self._started:
                self._source.prepare(setting)
        else:
            self._source.end_gas()
        if orders.start and orders.ready and not self._started:
            self._started = True
            self._source.strike()
        elif self._started and not (orders.start and orders.ready):
            self._end_arc("quenched")

    def _end_arc(self, why: str) -> None:
        self._started = False
        self._source.quench()
        print_line(why)


def run_loopback_power_source(
    job: Path, host: str | None, port: int | None, *, watchdog: float, attached: bool
) -> None:
    """Run a power source until interrupted, or until an attached stdin ends.

    Raises
    ------
    ConfigurationError
        If the job has no registers, or the address is another machine's.
    """
    table = read_toml(job).get("power", {})
    if not isinstance(table, dict) or "modbus" not in table:
        raise ConfigurationError("the registers are needed: [power.modbus]", file=job, key="power")
    settings = validate_table(ModbusPowerSettings, table["modbus"], job)
    simulation = validate_table(PowerSimulationSettings, table.get("simulated", {}), job)
    host, port = host or settings.host, settings.port if port is None else port
    check_is_loopback_address(host)
    survive_background_terminal_read()
    source = LoopbackPowerSource(settings, simulation, watchdog)
    with suppress(asyncio.CancelledError):
        asyncio.run(_serve(source, host, port, attached=attached))


async def _serve(source: LoopbackPowerSource, host: str, port: int, *, attached: bool) -> None:
    server = ModbusTcpServer(source.device, address=(host, port))
    await server.serve_forever(background=True)
    ticking = asyncio.create_task(source.tick())
    lines: SimpleQueue[str | None] = SimpleQueue()
    Thread(target=_listen, args=(lines,), daemon=True).start()
    print_line(f"ready {host}:{port}")
    while True:
        await asyncio.sleep(TICK_TIME)
        if ticking.done():
            ticking.result()
        while not lines.empty():
            line = lines.get()
            if line is not None:
                _order(source, line.strip())
            elif attached:
                ticking.cancel()
                await server.shutdown()  # type: ignore[no-untyped-call]
                return


def _order(source: LoopbackPowerSource, line: str) -> None:
    if line in FAULT_NAMES:
        source.order_fault(line)
        print_line(f"ordered {line}")
    else:
        close = nearest_word(line, FAULT_NAMES)
        print_line(f"refused there is no fault {line!r}; did you mean: {close}?")


def _listen(lines: SimpleQueue[str | None]) -> None:
    # A thread, for stdin may be a terminal, a pipe, a file or nothing at all.
    with suppress(OSError, ValueError):
        for line in sys.stdin:
            lines.put(line)
    lines.put(None)
