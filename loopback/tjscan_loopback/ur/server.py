"""The controller on the network of this machine: RTDE, scripts and dashboard, on one address."""

from __future__ import annotations

import asyncio
import struct
import sys
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from threading import Thread
from typing import Any, Final

from tjscan.core.errors import ConfigurationError
from tjscan.robot.closed_form import DhParameters
from tjscan_loopback.faults import parse_scheduled_fault
from tjscan_loopback.process import check_is_loopback_address
from tjscan_loopback.ur.controller import LoopbackController
from tjscan_loopback.ur.dashboard import DASHBOARD_GREETING, DashboardServer
from tjscan_loopback.ur.faults import FAULT_COMES, InjectedFault
from tjscan_loopback.ur.outputs import read_output
from tjscan_loopback.ur.primary import kinematics_message
from tjscan_loopback.ur.urscript.incoming import IncomingScripts
from tjscan_loopback.ur.urscript.tokens import ScriptError
from tjscan_loopback.ur.wire import PACKAGE_HEADER, InputOwners, RtdeSession

RTDE_PORT: Final = 30004
SCRIPT_PORTS: Final = (30001, 30002, 30003)
STATE_PORTS: Final = (30001, 30002)
"""Those that send robot states, too."""
DASHBOARD_PORT: Final = 29999

CONTROLLER_VERSION: Final = (5, 23, 0, 1101319)
"""Of the controller it pretends to be: an e-Series arm that has remote control."""

LARGEST_DELAY: Final = 0.5
"""Seconds of ticks that it catches up with when it was held up; its time stands still for more."""

MOST_WAITING: Final = 1 << 16
"""Bytes that wait for a client that does not read; more are not sent."""


