"""Poses of a controller's arm, for what is simulated on its hand."""

from __future__ import annotations

import socket
import time
from collections import deque
from math import inf
from struct import Struct, pack
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.errors import ArmNotConnected
from tjscan.core.frames import Array
from tjscan.core.pose_vector import pose_from_vector
from tjscan_loopback.ur.server import RTDE_PORT
from tjscan_loopback.ur.wire import PACKAGE_HEADER, PackageKind

READ_LIMIT: Final = 2.0
"""Seconds that an answer, or a pose, may take."""

PUBLISH_HZ: Final = 500.0
REPORT_NAMES: Final = "timestamp,actual_TCP_pose"
REPORT_LAYOUT: Final = Struct(">B7d")

REMEMBERED_REPORTS: Final = 1000
"""Reports that are kept."""

LARGEST_DRIFT: Final = 1e-6
"""Seconds that the controller's clock falls behind this machine's from report to report at most.
Which of them is how far ahead is told by the quickest reports: the others were longer on their
way."""


class FlangePoses:
    """T_b_f at any moment, from a controller whose TCP is its flange, as tjscan sets it.

    Parameters
    ----------
    host : str
        Address of the controller.
    """

    def __init__(self, host: str) -> None:
        self._host = host
        self._link: socket.socket | None = None

    def at(self, moment: float) -> Array | None:
        """Pose at a moment of `time.monotonic`, shape (4, 4); None until it is known.

        Raises
        ------
        ArmNotConnected
            If the controller does not answer, or has reported nothing for too long.
        """
        try:
            if self._link is None:
                self._connect()
            self._read_reports()
            if time.monotonic() > max(self._heard, moment) + READ_LIMIT:
                raise OSError("it reports nothing")
        except (OSError, ValueError) as error:
            self.close()
            raise ArmNotConnected(
                f"the arm at {self._host} does not report its pose: {error}"
            ) from None
        reports = self._reports
        if not reports:
            return None
        wanted, later = moment - self._ahead, len(reports) - 1
        if reports[later][0] < wanted:
            return None
        while later > 1 and reports[later - 1][0] >= wanted:
            later -= 1
        (begin, first), (end, last) = reports[max(later - 1, 0)], reports[later]
        return _between(first, last, 1.0 if later == 0 else (wanted - begin) / (end - begin))

    def close(self) -> None:
        """Close the link; the next pose opens it again."""
        if self._link is not None:
            self._link.close()
        self._link = None

    def _connect(self) -> None:
        self._link = socket.create_connection((self._host, RTDE_PORT), timeout=READ_LIMIT)
        self._data, self._heard = b"", time.monotonic()
        self._reports: deque[tuple[float, Array]] = deque(maxlen=REMEMBERED_REPORTS)
        self._ahead = inf  # by how much this machine's clock is, of the controller's
        for kind, payload in (
            (PackageKind.VERSION, pack(">H", 2)),
            (PackageKind.OUTPUTS, pack(">d", PUBLISH_HZ) + REPORT_NAMES.encode()),
            (PackageKind.START, b""),
        ):
            size = PACKAGE_HEADER.size + len(payload)
            self._link.sendall(PACKAGE_HEADER.pack(size, kind) + payload)
        self._link.setblocking(False)

    def _read_reports(self) -> None:
        """Take the reports that have come."""
        try:
            while self._link is not None:
                piece = self._link.recv(1 << 16)
                if not piece:
                    raise OSError("it closed the connection")
                self._data += piece
        except BlockingIOError:
            pass
        now = time.monotonic()
        while len(self._data) >= PACKAGE_HEADER.size:
            size, kind = PACKAGE_HEADER.unpack_from(self._data)
            if len(self._data) < max(size, PACKAGE_HEADER.size):
                return
            package, self._data = self._data[PACKAGE_HEADER.size : size], self._data[size:]
            if kind == PackageKind.DATA:
                _, at, *vector = REPORT_LAYOUT.unpack(package)
                self._reports.append((at, pose_from_vector(np.array(vector))))
                self._ahead = min(self._ahead + LARGEST_DRIFT, now - at)
                self._heard = now


def _between(first: Array, last: Array, share: float) -> Array:
    """Pose on the way from one pose to another."""
    T = first.copy()
    T[:3, 3] += share * (last[:3, 3] - first[:3, 3])
    turn = Rotation.from_matrix(first[:3, :3].T @ last[:3, :3]).as_rotvec()
    T[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
    return T
