"""Run a loopback ABB controller as this process."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from tjscan.core.errors import ConfigurationError
from tjscan_loopback.abb.controller import MSGTYPE_DATA, EgmController
from tjscan_loopback.abb.wire import varint_field
from tjscan_loopback.cyclic.serve import LoopbackServer, load_controller
from tjscan_loopback.process import parse_loopback_port


class EgmServer(LoopbackServer):
    """The controller's side of EGM."""

    stamp_word = "seqno"

    def _of_another_type(self, packet: bytes) -> bytes:
        return packet.replace(varint_field(3, MSGTYPE_DATA), varint_field(3, 4), 1)


def run_loopback_controller(
    model: str,
    host: str,
    computer: str,
    *,
    cycle_ms: int,
    timeout_s: float,
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
    if not (4 <= cycle_ms <= 96 and cycle_ms % 4 == 0):
        raise ConfigurationError(f"it is 4 or a multiple of it (found {cycle_ms})", key="cycle_ms")
    if not 0 < timeout_s < inf:
        raise ConfigurationError(f"it is more than 0 (found {timeout_s})", key="timeout_s")
    patience = max(round(1e3 * timeout_s / cycle_ms), 1)
    controller = load_controller(
        EgmController, model, home_deg, cycle_ms=cycle_ms, patience=patience
    )
    EgmServer(controller, host, address, realtime=realtime).run(attached=attached)
