"""The loopback laser without its sockets: commands in, acknowledgements and packets out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from struct import Struct, error, pack, unpack_from
from typing import Final

import numpy as np

from tjscan.core.errors import TjscanError
from tjscan.laser.profile import Profile
from tjscan_loopback.laser import description as features
from tjscan_loopback.laser import memory as registers
from tjscan_loopback.laser.coding import encode_profile
from tjscan_loopback.laser.contents import format_of, initial_memory, rows_of, state_scales
from tjscan_loopback.laser.faults import LaserFaultOrder, OrderedLaserFault
from tjscan_loopback.laser.gvcp import (
    MOST_MEMORY,
    Command,
    GvcpCommand,
    Status,
    acknowledge,
    parse_command,
)
from tjscan_loopback.laser.gvsp import StreamBlock, pack_block
from tjscan_loopback.laser.outgoing import OutgoingPackets

Address = tuple[str, int]

STALE_AGE: Final = 1.0
"""Seconds between the exposure of a stale profile and its trigger."""

REBOOT_DURATION: Final = 0.5
"""Seconds for which a sensor that restarts answers no one."""

POSE_LOOK_PERIOD: Final = 1e-3
"""Seconds between looks whether it is known where the sensor was."""

LARGEST_DELAY: Final = 0.1
"""Seconds by which exposures may be late before they are left out."""

NEW_OFFSET_Z: Final = 1e-3
"""Metres of z at raw number 0, where the offset changes."""

COARSE_TICKS: Final = 10_000_000
"""Ticks by which a coarse clock goes on at a time."""

_OTHER_CONTROLLER: Final = ("127.255.255.254", 1)
"""Address of another program that controls the sensor."""

_DESCRIPTION_FAULTS: Final = (
    LaserFaultOrder.UNIT_PIXEL,
    LaserFaultOrder.MISSING_FEATURES,
    LaserFaultOrder.NO_CLOCK,
    LaserFaultOrder.NO_TRIGGER,
    LaserFaultOrder.CLEAR,
)
"""Faults that change what the memory holds."""

_REGISTER_FORMAT: Final = Struct(">I")
_MONO8_CODE: Final = 0x01080001


@dataclass
class LoopbackSensor:
    """A GigE Vision line laser.

    Parameters
    ----------
    host : str
        Its address.
    serial : str
        Its serial number.
    columns : int
        Points of a profile.
    expose : callable
        Takes a profile, of as many points, as it is at a moment of `time.monotonic`; none until
        that is known.
    begin : callable
        Is called whenever acquisition starts.
    report_line : callable
        Receives a line when a program takes control or gives it back.
    clock : tuple of float
        By how much its clock is ahead of this machine's, seconds, and how fast it runs, ppm.
    """

    host: str
    serial: str
    columns: int
    expose: Callable[[float], Profile | None]
    begin: Callable[[], None]
    report_line: Callable[[str], None]
    clock: tuple[float, float] = (0.0, 0.0)
    faults: dict[LaserFaultOrder, OrderedLaserFault] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self._packets = OutgoingPackets(self.faults)
        self._off_until = 0.0
        self._controller: Address | None = None
        self._heard = self._next_exposure = 0.0
        self._exposing: deque[float] = deque()
        self._acquiring = False
        self._block = 0
        self._before: tuple[int, bytes] | None = None
        self._memory = initial_memory(self.host, self.serial, self.columns, self.faults)

    def schedule_fault(self, order: OrderedLaserFault, now: float) -> None:
        """Bring a fault, or clear them all; only a new serial number stays."""
        if order.fault is LaserFaultOrder.CLEAR:
            self.faults.clear()
            self._release()
        elif order.fault is LaserFaultOrder.REBOOT:
            self.serial += "1"
            self._off_until = now + REBOOT_DURATION
            self._release()
        else:
            self.faults[order.fault] = order
        if order.fault is LaserFaultOrder.TAKEN:
            self._controller, self._acquiring = _OTHER_CONTROLLER, False
        if order.fault is LaserFaultOrder.NEW_OFFSET:
            self._memory.put(features.COORDINATE_OFFSET + 16, pack(">d", 1e3 * NEW_OFFSET_Z))
        if order.fault is LaserFaultOrder.NEW_EXPOSURE:
            self._memory.put(features.EXPOSURE_TIME, pack(">d", 2 * 1e6 * self._exposure))
        if order.fault in (*_DESCRIPTION_FAULTS, LaserFaultOrder.REBOOT):
            self._memory = initial_memory(self.host, self.serial, self.columns, self.faults)

    def answer(self, datagram: bytes, client: Address, now: float) -> bytes | None:
        """Answer a datagram on the control port; None if nothing is to be answered."""
        command = parse_command(datagram)
        if command is None or self._is_dead(now):
            return None
        if client == self._controller:
            self._heard = now
        try:
            reply = self._obey(command, client, now)
        except error:  # a payload too short for its kind
            reply = acknowledge(command, status=Status.INVALID_PARAMETER)
        return reply if command.acknowledged else None

    def packets_due(self, now: float) -> tuple[Address, list[bytes]]:
        """Where the stream goes, and the packets to send there now."""
        if self._controller not in (None, _OTHER_CONTROLLER):
            patience = 1e-3 * self._memory.get(registers.HEARTBEAT_TIMEOUT)
            if now - self._heard > patience:
                self.report_line("control lost: no heartbeat")
                self._release()
        if self._runs_free and now >= self._next_exposure:
            self._exposing.append(self._next_exposure)
            rate = max(self._number(features.FRAME_RATE), 1.0)
            self._next_exposure = max(self._next_exposure + 1 / rate, now - LARGEST_DELAY)
        if self._exposing and self._expose(self._exposing[0], now):
            self._exposing.popleft()  # one at a time: no sensor catches up in a burst
        due = self._packets.take_due(now)
        port = self._memory.get(registers.STREAM_PORT) & 0xFFFF
        host = ".".join(
            map(str, _REGISTER_FORMAT.pack(self._memory.get(registers.STREAM_DESTINATION)))
        )
        return (host, port), [] if self._is_dead(now) or not port else due

    def seconds_to_next(self, now: float) -> float | None:
        """Seconds until there is something to send; None if nothing is planned."""
        next_due = self._packets.next_due
        times = [] if next_due is None else [next_due]
        if self._runs_free:
            times.append(self._next_exposure)
        if self._exposing:
            times.append(max(self._exposing[0] + self._exposure, now + POSE_LOOK_PERIOD))
        return max(min(times) - now, 0.0) if times else None

    @property
    def _exposure(self) -> float:
        """Seconds."""
        return 1e-6 * self._number(features.EXPOSURE_TIME)

    def _number(self, address: int) -> float:
        (number,) = unpack_from(">d", self._memory.read(address, 8) or bytes(8))
        return float(number)

    @property
    def _runs_free(self) -> bool:
        return self._acquiring and not self._memory.get(features.TRIGGER_MODE)

    def _is_dead(self, now: float) -> bool:
        return LaserFaultOrder.SILENT in self.faults or now < self._off_until

    def _obey(self, command: GvcpCommand, client: Address, now: float) -> bytes:
        payload = command.payload
        match command.kind:
            case Command.DISCOVERY:
                found = self._memory.read(0, registers.DISCOVERY_SIZE)
                return acknowledge(command, found or b"")
            case Command.READREG:
                values = [
                    self._memory.read(at, 4) for (at,) in _REGISTER_FORMAT.iter_unpack(payload)
                ]
                known = [value for value in values if value is not None]
                if not known or len(known) != len(values):
                    return acknowledge(command, status=Status.INVALID_ADDRESS)
                return acknowledge(command, b"".join(known))
            case Command.READMEM:
                address, count = unpack_from(">IxxH", payload)
                data = self._memory.read(address, count) if count <= MOST_MEMORY else None
                if data is None:
                    return acknowledge(command, status=Status.INVALID_ADDRESS)
                return acknowledge(command, payload[:4] + data)
            case Command.WRITEREG:
                done = 0
                for address, value in Struct(">I4s").iter_unpack(payload):
                    status = self._write(address, value, client, now)
                    if status is not Status.SUCCESS:
                        return acknowledge(command, pack(">xxH", done), status)
                    done += 1
                return acknowledge(command, pack(">xxH", done))
            case Command.WRITEMEM:
                (address,) = unpack_from(">I", payload)
                status = self._write(address, payload[4:], client, now)
                return acknowledge(command, pack(">xxH", len(payload) - 4), status)
            case Command.PACKETRESEND:
                _, block, first, last = unpack_from(">HHII", payload)
                self._packets.queue_again(block, first & 0xFFFFFF, last & 0xFFFFFF, now)
                return acknowledge(command)
        return acknowledge(command, status=Status.NOT_IMPLEMENTED)

    def _write(self, address: int, data: bytes, client: Address, now: float) -> Status:
        if not data or not self._memory.may_write(address, len(data)):
            known = self._memory.read(address, len(data)) is not None
            return Status.WRITE_PROTECTED if known else Status.INVALID_ADDRESS
        if self._controller not in (None, client):
            return Status.ACCESS_DENIED
        if address == registers.CONTROL_PRIVILEGE:
            self._change_control(data, client, now)
            return Status.SUCCESS
        if self._controller is None:
            return Status.ACCESS_DENIED
        if address == registers.TIME_CONTROL:
            if data[-1] & registers.LATCH_BIT:
                self._memory.put(registers.TIME_HIGH, pack(">Q", self._ticks(now)))
            return Status.SUCCESS
        self._memory.put(address, data)
        self._act_on_feature(address, data, now)
        return Status.SUCCESS

    def _act_on_feature(self, address: int, data: bytes, now: float) -> None:
        if address == registers.STREAM_PACKET_SIZE and data[0] & registers.TEST_PACKET:
            self._packets.queue_packet(bytes(max(self._packet_size - 28, 8)), now)
        elif address == features.ACQUISITION_START:
            self._acquiring, self._next_exposure = True, now
            self._block, self._before = 0, None
            self._packets.clear()
            self._exposing.clear()
            self.begin()
        elif address == features.ACQUISITION_STOP:
            self._acquiring = False
            self._packets.clear()
            self._exposing.clear()
        elif address == features.SOFTWARE_TRIGGER:
            if self._acquiring and not self._runs_free:
                self._exposing.append(now)
        elif address in (features.PIXEL_FORMAT, features.IMAGE_HEIGHT):
            state_scales(self._memory)

    def _change_control(self, data: bytes, client: Address, now: float) -> None:
        wanted = bool(data[-1] & registers.CONTROL_BITS)
        if wanted and self._controller is None:
            self.report_line(f"control taken by {client[0]}:{client[1]}")
            self._controller, self._heard = client, now
            self._memory.put(registers.CONTROL_PRIVILEGE, data)
        elif not wanted:
            self._release()

    def _release(self) -> None:
        if self._controller is not None:
            self.report_line("control given back")
        self._controller, self._acquiring = None, False
        self._packets.clear()
        self._exposing.clear()
        self._memory.set(registers.CONTROL_PRIVILEGE, 0)
        self._memory.set(registers.STREAM_PORT, 0)

    @property
    def _packet_size(self) -> int:
        return self._memory.get(registers.STREAM_PACKET_SIZE) & 0xFFFF

    def _expose(self, begin: float, now: float) -> bool:
        """Take and send a profile whose exposure begins at a moment; whether that is done."""
        if now < begin + self._exposure:
            return False
        layout, rows = format_of(self._memory), rows_of(self._memory)
        try:
            profile = self.expose(begin + self._exposure / 2)
        except TjscanError as error:  # the arm that carries it does not report its pose
            self.report_line(f"no profile: {error}")
            return True
        if profile is None:
            return False
        if LaserFaultOrder.ALL_INVALID in self.faults:
            nothing = np.full(len(profile), np.nan)
            profile = Profile(nothing, nothing)
        if LaserFaultOrder.NEW_OFFSET in self.faults:
            profile = Profile(profile.x_s, profile.z_s - NEW_OFFSET_Z)
        before, exposed = self._before, (self._ticks(begin), rows * encode_profile(profile, layout))
        if LaserFaultOrder.STALE in self.faults:
            before = before or (self._ticks(begin - STALE_AGE), exposed[1])
            self._send(*before, now)
        else:
            if LaserFaultOrder.BUFFERED in self.faults and before is not None:
                self._send(*before, now)
            self._send(*exposed, now)
            before = exposed
        self._before = before
        return True

    def _send(self, time: int, data: bytes, now: float) -> None:
        layout, rows = format_of(self._memory), rows_of(self._memory)
        wrong = LaserFaultOrder.WRONG_FORMAT in self.faults
        columns = self.columns
        if LaserFaultOrder.NARROW in self.faults:
            columns //= 2
            data = data[: layout.point_size * columns * rows]
        self._block = self._block % 0xFFFF + 1
        time = 0 if LaserFaultOrder.NO_STAMP in self.faults else time
        numbers, chunks = features.CHUNK_NUMBERS, []
        if self._memory.get(features.CHUNK_MODE):
            chunks = [
                (numbers["FrameID"], pack(">Q", self._block)),
                (numbers["Timestamp"], pack(">Q", time)),
                (numbers["EncoderValue"], pack(">Q", self._block)),
            ]
        block = StreamBlock(
            self._block,
            time,
            _MONO8_CODE if wrong else layout.code,
            columns,
            rows,
            data,
            chunks,
        )
        self._packets.queue_block(block.number, pack_block(block, self._packet_size), now)

    def _ticks(self, now: float) -> int:
        """What its clock shows."""
        ahead, ppm = self.clock
        if LaserFaultOrder.WRONG_CLOCK in self.faults:
            ppm = -9e5
        ticks = round(registers.TICKS_PER_SECOND * (ahead + (1 + 1e-6 * ppm) * now))
        return ticks - ticks % (COARSE_TICKS if LaserFaultOrder.COARSE_CLOCK in self.faults else 1)
