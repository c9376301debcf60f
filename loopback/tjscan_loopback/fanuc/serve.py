"""Run a loopback FANUC controller as this process."""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from tjscan.core.errors import ConfigurationError
from tjscan_loopback.cyclic.controller import Answer
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
STREAM_PORT: Final = 60015


class StreamServer(LoopbackServer):
    """The controller's side of Stream Motion: it sends to who sends it a start packet."""

    stamp_word = "number"
    _controller: StreamController
    _begun = False

    def _link_of_program(self) -> socket.socket | None:
        if self._link is None or self._program != self._controller.program:
            if self._link is not None:
                self._link.close()
            self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._link.bind((self._host, STREAM_PORT))
            self._program, self._begun = self._controller.program, False
        link = self._link
        link.settimeout(LOOK_INTERVAL)
        with suppress(TimeoutError):
            while not self._begun:
                data, peer = link.recvfrom(LARGEST_ANSWER)
                self._answer_capability(link, data, peer)
                if data[:4] == struct.pack(">I", START_TYPE):
                    link.connect(peer)
                    self._begun = True
        return link if self._begun else None

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


def run_loopback_controller(
    model: str,
    host: str,
    *,
    cycle_ms: int,
    patience: int,
    j3_from_horizontal: bool,
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
    if not 2 <= cycle_ms <= 32:
        raise ConfigurationError(f"it is 2 to 32 (found {cycle_ms})", key="cycle_ms")
    if patience < 0:
        raise ConfigurationError(f"it is 0 or more (found {patience})", key="patience")
    controller = load_controller(
        StreamController, model, home_deg, cycle_ms=cycle_ms, patience=patience
    )
    controller.j3_from_horizontal = j3_from_horizontal
    StreamServer(controller, host, (host, STREAM_PORT), realtime=realtime).run(attached=attached)
