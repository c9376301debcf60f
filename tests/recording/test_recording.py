"""Messages on topics are read again, from a whole file and from one that was cut."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.writer import CompressionType, Writer
from raw_topics import raw_topic

from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.recording.header import FORMAT_VERSION, JobSnapshot, RecordingHeader
from tjscan.recording.journal import RecordingWriter
from tjscan.recording.parts import next_recording_file, recording_files
from tjscan.recording.reader import MAX_RECORD_BYTES, read_header, read_job_snapshot, read_messages
from tjscan.recording.topic import Topic


@dataclass(frozen=True)
class Count:
    number: int
    name: str = "one"


COUNT = Topic.of("/count", Count)
TEXTS = Topic.of("/text", Log)
TOPICS = (COUNT, TEXTS)


def record(file: Path, count: int, **options: Any) -> None:
    with RecordingWriter(file, TOPICS, **options) as recording:
        for i in range(count):
            recording.write(10 * i, (COUNT, Count(i)), (TEXTS, Log(message=f"it is {i}")))
            recording.sync_to_disk()


def numbers(file: Path) -> list[int]:
    return [entry.message.number for entry in read_messages(file, [COUNT])]


def test_messages_come_back_with_their_topics_and_times_in_order(tmp_path: Path) -> None:
    record(tmp_path / "scan.mcap", 3)
    entries = list(read_messages(tmp_path / "scan.mcap", TOPICS))
    assert [entry.topic for entry in entries] == 3 * [COUNT, TEXTS]
    assert [entry.time for entry in entries] == [0, 0, 10, 10, 20, 20]
    assert [entry.message.number for entry in entries[::2]] == [0, 1, 2]
    assert entries[-1].message.message == "it is 2"


def test_what_was_written_together_is_there_together_wherever_the_file_is_cut(
    tmp_path: Path,
) -> None:
    file, cut = tmp_path / "scan.mcap", tmp_path / "cut.mcap"
    record(file, 3)
    data, counts = file.read_bytes(), []
    for end in (*range(len(data), 0, -3), 0):
        cut.write_bytes(data[:end])
        entries = list(read_messages(cut, TOPICS))
        assert len(entries) % 2 == 0
        counts.append(len(entries) // 2)
    assert counts == sorted(counts, reverse=True)
    assert (counts[0], counts[-1]) == (3, 0)


def test_a_message_is_on_the_disk_before_the_next_is_written(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    with RecordingWriter(file, TOPICS) as recording:
        for i in range(3):
            recording.write(i, (COUNT, Count(i)))
            assert numbers(file) == list(range(i + 1))


def test_topics_not_asked_for_are_passed_over(tmp_path: Path) -> None:
    record(tmp_path / "scan.mcap", 2)
    assert numbers(tmp_path / "scan.mcap") == [0, 1]


def test_a_topic_with_another_schema_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "scan.mcap", 1)
    other = raw_topic("/text", "tjscan.Text")
    with pytest.raises(RecordingError, match=r"/text holds foxglove\.Log in protobuf"):
        list(read_messages(tmp_path / "scan.mcap", [other]))


def test_a_message_that_its_topic_cannot_decode_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    bad = raw_topic("/count", "tjscan.Count")
    with RecordingWriter(file, [bad]) as recording:
        recording.write(0, (bad, {"number": "many"}))
    with pytest.raises(RecordingError, match="/count can't be read"):
        numbers(file)


def test_a_flipped_bit_in_a_chunk_is_found(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    record(file, 1)
    file.write_bytes(file.read_bytes().replace(b"it is 0", b"it is 1", 1))
    with pytest.raises(RecordingError, match="damaged"):
        list(read_messages(file, TOPICS))


def test_a_recording_never_overwrites_another(tmp_path: Path) -> None:
    record(tmp_path / "scan.mcap", 1)
    with (
        pytest.raises(RecordingError, match="exists"),
        RecordingWriter(tmp_path / "scan.mcap", TOPICS),
    ):
        pass


def test_parts_follow_one_another(tmp_path: Path) -> None:
    names = []
    for _ in range(3):
        names.append(next_recording_file(tmp_path, "measured").name)
        record(tmp_path / names[-1], 1)
    assert names == ["measured.mcap", "measured-2.mcap", "measured-3.mcap"]
    assert [file.name for file in recording_files(tmp_path, "measured")] == names


def test_the_head_says_what_made_it_and_from_which_job(tmp_path: Path) -> None:
    origin = JobSnapshot("[scan]\nstep_mm = 4.0\n", arm="0" * 64)
    record(tmp_path / "scan.mcap", 1, origin=origin, attachments={"arm.urdf": b"<robot/>"})
    head = read_header(tmp_path / "scan.mcap")
    assert head is not None
    assert head.format == FORMAT_VERSION
    assert head.metadata["program"] == "tjscan"
    assert read_job_snapshot(tmp_path) == origin
    assert b"<robot/>" in (tmp_path / "scan.mcap").read_bytes()


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    file.write_bytes(b"not a recording at all")
    with pytest.raises(RecordingError, match="no recording"):
        numbers(file)
    with pytest.raises(ConfigurationError, match="no recording"):
        numbers(tmp_path / "none.mcap")


def foreign(file: Path, profile: str, metadata: dict[str, str] | None = None) -> None:
    """A recording as another program, or another version, writes it."""
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start(profile=profile, library="rosbag2 0.26")
        if metadata is not None:
            writer.add_metadata(RecordingHeader.record_name, metadata)
        writer.finish()


def test_a_recording_of_another_program_is_refused_by_its_name(tmp_path: Path) -> None:
    foreign(tmp_path / "scan.mcap", "ros2")
    with pytest.raises(RecordingError, match=r"another program: rosbag2 0\.26, profile 'ros2'"):
        numbers(tmp_path / "scan.mcap")


def test_a_recording_of_a_newer_version_is_refused_by_its_name(tmp_path: Path) -> None:
    head = {"program": "tjscan", "version": "7.1", "format": str(FORMAT_VERSION + 1)}
    foreign(tmp_path / "scan.mcap", "tjscan", head)
    with pytest.raises(RecordingError, match=r"Install tjscan 7\.1 or newer"):
        numbers(tmp_path / "scan.mcap")


@pytest.mark.parametrize("number", ["2", "3"])
def test_a_format_that_was_never_released_is_refused(tmp_path: Path, number: str) -> None:
    head = {"program": "tjscan", "version": "0.1.0", "format": number}
    foreign(tmp_path / "scan.mcap", "tjscan", head)
    with pytest.raises(RecordingError, match=f"in format {number}.*before 0.1.0 can't be read"):
        numbers(tmp_path / "scan.mcap")


def test_the_first_format_that_was_never_released_is_refused_by_its_missing_head(
    tmp_path: Path,
) -> None:
    file = tmp_path / "scan.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start(profile="tjscan", library="mcap-python/1.6.0")
        writer.add_metadata(JobSnapshot.record_name, {"job": ""})
        writer.register_channel("/count", "json", writer.register_schema("tjscan.Number", "", b""))
        writer.finish()
    with pytest.raises(RecordingError, match=r"head is missing.*before 0\.1\.0 can't be read"):
        numbers(file)


def test_messages_of_another_schema_are_refused_by_its_name(tmp_path: Path) -> None:
    older = replace(COUNT, schema_name="tjscan.Number")
    with RecordingWriter(tmp_path / "scan.mcap", [older]) as recording:
        recording.write(0, (older, Count(1)))
    with pytest.raises(RecordingError, match=r"tjscan\.Number in json, not tjscan\.Count.*0\.1\.0"):
        numbers(tmp_path / "scan.mcap")


def test_a_head_that_makes_no_sense_is_refused(tmp_path: Path) -> None:
    foreign(tmp_path / "scan.mcap", "tjscan", {"format": "two"})
    with pytest.raises(RecordingError, match="damaged"):
        numbers(tmp_path / "scan.mcap")


def test_a_length_is_believed_only_as_far_as_the_file_goes(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    with RecordingWriter(file, TOPICS) as recording:
        recording.write(0, (COUNT, Count(1)))
        data = file.read_bytes()
    file.write_bytes(data + b"\x05" + (2**62).to_bytes(8, "little"))
    assert numbers(file) == [1]
    with file.open("wb") as stream:
        stream.write(data + b"\x05" + (MAX_RECORD_BYTES + 1).to_bytes(8, "little"))
        stream.truncate(2 * MAX_RECORD_BYTES)  # takes no room on the disk
    with pytest.raises(RecordingError, match="none is so long"):
        numbers(file)


def test_a_length_in_a_chunk_that_no_memory_could_hold_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    record = b"\x0b" + (2**64 - 1).to_bytes(8, "little") + b"short"
    size = len(record).to_bytes(8, "little")
    chunk = bytes(16) + size + bytes(8) + size + record
    with RecordingWriter(file, TOPICS):
        data = file.read_bytes()
    file.write_bytes(data + b"\x06" + len(chunk).to_bytes(8, "little") + chunk)
    with pytest.raises(RecordingError, match="damaged"):
        numbers(file)


def test_compressed_chunks_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    chunk = bytes(28) + (4).to_bytes(4, "little") + b"zstd" + bytes(8)
    with RecordingWriter(file, TOPICS):
        data = file.read_bytes()
    file.write_bytes(data + b"\x06" + len(chunk).to_bytes(8, "little") + chunk)
    with pytest.raises(RecordingError, match="compressed by zstd"):
        numbers(file)


def assert_spelt_out(schema: dict[str, Any]) -> None:
    """Every object names its properties, and every array has objects or numbers as items."""
    if schema["type"] == "object":
        assert schema["properties"]
        for inner in schema["properties"].values():
            assert_spelt_out(inner)
    elif schema["type"] == "array":
        assert schema["items"]["type"] != "array"
        assert_spelt_out(schema["items"])


def test_json_schemas_are_spelt_out_as_viewers_need_them() -> None:
    assert_spelt_out(json.loads(COUNT.schema_bytes))
    assert json.loads(COUNT.schema_bytes)["title"] == "tjscan.Count"
