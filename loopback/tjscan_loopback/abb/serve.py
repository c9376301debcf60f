"""Run a loopback ABB controller as this process."""

from __future__ import annotations

from tjscan_loopback.abb.controller import MSGTYPE_DATA, EgmController
from tjscan_loopback.abb.wire import varint_field
from tjscan_loopback.cyclic.options import AbbOptions
from tjscan_loopback.cyclic.serve import LoopbackServer, load_controller
from tjscan_loopback.process import parse_loopback_port


class EgmServer(LoopbackServer):
    """The controller's side of EGM."""

    stamp_word = "seqno"

    def _of_another_type(self, packet: bytes) -> bytes:
        return packet.replace(varint_field(3, MSGTYPE_DATA), varint_field(3, 4), 1)


def run_loopback_controller(options: AbbOptions) -> None:
    """Run the loopback controller; until interrupted, or an attached stdin ends.

    Raises
    ------
    ConfigurationError
        If the arm, an address or the joint angles can't be.
    """
    address = parse_loopback_port(options.computer, key="computer")
    patience = max(round(1e3 * options.timeout_s / options.cycle_ms), 1)
    controller = load_controller(EgmController, options, patience=patience)
    EgmServer(controller, options, address).run()
