"""Other makes' clients, each in a process of its own, that read the loopback laser.

``python bench/_genicam_clients.py genapi`` prints how far scale and offset are from those stated,
and ``... aravis HOST FILE`` how far coordinates are from the profiles of a file, in millimetres.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.laser.profile import Profile
from tjscan_loopback.laser.contents import initial_memory

COLUMNS: Final = 640
WANTED: Final = {"A": (0.005, -163.84), "C": (0.005, 0.0)}
"""Scale and offset in millimetres, as the loopback laser states them."""


def read_with_genapi() -> float:
    """EMVA's own GenApi: the description, and scale and offset by their selector."""
    from genicam.genapi import AbstractPort, EAccessMode, NodeMap

    memory = initial_memory("127.0.0.4", "1", COLUMNS, ())
    text = memory.read(0xC0000, _description_size(memory))

    class Port(AbstractPort):  # type: ignore[misc]
        """Reads and writes the sensor's memory."""

        def read(self, address: int, length: int) -> bytes:
            return memory.read(address, length) or bytes(length)

        def write(self, address: int, value: bytes) -> None:
            memory.put(address, bytes(value))

        def is_open(self) -> bool:
            return True

        def get_access_mode(self) -> int:
            return int(EAccessMode.RW)

    nodes: Any = NodeMap()
    nodes.load_xml_from_string(text.decode() if text else "")
    port = Port()
    nodes.connect(port, "Device")
    worst = 0.0
    for axis, (scale, offset) in WANTED.items():
        nodes.Scan3dCoordinateSelector.value = f"Coordinate{axis}"
        worst = max(
            worst,
            abs(nodes.Scan3dCoordinateScale.value - scale),
            abs(nodes.Scan3dCoordinateOffset.value - offset),
        )
    if nodes.DeviceScanType.value != "Linescan3D" or nodes.Width.value != COLUMNS:
        return float("inf")
    return worst


def _description_size(memory: Any) -> int:
    url = memory.read(0x200, 64).split(b"\0")[0].decode()
    return int(url.split(";")[2], 16)


def read_with_aravis(host: str, file: Path) -> float:
    """Debian's aravis: description, control and stream, a block for each of three triggers."""
    import gi

    gi.require_version("Aravis", "0.8")
    from gi.repository import Aravis

    camera = Aravis.Camera.new(host)
    camera.gv_set_stream_options(Aravis.GvStreamOption.PACKET_SOCKET_DISABLED)
    device = camera.get_device()
    scales = {}
    for axis in WANTED:
        device.set_string_feature_value("Scan3dCoordinateSelector", f"Coordinate{axis}")
        scales[axis] = tuple(
            device.get_float_feature_value(f"Scan3dCoordinate{name}")
            for name in ("Scale", "Offset")
        )
    if any(abs(a - b) for axis in WANTED for a, b in zip(scales[axis], WANTED[axis], strict=True)):
        return float("inf")
    device.set_string_feature_value("PixelFormat", "Coord3D_AC16")
    camera.set_trigger("Software")
    stream = camera.create_stream(None, None)
    for _ in range(4):
        stream.push_buffer(Aravis.Buffer.new_allocate(camera.get_payload()))
    camera.start_acquisition()
    sent = read_profiles(file, ProfileFormat()).profiles.values()
    worst = []
    for _ in range(3):
        camera.software_trigger()
        buffer = stream.timeout_pop_buffer(1_000_000)
        if buffer is None or buffer.get_status() != Aravis.BufferStatus.SUCCESS:
            return float("inf")
        raw = np.frombuffer(buffer.get_data(), dtype="<u2").reshape(-1, 2)
        read = np.where(raw[:, 1] > 0, scales["C"][0] * raw[:, 1] + scales["C"][1], np.nan)
        worst.append(min(_apart(read, profile) for profile in sent))
        stream.push_buffer(buffer)
    camera.stop_acquisition()
    return max(worst)


def _apart(z_mm: Array, profile: Profile) -> float:
    """Largest distance in z, in millimetres; infinite where other points are missing."""
    if not np.array_equal(np.isfinite(z_mm), profile.valid):
        return float("inf")
    return float(np.nanmax(np.abs(z_mm - 1e3 * profile.z_s)))


if __name__ == "__main__":
    print(
        read_with_genapi()
        if sys.argv[1] == "genapi"
        else read_with_aravis(sys.argv[2], Path(sys.argv[3]))
    )
