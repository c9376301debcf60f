"""A browser of the live page without a browser: its socket alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import msgspec
import viser
import zstandard
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

QUIET = 0.3
"""Seconds without a message after which everything has come."""


@dataclass
class PageClient:
    """What a browser would be sent.

    Parameters
    ----------
    socket : Connection
        Of the page.
    messages : list of dict
        That came so far.
    """

    socket: Connection
    messages: list[dict[str, object]] = field(default_factory=list)

    def receive(self, quiet: float = QUIET) -> int:
        """Receive until nothing more comes; gives the bytes."""
        count = 0
        while True:
            try:
                data = self.socket.recv(timeout=quiet)
            except TimeoutError:
                return count
            count += len(data)
            self.messages.extend(_messages(data))

    def names(self) -> set[str]:
        """Names of the picture's nodes that were sent."""
        return {str(one["name"]) for one in self.messages if "name" in one}


def _messages(data: bytes | str) -> list[dict[str, object]]:
    """Messages of a packet of viser: sizes, then msgpack that zstandard compressed, then arrays."""
    if isinstance(data, str):
        return []
    size = int.from_bytes(data[8:16], "little")
    packed = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
    found: list[dict[str, object]] = msgspec.msgpack.decode(packed)["messages"]
    return found


@contextmanager
def page_client(url: str) -> Iterator[PageClient]:
    """Connect to a page as a browser does."""
    spoken = Subprotocol(f"viser-v{viser.__version__}")
    address = url.replace("http://", "ws://").rstrip("/")
    with connect(address, subprotocols=[spoken], max_size=None, compression=None) as socket:
        yield PageClient(socket)
