"""The loopback laser, datagram by datagram, without a client library."""

from __future__ import annotations

from struct import pack, unpack, unpack_from
from xml.etree import ElementTree

import numpy as np
import pytest
from command import tjscan
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.errors import ArmNotConnected, ConfigurationError
from tjscan.laser.profile import Profile
from tjscan.laser.scan3d import COORDINATE_FORMATS, AxisScale, Scan3dScales, profile_of_row
from tjscan_loopback.laser import description as features
from tjscan_loopback.laser import memory as registers
from tjscan_loopback.laser.coding import STEP_MM, X_OFFSET_MM, encode_profile
from tjscan_loopback.laser.faults import LaserFaultOrder, parse_laser_fault
from tjscan_loopback.laser.gvcp import COMMAND_HEADER, COMMAND_KEY, REPLY_HEADER, Command, Status
from tjscan_loopback.laser.gvsp import LEADER_FIELDS, PACKET_HEADER
from tjscan_loopback.laser.sensor import LoopbackSensor

COLUMNS = 400
CLIENT, OTHER = ("127.0.0.1", 5000), ("127.0.0.1", 5001)
STREAM = 6000
EXPOSURE = 1e-3
"""Seconds, as it has it at first."""

HALF_COUNT = 0.5e-3 * STEP_MM
ROUNDING = 1e-12


def profile(moment: float = 0.0, shift: float = 0.0) -> Profile:
    x = np.linspace(-0.05, 0.05, COLUMNS)
    z = 0.24 + 0.02 * np.sin(60 * x) + shift
    z[::7] = np.nan
    return Profile(x, z)


class Client:
    """Sends commands to a sensor, at times that a test sets."""

    def __init__(self, sensor: LoopbackSensor, address: tuple[str, int] = CLIENT) -> None:
        self.sensor, self.address, self.now, self.number = sensor, address, 10.0, 0

    def ask(self, kind: int, payload: bytes = b"") -> tuple[int, bytes]:
        """Status and content of the acknowledgement."""
        self.number += 1
        datagram = COMMAND_HEADER.pack(COMMAND_KEY, 1, kind, len(payload), self.number) + payload
        reply = self.sensor.answer(datagram, self.address, self.now)
        assert reply is not None
        status, answered, length, number = REPLY_HEADER.unpack_from(reply)
        assert (answered, length, number) == (kind + 1, len(reply) - 8, self.number)
        return status, reply[8:]

    def write(self, address: int, value: int) -> int:
        return self.ask(Command.WRITEREG, pack(">II", address, value))[0]

    def read(self, address: int) -> int:
        status, content = self.ask(Command.READREG, pack(">I", address))
        assert status == Status.SUCCESS
        return int(unpack(">I", content)[0])

    def start(self) -> None:
        """Take control and begin an acquisition by software trigger."""
        for address, value in (
            (registers.CONTROL_PRIVILEGE, 2),
            (registers.STREAM_PORT, STREAM),
            (registers.STREAM_DESTINATION, 0x7F000001),
            (features.TRIGGER_MODE, 1),
            (features.ACQUISITION_START, 1),
        ):
            assert self.write(address, value) == Status.SUCCESS

    def trigger(self) -> list[bytes]:
        assert self.write(features.SOFTWARE_TRIGGER, 1) == Status.SUCCESS
        self.now += EXPOSURE
        return self.packets()

    def packets(self) -> list[bytes]:
        where, packets = self.sensor.packets_due(self.now)
        assert not packets or where == ("127.0.0.1", STREAM)
        return packets


def kinds(packets: list[bytes]) -> list[tuple[int, int]]:
    """Kind and number of each packet."""
    return [(word >> 24, word & 0xFFFFFF) for _, _, word in map(PACKET_HEADER.unpack_from, packets)]


def points_in(packets: list[bytes]) -> bytes:
    return b"".join(packet[PACKET_HEADER.size :] for packet in packets if packet[4] == 3)


@pytest.fixture
def client() -> Client:
    return Client(LoopbackSensor("127.0.0.4", "7", COLUMNS, profile, lambda: None, lambda _: None))


def bring(client: Client, line: str) -> None:
    client.sensor.schedule_fault(parse_laser_fault(line), client.now)


def test_discovery_says_who_it_is_to_anybody(client: Client) -> None:
    status, content = client.ask(Command.DISCOVERY)
    assert status == Status.SUCCESS
    assert len(content) == registers.DISCOVERY_SIZE
    assert content[registers.SERIAL_NUMBER :].rstrip(b"\0") == b"7"
    assert content[registers.CURRENT_IP : registers.CURRENT_IP + 4] == bytes([127, 0, 0, 4])


def test_only_the_program_in_control_may_write_and_anybody_may_read(client: Client) -> None:
    other = Client(client.sensor, OTHER)
    assert client.write(features.IMAGE_HEIGHT, 2) == Status.ACCESS_DENIED
    client.start()
    assert other.write(features.IMAGE_HEIGHT, 2) == Status.ACCESS_DENIED
    assert other.write(registers.CONTROL_PRIVILEGE, 2) == Status.ACCESS_DENIED
    assert other.read(features.IMAGE_HEIGHT) == 1
    assert client.write(registers.CONTROL_PRIVILEGE, 0) == Status.SUCCESS
    assert other.write(registers.CONTROL_PRIVILEGE, 2) == Status.SUCCESS


