"""Memory of the loopback laser: GigE Vision's bootstrap registers, its own, and the description.

Addresses of the bootstrap registers as in aravis (arvgvcpprivate.h).
"""

from __future__ import annotations

from ipaddress import IPv4Address
from typing import Final

REGISTER_BYTES: Final = 0xA400
"""Bytes of registers; the description lies elsewhere."""

DESCRIPTION_ADDRESS: Final = 0xC0000
"""Where the description begins. Some clients read an address without a letter as a decimal."""

SPECIFICATION_VERSION, DEVICE_MODE = 0x0000, 0x0004
MAC_HIGH, MAC_LOW = 0x0008, 0x000C
SUPPORTED_IP, CURRENT_IP_MODE = 0x0010, 0x0014
CURRENT_IP, CURRENT_SUBNET_MASK = 0x0024, 0x0034
VENDOR_NAME, MODEL_NAME, DEVICE_VERSION, SERIAL_NUMBER = 0x0048, 0x0068, 0x0088, 0x00D8
FIRST_URL = 0x0200
INTERFACE_COUNT, STREAM_COUNT = 0x0600, 0x0904
GVCP_CAPABILITIES, HEARTBEAT_TIMEOUT = 0x0934, 0x0938
TICKS_HIGH, TICKS_LOW = 0x093C, 0x0940
TIME_CONTROL, TIME_HIGH = 0x0944, 0x0948
CONTROL_PRIVILEGE = 0x0A00
STREAM_PORT, STREAM_PACKET_SIZE = 0x0D00, 0x0D04
STREAM_PACKET_DELAY, STREAM_DESTINATION = 0x0D08, 0x0D18

LATCH_BIT, CONTROL_BITS, TEST_PACKET = 1 << 1, 0b11, 1 << 7
"""Bits of the bytes that latch the clock, ask for control, and ask for a test packet."""

WRITABLE_BOOTSTRAP: Final = frozenset(
    (
        *(HEARTBEAT_TIMEOUT, TIME_CONTROL, CONTROL_PRIVILEGE),
        *(STREAM_PORT, STREAM_PACKET_SIZE, STREAM_PACKET_DELAY, STREAM_DESTINATION),
    )
)

OWN_REGISTERS: Final = 0xA000
"""Where the sensor's own registers begin."""

DISCOVERY_SIZE: Final = 0xF8
"""Bytes at the beginning that answer a discovery."""

TICKS_PER_SECOND: Final = 1_000_000_000

_WRITE_MEMORY, _PACKET_RESEND, _LONG_SERIAL = 1 << 1, 1 << 2, 1 << 30
_SUBNET_MASK: Final = IPv4Address("255.0.0.0")


class Memory:
    """Registers and description, by address.

    Parameters
    ----------
    host : str
        Address of the sensor.
    vendor, model, version, serial : str
        Who it is.
    description : bytes
        Its GenICam description.
    """

    def __init__(
        self, host: str, *, vendor: str, model: str, version: str, serial: str, description: bytes
    ) -> None:
        self._registers = bytearray(REGISTER_BYTES)
        self._description = description
        self.set(SPECIFICATION_VERSION, 0x0001_0002)
        self.set(DEVICE_MODE, 0x8000_0001)  # big-endian, UTF-8
        address = IPv4Address(host)
        self.set(MAC_HIGH, 0x0200)  # locally administered
        self.set(MAC_LOW, int(address))
        self.set(SUPPORTED_IP, 0x7)
        self.set(CURRENT_IP_MODE, 0x5)
        self.set(CURRENT_IP, int(address))
        self.set(CURRENT_SUBNET_MASK, int(_SUBNET_MASK))
        for where, text, room in (
            (VENDOR_NAME, vendor, 32),
            (MODEL_NAME, model, 32),
            (DEVICE_VERSION, version, 32),
            (SERIAL_NUMBER, serial, 16),
            (FIRST_URL, f"Local:tjscan.xml;{DESCRIPTION_ADDRESS:X};{len(description):X}", 512),
        ):
            encoded = text.encode()[: room - 1]
            self._registers[where : where + len(encoded)] = encoded
        self.set(INTERFACE_COUNT, 1)
        self.set(STREAM_COUNT, 1)
        self.set(GVCP_CAPABILITIES, _WRITE_MEMORY | _PACKET_RESEND | _LONG_SERIAL)
        self.set(HEARTBEAT_TIMEOUT, 3000)
        self.set(TICKS_LOW, TICKS_PER_SECOND)
        self.set(STREAM_PACKET_SIZE, 1500)

    def get(self, address: int) -> int:
        """The number in a register of four bytes."""
        return int.from_bytes(self._registers[address : address + 4], "big")

    def set(self, address: int, value: int) -> None:
        """Set the number in a register of four bytes."""
        self.put(address, value.to_bytes(4, "big"))

    def put(self, address: int, data: bytes) -> None:
        """Put bytes at an address."""
        self._registers[address : address + len(data)] = data

    def read(self, address: int, count: int) -> bytes | None:
        """Bytes at an address; None if there are not as many."""
        if 0 <= address <= REGISTER_BYTES - count:
            return bytes(self._registers[address : address + count])
        start = address - DESCRIPTION_ADDRESS
        padded = self._description + bytes(-len(self._description) % 4)
        if 0 <= start <= len(padded) - count:
            return padded[start : start + count]
        return None

    def may_write(self, address: int, count: int) -> bool:
        """Whether a client may write these bytes."""
        own = address >= OWN_REGISTERS and address + count <= REGISTER_BYTES
        return own or (count == 4 and address in WRITABLE_BOOTSTRAP)
