"""A browser of the live page without a browser: its socket alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count

import msgspec
import viser
import zstandard
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from tjscan.live.page import HELD_BUTTON_RATE, Page

LONGEST = 30.0
"""Seconds within which a page sends what it has, on a busy machine."""

MARK = "/all/"
"""How the names of nodes begin behind which nothing is waited for."""

CAMERA = {
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, 0.0, 1.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 450,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""Any."""

_numbers = count(1)


@dataclass
class PageClient:
    """What a browser would be sent.

    Parameters
    ----------
    socket : Connection
        Of the page.
    page : Page
        Which is served by this process.
    messages : list of dict
        That came so far.
    """

    socket: Connection
    page: Page
    messages: list[dict[str, object]] = field(default_factory=list)

    def receive(self) -> int:
        """Receive all that was shown until now; gives the bytes.

        A node that nobody sees is added behind it, and waited for.
        """
        last = f"{MARK}{next(_numbers)}"
        self.page.server.scene.add_frame(last, visible=False)
        size = 0
        while last not in self.names():
            data = self.socket.recv(timeout=LONGEST)
            found = _messages(data)
            self.messages.extend(found)
            if not all(str(one.get("name", "")).startswith(MARK) for one in found):
                size += len(data)
        return size

    def hold(self, button: str) -> None:
        """Say, as a browser does while a button is held, that it is."""
        found = (one for one in self.messages if label_of(one) == button)
        order = {"type": "GuiButtonHoldMessage", "frequency": HELD_BUTTON_RATE}
        self.socket.send(msgspec.msgpack.encode({**order, "uuid": next(found)["uuid"]}))

    def look(self, **camera: float) -> None:
        """Say where it is seen from, and how: before, a browser counts as none."""
        own = {"type": "ViewerCameraMessage", **CAMERA, **camera}
        self.socket.send(msgspec.msgpack.encode(own))

    def names(self) -> set[str]:
        """Names of the picture's nodes that were sent."""
        return {str(one["name"]) for one in self.messages if "name" in one}


def label_of(message: dict[str, object]) -> object:
    """What stands on the button or field that a message is about."""
    fields = message.get("props")
    return fields.get("label") if isinstance(fields, dict) else None


def _messages(data: bytes | str) -> list[dict[str, object]]:
    """Messages of a packet of viser: sizes, then msgpack that zstandard compressed, then arrays."""
    if isinstance(data, str):
        return []
    size = int.from_bytes(data[8:16], "little")
    packed = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
    found: list[dict[str, object]] = msgspec.msgpack.decode(packed)["messages"]
    return found


@contextmanager
def page_socket(url: str) -> Iterator[Connection]:
    """Connect to the page of an address as a browser does."""
    spoken = Subprotocol(f"viser-v{viser.__version__}")
    address = url.replace("http://", "ws://").rstrip("/")
    with connect(address, subprotocols=[spoken], max_size=None, compression=None) as socket:
        yield socket


@contextmanager
def page_client(page: Page, url: str = "") -> Iterator[PageClient]:
    """Connect to a page as a browser does, by its own address or by another."""
    with page_socket(url or page.url) as socket:
        yield PageClient(socket, page)
