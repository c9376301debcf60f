"""Pose of a controller's arm, for what is simulated on its hand."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from struct import pack
from typing import Final

import numpy as np

from tjscan.core.errors import ArmNotConnected
from tjscan.core.frames import Array
from tjscan.core.pose_vector import pose_from_vector
from tjscan_loopback.ur.server import RTDE_PORT
from tjscan_loopback.ur.wire import PACKAGE_HEADER, PackageKind, RtdeRecipe

READ_LIMIT: Final = 2.0
"""Seconds that a reading may take."""

PUBLISH_HZ: Final = 125.0
POSE_RECIPE: Final = RtdeRecipe(("actual_TCP_pose",), ("VECTOR6D",))


def read_flange_pose(host: str) -> Array:
    """Read T_b_f, shape (4, 4), from a controller whose TCP is its flange, as tjscan sets it.

    What is read was published after the call: the connection is opened for it, and closed.

    Parameters
    ----------
    host : str
        Address of the controller.

    Raises
    ------
    ArmNotConnected
        If it does not answer.
    """
    try:
        with socket.create_connection((host, RTDE_PORT), timeout=READ_LIMIT) as link:
            _ask(link, PackageKind.VERSION, pack(">H", 2))
            _ask(
                link,
                PackageKind.OUTPUTS,
                pack(">d", PUBLISH_HZ) + ",".join(POSE_RECIPE.names).encode(),
            )
            _ask(link, PackageKind.START, b"")
            while True:
                kind, payload = _read_package(link)
                if kind == PackageKind.DATA:
                    ((_, values),) = POSE_RECIPE.unpack(payload[1:])
                    if not isinstance(values, Sequence):
                        raise ValueError("its pose is one number")
                    return pose_from_vector(np.array(values, dtype=float))
    except (OSError, ValueError) as error:
        raise ArmNotConnected(f"the arm at {host} does not report its pose: {error}") from None


def _ask(link: socket.socket, kind: int, payload: bytes) -> None:
    link.sendall(PACKAGE_HEADER.pack(PACKAGE_HEADER.size + len(payload), kind) + payload)
    while _read_package(link)[0] != kind:
        pass


def _read_package(link: socket.socket) -> tuple[int, bytes]:
    size, kind = PACKAGE_HEADER.unpack(_read_exactly(link, PACKAGE_HEADER.size))
    return kind, _read_exactly(link, size - PACKAGE_HEADER.size)


def _read_exactly(link: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        piece = link.recv(count - len(data))
        if not piece:
            raise OSError("it closed the connection")
        data += piece
    return data
