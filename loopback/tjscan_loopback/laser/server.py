"""The loopback laser on the network of this machine."""

from __future__ import annotations

import selectors
import socket
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from queue import SimpleQueue
from threading import Thread
from typing import Final

from tjscan.core.errors import ConfigurationError
from tjscan.core.signals import survive_background_terminal_read
from tjscan_loopback.laser.faults import parse_laser_fault
from tjscan_loopback.laser.gvcp import GVCP_PORT
from tjscan_loopback.laser.sensor import LoopbackSensor
from tjscan_loopback.process import check_is_loopback_address

LOOK_PERIOD: Final = 0.02
"""Seconds between looks at stdin."""

BROADCAST_ADDRESS: Final = "255.255.255.255"
LONGEST_DATAGRAM: Final = 65_536


def run_laser_server(
    sensor: LoopbackSensor, report_line: Callable[[str], None], *, attached: bool
) -> None:
    """Serve until interrupted, or until an attached stdin ends; stdin's lines command faults.

    Raises
    ------
    ConfigurationError
        If the address is not this machine's own, or another program has the port.
    """
    check_is_loopback_address(sensor.host)
    survive_background_terminal_read()
    with ExitStack() as stack:
        control = stack.enter_context(_control_socket(sensor.host))
        stream = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        stream.bind((sensor.host, 0))
        selector = stack.enter_context(selectors.DefaultSelector())
        selector.register(control, selectors.EVENT_READ)
        discovery = _discovery_socket()
        if discovery is not None:
            selector.register(stack.enter_context(discovery), selectors.EVENT_READ)
        lines: SimpleQueue[str | None] = SimpleQueue()
        Thread(target=_listen, args=(lines,), daemon=True).start()
        report_line(f"ready {sensor.host}")
        while True:
            planned = sensor.seconds_to_next(time.monotonic())
            wait = LOOK_PERIOD if planned is None else min(planned, LOOK_PERIOD)
            for key, _ in selector.select(wait):
                _answer(sensor, key.fileobj, control)  # type: ignore[arg-type]
            where, packets = sensor.packets_due(time.monotonic())
            for packet in packets:
                with suppress(OSError):  # a client that went, or asks for packets too large
                    stream.sendto(packet, where)
            while not lines.empty():
                line = lines.get()
                if line is not None:
                    _obey(sensor, line, report_line)
                elif attached:
                    return


def _answer(sensor: LoopbackSensor, heard: socket.socket, control: socket.socket) -> None:
    datagram, client = heard.recvfrom(LONGEST_DATAGRAM)
    if not _is_own_address(client[0]):
        return  # a broadcast of another machine
    reply = sensor.answer(datagram, client, time.monotonic())
    if reply is not None:
        with suppress(OSError):
            control.sendto(reply, client)


def _is_own_address(host: str) -> bool:
    """Whether an address is one of this machine: only those can be bound."""
    if host.startswith("127."):
        return True
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        try:
            trial.bind((host, 0))
        except OSError:
            return False
    return True


def _obey(sensor: LoopbackSensor, line: str, report_line: Callable[[str], None]) -> None:
    try:
        order = parse_laser_fault(line)
    except ConfigurationError as error:
        report_line(f"refused {error}")
        return
    sensor.schedule_fault(order, time.monotonic())
    report_line(f"ordered {line.strip()}")


def _listen(lines: SimpleQueue[str | None]) -> None:
    # A thread, for stdin may be a terminal, a pipe, a file or nothing at all.
    with suppress(OSError, ValueError):
        for line in sys.stdin:
            lines.put(line)
    lines.put(None)


def _control_socket(host: str) -> socket.socket:
    control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        control.bind((host, GVCP_PORT))
    except OSError as error:
        control.close()
        raise ConfigurationError(
            f"port {GVCP_PORT} of {host} can't be had: {error.strerror}. Each laser needs an "
            "address of its own, for instance 127.0.0.4.",
            key="host",
        ) from None
    return control


def _discovery_socket() -> socket.socket | None:
    """Socket that hears the broadcasts of this machine, if it can be had."""
    heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        heard.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        heard.bind((BROADCAST_ADDRESS, GVCP_PORT))
    except OSError:
        heard.close()
        return None
    return heard
