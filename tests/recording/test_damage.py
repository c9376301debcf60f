"""Nothing of a recording is changed or missing without a word; what is left can be read."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log

from tjscan.core.errors import RecordingError
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import RecordingWriter
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import (
    MissingMessages,
    RecordingDamage,
    count_messages,
    raise_damage_error,
    read_header,
    read_job_snapshot,
    read_messages,
)
from tjscan.recording.topic import Topic


@dataclass(frozen=True)
class Count:
    number: int
    name: str = "one"


COUNT = Topic.of("/count", Count)
TEXTS = Topic.of("/text", Log)
TOPICS = (COUNT, TEXTS)
SNAPSHOT = JobSnapshot("[scan]\nstep_mm = 4.0\n")
CHUNKS = 4


def record(file: Path, first: int = 0) -> None:
    with RecordingWriter(file, TOPICS, SNAPSHOT) as recording:
        for i in range(first, first + CHUNKS):
            recording.write(10 * i, (COUNT, Count(i)), (TEXTS, Log(message=f"it is {i}")))


def content(
    directory: Path, report: Callable[[RecordingDamage], object] = raise_damage_error
) -> list[tuple[int, str]]:
    return [
        (entry.time, str(entry.message))
        for file in recording_files(directory)
        for entry in read_messages(file, TOPICS, report)
    ]


@pytest.fixture
def killed(tmp_path: Path) -> bytes:
    """A recording whose program was killed: it ends behind its last chunk."""
    with RecordingWriter(tmp_path / "killed.mcap", TOPICS, SNAPSHOT) as recording:
        for i in range(CHUNKS):
            recording.write(10 * i, (COUNT, Count(i)), (TEXTS, Log(message=f"it is {i}")))
        return (tmp_path / "killed.mcap").read_bytes()


@pytest.mark.parametrize("finished", [True, False])
def test_no_flipped_bit_changes_what_is_read_without_a_word(
    tmp_path: Path, killed: bytes, finished: bool
) -> None:
    file, dice = tmp_path / "scan.mcap", random.Random(0)
    record(file)
    data = file.read_bytes() if finished else killed
    file.write_bytes(data)
    whole = content(tmp_path)
    assert len(whole) == 2 * CHUNKS
    for place in range(0, len(data), 3):
        spoilt = bytearray(data)
        spoilt[place] ^= 1 << dice.randrange(8)
        file.write_bytes(spoilt)
        try:
            assert content(tmp_path) == whole
            assert read_job_snapshot(tmp_path) == SNAPSHOT
        except RecordingError:
            pass


def test_what_is_left_behind_a_damage_is_read_and_the_damage_reported(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    record(file)
    whole = content(tmp_path)
    data = file.read_bytes()
    for spoilt in (
        data.replace(b"it is 1", b"it is 7", 1),
        data[: data.index(b"it is 1")] + data[data.index(b"it is 2") :],
    ):
        file.write_bytes(spoilt)
        damages: list[RecordingDamage] = []
        left = content(tmp_path, damages.append)
        assert left == [entry for entry in whole if entry in left]
        assert 4 <= len(left) < len(whole)
        (damage,) = damages
        assert not damage.is_at_end
        assert "messages are missing" in damage.reason
        with pytest.raises(RecordingError, match="messages are missing"):
            content(tmp_path)


def test_a_chunk_that_is_cut_out_as_a_whole_is_missed(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    ends = []
    with RecordingWriter(file, TOPICS) as recording:
        for i in range(3):
            recording.write(i, (COUNT, Count(i)))
            ends.append(file.stat().st_size)
        data = file.read_bytes()
    file.write_bytes(data[: ends[0]] + data[ends[1] :])
    with pytest.raises(RecordingError, match="1 messages are missing before message 2"):
        content(tmp_path)


def test_chunks_that_are_lost_doubled_or_swapped_are_missed(tmp_path: Path) -> None:
    file, ends, dice = tmp_path / "scan.mcap", [], random.Random(1)
    with RecordingWriter(file, TOPICS) as recording:
        ends.append(len(file.read_bytes()))
        for i in range(9):
            recording.write(i, (COUNT, Count(i)))
            recording.sync_to_disk()
            ends.append(len(file.read_bytes()))
    data = file.read_bytes()
    chunks = [data[a:b] for a, b in pairwise(ends)]
    for _ in range(300):
        order = list(range(9))
        first, last = sorted(dice.sample(range(10), 2))
        match dice.randrange(3):
            case 0:
                del order[first:last]
            case 1:
                order[last:last] = order[first:last]
            case 2:
                order[first], order[last % 9] = order[last % 9], order[first]
        if order == list(range(9)):
            continue
        file.write_bytes(data[: ends[0]] + b"".join(chunks[i] for i in order) + data[ends[-1] :])
        with pytest.raises(RecordingError):
            content(tmp_path)


def test_a_part_goes_on_behind_a_lost_end_and_misses_what_is_lost_later(tmp_path: Path) -> None:
    file, later = tmp_path / "scan.mcap", tmp_path / "scan-2.mcap"
    ends = []
    with RecordingWriter(file, TOPICS) as recording:
        for i in range(4):
            recording.write(i, (COUNT, Count(i)))
            recording.sync_to_disk()
            ends.append(len(file.read_bytes()))
    data = file.read_bytes()
    file.write_bytes(data[: ends[2]] + data[ends[3] :])
    damages: list[RecordingDamage] = []
    content(tmp_path, damages.append)
    assert [damage.is_at_end for damage in damages] == [True]
    record(later, 3)
    content(
        tmp_path
    )  # the scan that went on took it again: a second interruption is none the worse
    file.write_bytes(data[: ends[1]] + data[ends[3] :])
    with pytest.raises(RecordingError, match="1 messages are missing"):
        content(tmp_path)


def test_a_file_that_another_tool_recovered_lacks_nothing_twice(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    record(file)
    left = MissingMessages(file, lambda damage: reasons.append(damage.reason))
    reasons: list[str] = []
    for number in (0, 1, 4):
        left.count_message(number)
    left.stated = 3  # it counted what it found
    left.end_file(None)
    assert reasons == ["2 messages are missing before message 4 of the recording"]


def test_a_damage_that_costs_no_message_is_none(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    record(file)
    whole, data = content(tmp_path), bytearray(file.read_bytes())
    index = data.index(b"\x07", data.index(b"it is 1"))  # of messages, for viewers
    assert data[index + 1 : index + 9] == (22).to_bytes(8, "little")
    data[index] = 0x17
    file.write_bytes(data)
    assert content(tmp_path) == whole


def test_messages_are_counted_through_all_parts(tmp_path: Path) -> None:
    record(tmp_path / "scan.mcap")
    record(tmp_path / "scan-2.mcap", CHUNKS)
    head = read_header(tmp_path / "scan-2.mcap")
    assert head is not None
    assert head.messages_before == count_messages(tmp_path / "scan.mcap") == 2 * CHUNKS
    assert count_messages(tmp_path / "scan-2.mcap") == 4 * CHUNKS
    assert len(content(tmp_path)) == 4 * CHUNKS


def test_a_part_that_was_cut_after_the_next_began_is_noticed(tmp_path: Path, killed: bytes) -> None:
    (tmp_path / "scan.mcap").write_bytes(killed)
    record(tmp_path / "scan-2.mcap", CHUNKS)
    assert len(content(tmp_path)) == 4 * CHUNKS
    (tmp_path / "scan.mcap").write_bytes(killed[:-100])
    with pytest.raises(RecordingError, match="2 messages are missing before message 8"):
        content(tmp_path)


def test_a_recording_without_its_head_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    record(file)
    data = file.read_bytes()
    start, end = data.index(b"\x0c", 8), data.index(b"\x0c", data.index(b"tjscan.recording"))
    file.write_bytes(data[:start] + data[end:])
    with pytest.raises(RecordingError, match="its head is missing"):
        content(tmp_path)
    file.write_bytes(data.replace(b"step_mm = 4.0", b"step_mm = 5.0"))
    with pytest.raises(RecordingError, match="checksum of its head"):
        read_job_snapshot(tmp_path)