def test_control_ends_when_its_program_falls_silent(client: Client) -> None:
    client.start()
    client.now += 2.9
    client.read(features.IMAGE_HEIGHT)
    client.now += 2.9
    client.packets()
    assert client.read(registers.CONTROL_PRIVILEGE) == 2
    client.now += 3.1
    client.packets()
    assert client.read(registers.CONTROL_PRIVILEGE) == 0


def test_the_description_is_read_back_in_blocks_and_names_every_register(client: Client) -> None:
    url = client.ask(Command.READMEM, pack(">IHH", registers.FIRST_URL, 0, 64))[1][4:]
    place, address, size = url.rstrip(b"\0").decode().split(";")
    assert place.startswith("Local:")
    start, length, text = int(address, 16), int(size, 16), b""
    while len(text) < length:
        text += client.ask(Command.READMEM, pack(">IHH", start + len(text), 0, 512))[1][4:] or b"?"
        if len(text) + 512 > length:
            rest = -(-(length - len(text)) // 4) * 4
            text += client.ask(Command.READMEM, pack(">IHH", start + len(text), 0, rest))[1][4:]
    tree = ElementTree.fromstring(text[:length])
    named = [node.get("Name") for node in tree]
    names = set(named)
    assert len(names) == len(named)  # EMVA's own reader refuses a name that comes twice
    for pointer in tree.iter():
        if pointer.tag.rpartition("}")[2] in ("pValue", "pFeature", "pIndex", "pPort"):
            assert pointer.text in names
    assert {"Scan3dCoordinateScale", "DeviceScanType", "TriggerSoftware"} <= names


def test_a_trigger_brings_a_leader_the_points_and_a_trailer(client: Client) -> None:
    client.start()
    packets = client.trigger()
    size = 4 * COLUMNS
    assert kinds(packets) == [(1, 0), (3, 1), (3, 2), (2, 3)]
    leader = LEADER_FIELDS.unpack_from(packets[0], PACKET_HEADER.size)
    assert leader[2:6] == (10_000_000_000, COORDINATE_FORMATS["Coord3D_AC16"].code, COLUMNS, 1)
    assert len(points_in(packets)) == size
    assert max(map(len, packets)) + 28 <= 1500
    assert client.trigger()[0][2:4] == pack(">H", 2)


@pytest.mark.parametrize("name", COORDINATE_FORMATS)
def test_every_format_brings_the_points_back_within_half_a_count(client: Client, name: str) -> None:
    layout = COORDINATE_FORMATS[name]
    client.start()
    assert client.write(features.PIXEL_FORMAT, layout.code) == Status.SUCCESS
    axes = []
    for axis in (0, 2):
        numbers = [
            unpack(">d", client.ask(Command.READMEM, pack(">IHH", at + 8 * axis, 0, 8))[1][4:])[0]
            for at in (
                features.COORDINATE_SCALE,
                features.COORDINATE_OFFSET,
                features.AXIS_MIN,
                features.AXIS_MAX,
            )
        ]
        axes.append(AxisScale(1e-3 * numbers[0], 1e-3 * numbers[1], *numbers[2:]))
    read = profile_of_row(points_in(client.trigger()), name, Scan3dScales(axes[0], axes[1], 0))
    true = profile()
    if layout.has_x:
        both = true.valid
        np.testing.assert_array_equal(read.valid, both)
        assert np.abs(read.x_s - true.x_s)[both].max() <= HALF_COUNT + ROUNDING
        assert np.abs(read.z_s - true.z_s)[both].max() <= HALF_COUNT + ROUNDING
    else:
        slope, spacing = 0.02 * 60, 0.16 / COLUMNS
        height = np.interp(read.x_s[read.valid], true.x_s[true.valid], true.z_s[true.valid])
        assert np.abs(read.z_s[read.valid] - height).max() <= slope * spacing
        assert read.valid.sum() > COLUMNS // 3


def test_packets_that_are_asked_for_again_come_again(client: Client) -> None:
    client.start()
    packets = client.trigger()
    again = pack(">HHII", 0, 1, 1, 2)
    client.ask(Command.PACKETRESEND, again)
    assert client.packets() == packets[1:3]
    client.ask(Command.PACKETRESEND, pack(">HHII", 0, 99, 1, 1))
    (gone,) = client.packets()
    assert unpack_from(">H", gone)[0] == Status.PACKET_UNAVAILABLE


def test_it_runs_free_at_its_rate_where_no_trigger_is_set(client: Client) -> None:
    client.start()
    client.write(features.TRIGGER_MODE, 0)
    client.ask(Command.WRITEMEM, pack(">Id", features.FRAME_RATE, 50.0))
    blocks = set()
    for _ in range(100):
        client.now += 0.01
        client.read(features.IMAGE_HEIGHT)
        blocks |= {unpack_from(">H", packet, 2)[0] for packet in client.packets()}
    assert len(blocks) == pytest.approx(50, abs=2)


def test_loss_takes_packets_and_the_network_faults_do_as_they_say(client: Client) -> None:
    client.start()
    whole = client.trigger()
    bring(client, "loss 100")
    assert client.trigger() == []
    bring(client, "loss 0")
    bring(client, "duplicate")
    assert len(client.trigger()) == 2 * len(whole)
    client.sensor.faults.clear()
    bring(client, "reorder")
    assert sorted(kinds(client.trigger())) == sorted(kinds(whole))
    client.sensor.faults.clear()
    bring(client, "lose-leader")
    assert kinds(client.trigger()) == kinds(whole)[1:]
    client.sensor.faults.clear()
    bring(client, "late")
    assert client.trigger() == []
    client.now += 0.6
    assert kinds(client.packets()) == kinds(whole)


def test_a_stale_profile_bears_the_time_of_its_exposure(client: Client) -> None:
    client.start()
    first = LEADER_FIELDS.unpack_from(client.trigger()[0], PACKET_HEADER.size)[2]
    bring(client, "stale")
    client.now += 1.0
    client.read(features.IMAGE_HEIGHT)
    assert LEADER_FIELDS.unpack_from(client.trigger()[0], PACKET_HEADER.size)[2] == first


def test_a_full_buffer_gives_the_profile_before_once_more_and_then_its_own(
    client: Client,
) -> None:
    client.start()
    first = LEADER_FIELDS.unpack_from(client.trigger()[0], PACKET_HEADER.size)[2]
    bring(client, "buffered")
    client.now += 1.0
    client.read(features.IMAGE_HEIGHT)
    packets = client.trigger()
    times = [
        LEADER_FIELDS.unpack_from(one, PACKET_HEADER.size)[2] for one in packets if one[4] == 1
    ]
    assert times == [first, 11_001_000_000]


def test_without_a_pose_there_is_no_profile_and_it_goes_on() -> None:
    told: list[str] = []
    poses = iter([profile, fail, profile])
    sensor = LoopbackSensor(
        "127.0.0.4", "7", COLUMNS, lambda moment: next(poses)(), lambda: None, told.append
    )
    client = Client(sensor)
    client.start()
    assert [bool(client.trigger()) for _ in range(3)] == [True, False, True]
    assert any("no profile: the arm is gone" in line for line in told)


def fail() -> Profile:
    raise ArmNotConnected("the arm is gone")


def test_a_restart_takes_a_moment_and_brings_another_serial_number(client: Client) -> None:
    client.start()
    bring(client, "reboot")
    silent = COMMAND_HEADER.pack(COMMAND_KEY, 1, Command.DISCOVERY, 0, 1)
    assert client.sensor.answer(silent, CLIENT, client.now) is None
    client.now += 1.0
    found = client.ask(Command.DISCOVERY)[1]
    assert found[registers.SERIAL_NUMBER :].rstrip(b"\0") == b"71"
    assert client.write(features.SOFTWARE_TRIGGER, 1) == Status.ACCESS_DENIED


@given(st.binary(max_size=64), st.integers(0, 0x100), st.booleans())
def test_no_datagram_takes_it_down(content: bytes, kind: int, bare: bool) -> None:
    sensor = LoopbackSensor("127.0.0.4", "7", COLUMNS, profile, lambda: None, lambda _: None)
    client = Client(sensor)
    client.start()
    whole = COMMAND_HEADER.pack(COMMAND_KEY, 1, kind, len(content), 1) + content
    sensor.answer(content if bare else whole, CLIENT, 10.0)
    sensor.packets_due(10.0)


@pytest.mark.parametrize("line", ["lost", "loss 101", "loss much", "late 3", ""])
def test_a_fault_that_there_is_not_is_refused(line: str) -> None:
    with pytest.raises(ConfigurationError):
        parse_laser_fault(line)


def test_every_fault_can_be_named() -> None:
    assert [parse_laser_fault(word).fault for word in LaserFaultOrder] == list(LaserFaultOrder)


def test_numbers_beyond_what_the_format_holds_are_missing_points() -> None:
    far = Profile(np.array([0.0, 0.2, np.nan]), np.array([0.4, 0.2, np.nan]))
    raw = np.frombuffer(
        encode_profile(far, COORDINATE_FORMATS["Coord3D_AC16"]), dtype="<u2"
    ).reshape(-1, 2)
    assert (raw[:, 1] == 0).all()
    assert X_OFFSET_MM == -0.5 * 65_536 * STEP_MM


def test_it_is_for_this_machine_alone_and_needs_profiles(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert tjscan("laser-loopback", "--host", "192.168.0.4") == 2
    assert "this machine alone" in capsys.readouterr().err
    assert tjscan("laser-loopback") == 2
    assert "either a job" in capsys.readouterr().err
