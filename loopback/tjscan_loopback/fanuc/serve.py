"""Run a loopback FANUC controller as this process."""

from __future__ import annotations

import socket
import struct
from contextlib import suppress

from tjscan_loopback.cyclic.controller import Answer
from tjscan_loopback.cyclic.options import FanucOptions
from tjscan_loopback.cyclic.serve import (
    LARGEST_ANSWER,
    LOOK_INTERVAL,
    LoopbackServer,
    load_controller,
)
from tjscan_loopback.fanuc.controller import (
    CAPABILITY_TYPE,
    STATUS_TYPE,
    STREAM_VERSION,
    StreamController,
)

START_TYPE, STOP_TYPE = 200, 2


class StreamServer(LoopbackServer):
    """The controller's side of Stream Motion: it sends to who sends it a start packet."""

    stamp_word, port = "number", 60015
    _controller: StreamController

    def _find_computer(self, link: socket.socket) -> bool:
        link.settimeout(LOOK_INTERVAL)
        with suppress(TimeoutError):
            while True:
                data, peer = link.recvfrom(LARGEST_ANSWER)
                self._answer_capability(link, data, peer)
                if data[:4] == struct.pack(">I", START_TYPE):
                    link.connect(peer)
                    return True
        return False

    def _receive(self, link: socket.socket) -> Answer | None:
        controller = self._controller
        try:
            data = link.recv(LARGEST_ANSWER)
        except ConnectionRefusedError:
            if not controller.answered:
                controller.start()  # it has gone: another may come
            raise
        self._answer_capability(link, data, None)
        if data[:4] == struct.pack(">I", STOP_TYPE):
            controller.end_session()
        return controller.parse(data)

    def _answer_capability(
        self, link: socket.socket, data: bytes, peer: tuple[str, int] | None
    ) -> None:
        if len(data) == 28 and data[:4] == struct.pack(">I", CAPABILITY_TYPE):
            cycle_ms = self._controller.cycle_ms
            reply = struct.pack(">7I", CAPABILITY_TYPE, STREAM_VERSION, 1, cycle_ms, 0, 3, 0)
            link.sendto(reply, peer or link.getpeername())

    def _of_another_type(self, packet: bytes) -> bytes:
        return struct.pack(">I", STATUS_TYPE + 1) + packet[4:]


def run_loopback_controller(options: FanucOptions) -> None:
    """Run the loopback controller; until interrupted, or an attached stdin ends.

    Raises
    ------
    ConfigurationError
        If the arm, an address or the joint angles can't be.
    """
    controller = load_controller(StreamController, options, patience=options.patience)
    controller.j3_from_horizontal = options.j3_from_horizontal
    StreamServer(controller, options, (options.host, StreamServer.port)).run()
