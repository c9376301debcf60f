"""What was recorded is read again, from a whole file and from one that was cut."""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.frames import from_euler_zyx
from tjscan.laser.profile import Profile
from tjscan.recording.messages import EVENT, PROFILE, SCHEMAS, TOPICS
from tjscan.recording.reader import read_messages, read_views
from tjscan.recording.writer import Recording
from tjscan.scanning.section import Substep, View

QUATERNION_ROUNDING = 1e-15


def view(index: int) -> View:
    rng = np.random.default_rng(index)
    x, z = rng.normal(size=(2, 640))
    x[7] = z[7] = np.nan
    return View(
        index=index,
        substep=Substep.PREDICTION,
        T_b_f=from_euler_zyx(rng.normal(size=3), rng.normal(size=3)),
        T_b_s=from_euler_zyx(rng.normal(size=3), rng.normal(size=3)),
        profile=Profile(x, z, rng.uniform(size=640), time=1.5 * index),
        time=1.5 * index,
        q=rng.normal(size=6),
    )


def record(file: Path, count: int) -> list[View]:
    views = [view(i) for i in range(count)]
    with Recording(file) as recording:
        for v in views:
            recording.view(v)
        recording.event("stop", "enough")
    return views


def assert_same(read: View, written: View) -> None:
    np.testing.assert_allclose(read.T_b_f, written.T_b_f, atol=QUATERNION_ROUNDING)
    np.testing.assert_allclose(read.T_b_s, written.T_b_s, atol=QUATERNION_ROUNDING)
    np.testing.assert_array_equal(read.profile.x_s, written.profile.x_s)
    np.testing.assert_array_equal(read.profile.z_s, written.profile.z_s)
    assert read.profile.intensity is not None
    assert written.profile.intensity is not None
    np.testing.assert_array_equal(read.profile.intensity, written.profile.intensity)
    np.testing.assert_array_equal(read.q, written.q)
    assert (read.index, read.substep, read.time) == (written.index, written.substep, written.time)


def test_views_come_back_to_the_last_bit(tmp_path: Path) -> None:
    written = record(tmp_path / "scan.mcap", 3)
    for got, put in zip(read_views(tmp_path / "scan.mcap"), written, strict=True):
        assert_same(got, put)


def test_events_come_back_and_every_message_has_time_and_frame(tmp_path: Path) -> None:
    record(tmp_path / "scan.mcap", 1)
    messages = list(read_messages(tmp_path / "scan.mcap"))
    assert messages[-1][0] == EVENT
    assert messages[-1][1]["detail"] == "enough"
    assert all({"timestamp", "frame_id"} <= message.keys() for _, message in messages)


@pytest.mark.parametrize("days", [0, 40])
def test_stamps_are_of_today_however_long_the_arm_has_been_on(tmp_path: Path, days: int) -> None:
    began = time.time()
    with Recording(tmp_path / "scan.mcap") as recording:
        for i in range(3):
            recording.view(replace(view(i), time=86400.0 * days + i))
    stamps = [
        content["timestamp"]["sec"] + 1e-9 * content["timestamp"]["nsec"]
        for topic, content in read_messages(tmp_path / "scan.mcap")
        if topic == PROFILE
    ]
    assert began - 1 < stamps[0] <= time.time() + 1
    np.testing.assert_allclose(np.diff(stamps), 1.0, atol=1e-6)


def test_a_cut_file_gives_every_whole_view_before_the_cut(tmp_path: Path) -> None:
    file, cut = tmp_path / "scan.mcap", tmp_path / "cut.mcap"
    written = record(file, 4)
    data, counts = file.read_bytes(), []
    for end in range(len(data), 200, -997):
        cut.write_bytes(data[:end])
        views = list(read_views(cut))
        counts.append(len(views))
        for got, put in zip(views, written, strict=False):
            assert_same(got, put)
    assert counts[0] == 4
    assert counts == sorted(counts, reverse=True)
    assert min(counts) == 0


def test_a_recording_never_overwrites_another(tmp_path: Path) -> None:
    record(tmp_path / "scan.mcap", 1)
    with pytest.raises(RecordingError, match="exists"), Recording(tmp_path / "scan.mcap"):
        pass


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "scan.mcap"
    file.write_bytes(b"not a recording at all")
    with pytest.raises(RecordingError, match="no recording"):
        list(read_views(file))
    with pytest.raises(ConfigurationError, match="no recording"):
        list(read_views(tmp_path / "none.mcap"))


def assert_spelt_out(schema: dict[str, Any]) -> None:
    """Every object names its properties, and every array has objects or numbers as items."""
    if schema["type"] == "object":
        assert schema["properties"]
        for inner in schema["properties"].values():
            assert_spelt_out(inner)
    elif schema["type"] == "array":
        assert schema["items"]["type"] != "array"
        assert_spelt_out(schema["items"])


def test_schemas_are_spelt_out_as_viewers_need_them() -> None:
    for properties in SCHEMAS.values():
        assert_spelt_out(json.loads(json.dumps({"type": "object", "properties": properties})))


def test_messages_hold_what_their_schemas_name(tmp_path: Path) -> None:
    record(tmp_path / "scan.mcap", 1)
    for topic, message in read_messages(tmp_path / "scan.mcap"):
        assert message.keys() == SCHEMAS[TOPICS[topic]].keys()
