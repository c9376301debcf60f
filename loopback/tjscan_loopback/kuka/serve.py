"""Run a loopback KUKA controller as this process."""

from __future__ import annotations

from tjscan_loopback.cyclic.options import KukaOptions
from tjscan_loopback.cyclic.serve import LoopbackServer, load_controller
from tjscan_loopback.kuka.controller import RsiController
from tjscan_loopback.process import parse_loopback_port


class RsiServer(LoopbackServer):
    """The controller's side of RSI."""

    stamp_word = "ipoc"

    def _of_another_type(self, packet: bytes) -> bytes:
        return packet.replace(b"KUKA", b"KAKU")


def run_loopback_controller(options: KukaOptions) -> None:
    """Run the loopback controller; until interrupted, or an attached stdin ends.

    Raises
    ------
    ConfigurationError
        If the arm, an address or the joint angles can't be.
    """
    address = parse_loopback_port(options.computer, key="computer")
    controller = load_controller(RsiController, options, patience=options.timeout)
    RsiServer(controller, options, address).run()
