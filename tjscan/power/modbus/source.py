"""A power source behind Modbus TCP."""

from __future__ import annotations

import logging
from collections.abc import Callable
from threading import RLock
from time import monotonic
from typing import Final, Self

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from tjscan.core.devices import DeviceBase, DeviceIdentity
from tjscan.core.errors import PowerFault, PowerLinkLost
from tjscan.core.sourced import ABSENT_NUMBER, NumberSource, SourcedNumber
from tjscan.power.modbus.registers import ModbusPowerSettings
from tjscan.power.source import PowerSample, PowerSetting

MEASURED_WORDS: Final = ("current", "voltage", "measured_feed", "gas_flow", "energy")


class ModbusPowerSource(DeviceBase):
    """A power source whose registers a job describes; see `PowerSource`.

    Each call of `state` writes all orders and reads all states in one exchange (function 23), so
    the source's own watchdog hears of this program, and puts the arc out without it.

    Parameters
    ----------
    settings : ModbusPowerSettings
    """

    def __init__(self, settings: ModbusPowerSettings) -> None:
        self._settings = settings
        self._client = ModbusTcpClient(
            settings.host, port=settings.port, timeout=settings.timeout, retries=0
        )
        self._lock = RLock()
        self._bits = {"start": False, "robot_ready": False, "gas": False, "error_reset": False}
        self._setting_words: dict[str, float] = {}
        self._last_words: dict[str, float] = {}
        self._changed, self._lost = 0.0, False

    def __enter__(self) -> Self:
        """Connect.

        Raises
        ------
        PowerLinkLost
            If nothing answers.
        """
        # Each failure is an error of this program's own, with what to do about it.
        logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
        if not self._client.connect():  # type: ignore[no-untyped-call]
            where = f"{self._settings.host}:{self._settings.port}"
            raise PowerLinkLost(
                f"no power source answers on {where}. Is it switched on, and power.modbus.host "
                "its address?"
            )
        self._bits["robot_ready"] = True
        try:
            self.state()
        except PowerFault:
            self._client.close()  # type: ignore[no-untyped-call]
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._bits["robot_ready"] = False
        self.end_gas()
        self.quench()
        self._client.close()  # type: ignore[no-untyped-call]

    @property
    def identity(self) -> DeviceIdentity:
        """See `Device.identity`: the registers state none."""
        return DeviceIdentity(model="Modbus power source")

    def prepare(self, setting: PowerSetting) -> None:
        """See `PowerSource.prepare`; what was written is read back."""
        with self._lock:
            self.set(setting)
            self._bits["gas"] = True
            self.state()
            first, count = self._settings.write
            answer = self._ask(
                lambda: self._client.read_holding_registers(
                    first, count=count, device_id=self._settings.unit
                )
            )
            if answer != (written := self._image()):
                off = next(
                    (k for k, (a, b) in enumerate(zip(answer, written, strict=False)) if a != b), 0
                )
                raise PowerFault(
                    f"register {first + off} holds {answer[off : off + 1]} where "
                    f"{written[off]} was written: the source does not take its setting"
                )

    def strike(self) -> None:
        """See `PowerSource.strike`."""
        with self._lock:
            self._bits["start"], self._changed = True, monotonic()
            self.state()

    def set(self, setting: PowerSetting) -> None:
        """See `PowerSource.set`; the next exchange brings it."""
        words = {"feed": setting.feed, "correction": setting.correction}
        if setting.job is not None:
            words["job"] = float(setting.job)
        self._settings.encode_orders(self._bits, words)  # raises what it can't be set to
        self._setting_words = words

    def state(self) -> PowerSample:
        """See `PowerSource.state`."""
        with self._lock:
            bits, words = self._settings.decode_states(self._exchange())
            now = monotonic()
            self._watch_for_standstill(now, words, burning=bits["flow"])
        measured = dict.fromkeys(MEASURED_WORDS, ABSENT_NUMBER)
        for name in measured.keys() & words.keys():
            measured[name] = SourcedNumber(words[name], NumberSource.MEASURED)
        error = words.get("error", 0.0)
        return PowerSample(
            time=now,
            flow=bits["flow"],
            source=NumberSource.MEASURED,
            ready=bits["ready"],
            stable=bits.get("stable", bits["flow"]),
            wire_stuck=bits.get("wire_stuck"),
            current=measured["current"],
            voltage=measured["voltage"],
            feed=measured["measured_feed"],
            gas=measured["gas_flow"],
            energy=measured["energy"],
            error=f"number {error:.0f}" if error else "",
        )

    def quench(self) -> None:
        """See `PowerSource.quench`."""
        self._bits["start"] = False
        self._tell()

    def end_gas(self) -> None:
        """See `PowerSource.end_gas`; tells it at once, as no exchange may follow for long."""
        self._bits["gas"] = False
        self._tell()

    def _tell(self) -> None:
        """Bring the orders to it if it can be reached; never raises."""
        # The exchange that runs in another thread is followed by one without start. A source that
        # does not answer is told nothing: its own watchdog puts the arc out.
        if self._lost or not self._lock.acquire(blocking=False):
            return
        try:
            self._exchange()
        except PowerFault:
            pass  # the next state names the cause
        finally:
            self._lock.release()

    def reset(self) -> None:
        """See `PowerSource.reset`: an edge of the bit for it."""
        for bit in (True, False):
            self._bits["error_reset"] = bit
            self.state()

    def _image(self) -> list[int]:
        return self._settings.encode_orders(self._bits, self._setting_words)

    def _exchange(self) -> list[int]:
        (write, _), (read, count) = self._settings.write, self._settings.read
        values, unit = self._image(), self._settings.unit
        return self._ask(
            lambda: self._client.readwrite_registers(
                read_address=read,
                read_count=count,
                write_address=write,
                values=values,
                device_id=unit,
            )
        )

    def _ask(self, ask: Callable[[], ModbusPDU]) -> list[int]:
        where = f"the power source on {self._settings.host}:{self._settings.port}"
        try:
            answer = ask()
        except ModbusException as error:
            self._lost = True
            raise PowerLinkLost(f"{where} does not answer: {error}") from error
        self._lost = False
        if answer.isError():
            raise PowerFault(f"{where} refuses: {answer}. Compare power.modbus with its manual")
        return list(answer.registers)

    def _watch_for_standstill(self, now: float, words: dict[str, float], *, burning: bool) -> None:
        """Refuse measurements that stand still: of a real current no two are the same for long."""
        if words != self._last_words or not burning or not words:
            self._last_words, self._changed = words, now
        elif now - self._changed > self._settings.frozen:
            raise PowerLinkLost(
                f"the registers of the power source have not changed for {now - self._changed:.2f} "
                "s while current flows"
            )
