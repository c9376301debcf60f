"""Run a loopback KUKA controller as this process."""

from __future__ import annotations

from collections.abc import Sequence

from tjscan.core.errors import ConfigurationError
from tjscan_loopback.cyclic.serve import LoopbackServer, load_controller
from tjscan_loopback.kuka.controller import LoopbackController
from tjscan_loopback.process import parse_loopback_port


class RsiServer(LoopbackServer):
    """The controller's side of RSI."""

    stamp_word = "ipoc"

    def _of_another_type(self, packet: bytes) -> bytes:
        return packet.replace(b"KUKA", b"KAKU")


def run_loopback_controller(
    model: str,
    host: str,
    computer: str,
    *,
    cycle_ms: int,
    timeout: int,
    home_deg: Sequence[float],
    realtime: bool,
    attached: bool,
) -> None:
    """Run the loopback controller; until interrupted, or an attached stdin ends.

    Raises
    ------
    ConfigurationError
        If the arm, an address, the cycle or the joint angles can't be.
    """
    address = parse_loopback_port(computer, key="computer")
    if cycle_ms not in (4, 12):
        raise ConfigurationError(f"it is 4 or 12 (found {cycle_ms})", key="cycle_ms")
    if timeout < 0:
        raise ConfigurationError(f"it is 0 or more (found {timeout})", key="timeout")
    controller = load_controller(
        LoopbackController, model, home_deg, cycle_ms=cycle_ms, patience=timeout
    )
    RsiServer(controller, host, address, realtime=realtime).run(attached=attached)