@dataclass(eq=False)
class LoopbackServer:
    """Network server of one loopback controller.

    Parameters
    ----------
    controller : LoopbackController
        The controller.
    model : str
        Name of its arm.
    host : str
        A loopback address.
    hz : float
        Its ticks per second.
    report_line : callable
        Receives a line when it is ready, and one for each command.
    dh : DhParameters, optional
        What it states of its arm's kinematics; nothing if left out, as older controllers.
    rate : float, optional
        Seconds of its clock in one of this machine's.
    """

    controller: LoopbackController
    model: str
    host: str
    hz: float
    report_line: Callable[[str], None]
    dh: DhParameters | None = None
    rate: float = 1.0

    def __post_init__(self) -> None:
        check_is_loopback_address(self.host)
        self._registry = InputOwners()
        self._sessions: dict[RtdeSession, asyncio.StreamWriter] = {}
        self._dashboards: set[asyncio.StreamWriter] = set()
        self._dashboard = DashboardServer(self.controller, self.model, CONTROLLER_VERSION)
        self._thawed = asyncio.Event()

    async def run(self, *, attached: bool) -> None:
        """Serve until cancelled, or until stdin ends if it is attached to that.

        Raises
        ------
        ConfigurationError
            If another program has one of the ports.
        """
        services = [(RTDE_PORT, self._rtde), (DASHBOARD_PORT, self._dash)]
        services += [
            (port, self._state if port in STATE_PORTS else self._script) for port in SCRIPT_PORTS
        ]
        for port, service in services:
            try:
                await asyncio.start_server(service, self.host, port)
            except OSError as error:
                raise ConfigurationError(
                    f"port {port} of {self.host} can't be had: {error.strerror}. "
                    "Give it another address, for instance 127.0.0.3.",
                    key="host",
                ) from None
        self.report_line(f"ready {self.host}")
        clock = asyncio.ensure_future(self._clock())
        commands = asyncio.ensure_future(self._orders())
        await asyncio.wait(
            {clock, commands} if attached else {clock}, return_when="FIRST_COMPLETED"
        )
        if clock.done():
            clock.result()

    async def _clock(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + 1 / (self.hz * self.rate), loop.time() - LARGEST_DELAY)
            await asyncio.sleep(max(due - loop.time(), 0))
            if self.controller.frozen:
                continue
            self._thawed.set()
            self.controller.advance_one_tick()
            if self.controller.dropping:
                self.controller.dropping = False
                for writer in self._sessions.values():
                    writer.transport.abort()
            if self.controller.dropping_dashboard:
                self.controller.dropping_dashboard = False
                for writer in self._dashboards:
                    writer.transport.abort()
            for session, writer in list(self._sessions.items()):
                if writer.transport.get_write_buffer_size() < MOST_WAITING:
                    session.send_outputs(partial(read_output, self.controller))

    async def _orders(self) -> None:
        """Obey the lines of stdin until it ends."""
        loop, ended = asyncio.get_running_loop(), asyncio.Event()

        def listen() -> None:
            # A thread, for stdin may be a terminal, a pipe, a file or nothing at all.
            with suppress(OSError, ValueError, RuntimeError):
                for line in sys.stdin:
                    loop.call_soon_threadsafe(self._obey, line)
            with suppress(RuntimeError):  # the loop has ended before stdin did
                loop.call_soon_threadsafe(ended.set)

        Thread(target=listen, daemon=True).start()
        await ended.wait()

    def _obey(self, line: str) -> None:
        try:
            order = parse_scheduled_fault(line, InjectedFault, FAULT_COMES)
        except ConfigurationError as error:
            self.report_line(f"refused {error}")
            return
        self.controller.schedule_fault(order)
        self.report_line(f"ordered {line.strip()}")

    async def _rtde(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        session = RtdeSession(
            writer.write, CONTROLLER_VERSION, self.hz, self._registry, self.controller.take_inputs
        )
        self._sessions[session] = writer
        try:
            await self._serve(self._packages(reader, session), writer)
        finally:
            del self._sessions[session]
            session.close()

    async def _packages(self, reader: asyncio.StreamReader, session: RtdeSession) -> None:
        while True:
            size, kind = PACKAGE_HEADER.unpack(await reader.readexactly(PACKAGE_HEADER.size))
            if size < PACKAGE_HEADER.size:
                raise ValueError(f"a package of {size} bytes")
            payload = await reader.readexactly(size - PACKAGE_HEADER.size)
            await self._awake()
            session.answer_package(kind, payload)

    async def _state(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self.dh is not None:
            writer.write(kinematics_message(self.dh))
        await self._script(reader, writer)

    async def _script(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._serve(self._scripts(reader), writer)

    async def _scripts(self, reader: asyncio.StreamReader) -> None:
        incoming = IncomingScripts()
        while data := await reader.read(1 << 16):
            await self._awake()
            for script in incoming.add(data.decode(errors="replace")):
                try:
                    self.controller.start_script(script)
                except ScriptError as error:
                    self.report_line(f"script refused: {error}")

    async def _dash(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self.controller.dashboard_closed:
            writer.transport.abort()
            return
        writer.write(f"{DASHBOARD_GREETING}\n".encode())
        self._dashboards.add(writer)
        try:
            await self._serve(self._lines(reader, writer), writer)
        finally:
            self._dashboards.discard(writer)

    async def _lines(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := await reader.readline():
            await self._awake()
            writer.write(f"{self._dashboard.answer_line(line.decode(errors='replace'))}\n".encode())

    async def _awake(self) -> None:
        """Wait while the controller is frozen: it answers no one."""
        if self.controller.frozen:
            self._thawed.clear()
            await self._thawed.wait()

    async def _serve(
        self, service: Coroutine[Any, Any, None], writer: asyncio.StreamWriter
    ) -> None:
        try:
            await service
        except (asyncio.IncompleteReadError, ConnectionError):
            pass  # the client went
        except (ScriptError, ValueError, struct.error) as error:
            self.report_line(f"hung up: {error}")  # on a client that speaks another language
        finally:
            writer.close()
