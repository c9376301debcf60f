"""A network between the driver and the loopback controller that can be cut, stalled and garbled."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from random import Random
from typing import Any, Final, Self

PORTS: Final = (29999, 30001, 30002, 30003, 30004)
CHUNK: Final = 1 << 14


class Wire:
    """Passes what is said to one address on to another; a context manager.

    Parameters
    ----------
    host, controller : str
        Where the driver connects, and where the loopback controller listens.
    seed : int
        Of what is garbled.
    """

    def __init__(self, host: str, controller: str, seed: int) -> None:
        self.host, self._controller, self._random = host, controller, Random(seed)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._writers: set[tuple[int, asyncio.StreamWriter]] = set()
        self._servers: list[asyncio.Server] = []
        self.delay = 0.0
        self.garbled = 0.0
        self._swallows = False

    def __enter__(self) -> Self:
        self._open = asyncio.Event()
        self._thread.start()
        self._do(self._listen())
        return self

    def __exit__(self, *error: object) -> None:
        self._do(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def hold(self) -> None:
        """Let nothing through until `release`; nothing is lost."""
        self._loop.call_soon_threadsafe(self._open.clear)

    def release(self) -> None:
        """Let everything through again."""
        self._loop.call_soon_threadsafe(self._open.set)

    def swallow(self) -> None:
        """Lose everything from now on, while the connections stay."""
        self._swallows = True

    def reset(self, *ports: int) -> None:
        """Reset the connections to these ports, all if none is named."""
        chosen = ports or PORTS

        def abort() -> None:
            for port, writer in list(self._writers):
                if port in chosen:
                    writer.transport.abort()

        self._loop.call_soon_threadsafe(abort)

    def _do(self, what: Any) -> None:
        asyncio.run_coroutine_threadsafe(what, self._loop).result(30)

    async def _listen(self) -> None:
        self._open.set()
        for port in PORTS:
            self._servers.append(await asyncio.start_server(self._serve(port), self.host, port))

    async def _close(self) -> None:
        for server in self._servers:
            server.close()
        for _, writer in list(self._writers):
            writer.transport.abort()
        tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _serve(self, port: int) -> Callable[..., Any]:
        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            there, back = await asyncio.open_connection(self._controller, port)
            ends = {(port, writer), (port, back)}
            self._writers |= ends
            with suppress(asyncio.CancelledError):  # the wire closes
                await asyncio.gather(self._pass(reader, back), self._pass(there, writer))
            self._writers -= ends

        return serve

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError, OSError):
            while data := await reader.read(CHUNK):
                if self.delay:
                    await asyncio.sleep(self.delay)
                await self._open.wait()
                if self._swallows:
                    continue
                if self.garbled and self._random.random() < self.garbled:
                    i = self._random.randrange(len(data))
                    flipped = data[i] ^ 1 << self._random.randrange(8)
                    data = data[:i] + bytes([flipped]) + data[i + 1 :]
                writer.write(data)
                await writer.drain()
        writer.close()
