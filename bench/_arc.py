"""An arc of the loopback power source in real time, with a torch that does as it is told."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import tomli_w

from tjscan.core.config import table_to_dict
from tjscan.core.errors import WeldStopped
from tjscan.power.modbus.registers import ModbusPowerSettings
from tjscan.power.modbus.source import ModbusPowerSource
from tjscan.power.sequence import ArcLimits, ArcPhase, ArcSequence
from tjscan.power.source import PowerSetting
from tjscan_loopback.process import PowerLoopbackProcess

HOST: Final = "127.0.0.9"
CYCLE_TIME: Final = 0.01
SPEED: Final = 5e-3
LIMITS: Final = ArcLimits(preflow=0.05, postflow=0.05, crater=0.05)


def free_port(host: str = HOST) -> int:
    """A port of the loopback power source's address that no one listens on."""
    with socket.socket() as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


@contextmanager
def loopback_power_source(
    settings: ModbusPowerSettings, host: str = HOST
) -> Iterator[tuple[PowerLoopbackProcess, ModbusPowerSettings]]:
    """A loopback power source with these registers, and the settings that reach it."""
    port = free_port(host)
    with TemporaryDirectory() as folder:
        job = Path(folder) / "power.toml"
        job.write_text(tomli_w.dumps({"power": {"modbus": table_to_dict(settings)}}))
        with PowerLoopbackProcess(job, host, port) as process:
            yield process, replace(settings, host=host, port=port)


class RealTimeArc:
    """One arc, cycle by cycle in real time.

    Parameters
    ----------
    source : ModbusPowerSource
        Connected.
    """

    def __init__(self, source: ModbusPowerSource) -> None:
        self.events: list[tuple[str, str]] = []
        self.arc = ArcSequence(source, LIMITS, lambda name, what: self.events.append((name, what)))
        self.stands, self.speed, self.stopped = False, 0.0, 0.0
        self._due = time.monotonic()

    def begin(self, feed: float = 9 / 60) -> None:
        """Set the source, and let gas flow."""
        self.arc.begin(PowerSetting(feed), self.speed)

    def cycle(self, *, at_end: bool = False) -> None:
        """Wait for the next cycle, and go on."""
        self._due = max(self._due + CYCLE_TIME, time.monotonic())
        time.sleep(self._due - min(self._due, time.monotonic()))
        try:
            self.arc.advance(self.speed, SPEED, at_end=at_end)
        finally:
            moved = self.speed > 0
            self.speed = SPEED if self.arc.may_move and not self.stands else 0.0
            if moved and not self.speed:
                self.stopped = time.monotonic()

    def run_to(self, phase: ArcPhase, limit: float = 5.0) -> None:
        """Go on to a phase."""
        if self.arc.phase is ArcPhase.IDLE:
            self.begin()
        last = time.monotonic() + limit
        at_end = phase in (ArcPhase.CRATER, ArcPhase.EXTINCTION, ArcPhase.AFTER_GAS, ArcPhase.DONE)
        while self.arc.phase is not phase and time.monotonic() < last:
            self.cycle(at_end=at_end)

    def until_stopped(self, limit: float = 5.0, **keys: Any) -> WeldStopped:
        """Go on until a guard stops it, and return why."""
        last = time.monotonic() + limit
        while time.monotonic() < last:
            try:
                self.cycle(**keys)
            except WeldStopped as error:
                return error
        raise RuntimeError("nothing stopped the arc")
