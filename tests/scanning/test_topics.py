"""What a scan records is read again to the last bit, and viewers read it without this program."""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from cells import PAPER
from command import tjscan
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from tjscan.core.errors import RecordingError
from tjscan.core.frames import pose_from_euler_zyx
from tjscan.laser.profile import Profile
from tjscan.recording.foxglove import PROFILE_TOPIC
from tjscan.recording.journal import RecordingWriter, RunEvent
from tjscan.scanning.recording import (
    SCAN_TOPICS,
    ScanRecordingWriter,
    read_recorded_scan,
    read_views,
)
from tjscan.scanning.section import ProfileView, Substep

ROUNDING = 1e-12
"""Of a pose that is written as a quaternion, and multiplied a few times."""

T_F_S = pose_from_euler_zyx(np.array([0.3, 0.2, 0.1]), np.array([0.01, 0.02, 0.12]))

MESSAGES = {
    kind.DESCRIPTOR.full_name: kind
    for kind in (FrameTransforms, JointStates, Log, PointCloud, SceneUpdate)
}


def view(index: int, intensity: bool = True) -> ProfileView:
    rng = np.random.default_rng(index)
    x, z = rng.normal(size=(2, 640))
    x[7] = z[7] = np.nan
    T_b_f = pose_from_euler_zyx(rng.normal(size=3), rng.normal(size=3))
    return ProfileView(
        index=index,
        substep=Substep.PREDICTION,
        T_b_f=T_b_f,
        T_b_s=T_b_f @ T_F_S,
        profile=Profile(x, z, rng.uniform(size=640) if intensity else None, time=1.5 * index),
        time=1.5 * index,
        q=rng.normal(size=6),
        sway=rng.uniform(size=2) if index % 2 else None,
    )


def record(file: Path, count: int) -> list[ProfileView]:
    views = [view(i, intensity=i % 2 == 0) for i in range(count)]
    with ScanRecordingWriter(file) as journal:
        for v in views:
            journal.record(v)
        journal.record(RunEvent("stop", "enough"))
    return views


def assert_same(read: ProfileView, written: ProfileView) -> None:
    assert (read.sway is None) == (written.sway is None)
    for name in ("T_b_f", "T_b_s", "q", *(["sway"] if written.sway is not None else [])):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))
    for name in ("x_s", "z_s"):
        np.testing.assert_array_equal(getattr(read.profile, name), getattr(written.profile, name))
    if written.profile.intensity is None:
        assert read.profile.intensity is None
    else:
        assert read.profile.intensity is not None
        np.testing.assert_array_equal(read.profile.intensity, written.profile.intensity)
    assert (read.index, read.substep, read.time) == (written.index, written.substep, written.time)
    assert read.profile.time == written.profile.time


def test_views_come_back_to_the_last_bit(tmp_path: Path) -> None:
    written = record(tmp_path / "scan.mcap", 3)
    for got, put in zip(read_views(tmp_path / "scan.mcap"), written, strict=True):
        assert_same(got, put)


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


@pytest.mark.parametrize("days", [0, 40])
def test_stamps_are_of_today_however_long_the_arm_has_been_on(tmp_path: Path, days: int) -> None:
    began = time.time()
    with ScanRecordingWriter(tmp_path / "scan.mcap") as journal:
        for i in range(3):
            journal.record(replace(view(i), time=86400.0 * days + i))
    stamps = [1e-9 * log_time for topic, _, log_time, _ in contents(tmp_path) if topic == "/view"]
    assert began - 1 < stamps[0] <= time.time() + 1
    np.testing.assert_allclose(np.diff(stamps), 1.0, atol=1e-6)


def test_a_profile_without_its_view_is_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "scan.mcap", SCAN_TOPICS) as recording:
        recording.write(0, (PROFILE_TOPIC, PointCloud()))
    with pytest.raises(RecordingError, match="no message on /view before it"):
        read_recorded_scan(tmp_path)


def contents(run: Path) -> list[tuple[str, str, int, Any]]:
    """Topic, schema, time and message of all, decoded by Foxglove's classes and by JSON alone."""
    with (run / "scan.mcap").open("rb") as stream:
        found = []
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            kind = MESSAGES.get(schema.name)
            assert (schema.encoding == "protobuf") == (kind is not None)
            content = json.loads(message.data) if kind is None else kind.FromString(message.data)
            found.append((channel.topic, schema.name, message.log_time, content))
        return found


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("runs") / "run"
    assert tjscan("scan", PAPER, "--out", directory, "--scan.sections", 4) == 0
    return directory


def test_foxglove_names_carry_what_foxglove_defines_and_nothing_else(run: Path) -> None:
    for _, schema, log_time, message in contents(run):
        if schema.startswith("tjscan."):
            continue
        assert schema in MESSAGES
        size = message.ByteSize()
        message.DiscardUnknownFields()
        assert message.ByteSize() == size
        if hasattr(message, "timestamp"):
            assert message.timestamp.ToNanoseconds() == log_time


def test_own_messages_hold_what_their_schemas_name(run: Path) -> None:
    fields = {
        topic.name: json.loads(topic.schema_bytes)["properties"].keys()
        for topic in SCAN_TOPICS
        if topic.message_encoding == "json"
    }
    for topic, schema, _, message in contents(run):
        if schema.startswith("tjscan."):
            assert message.keys() == fields[topic]


def test_a_viewer_finds_the_arm_the_laser_and_the_groove_where_they_were(run: Path) -> None:
    scan = read_recorded_scan(run)
    at: dict[str, Any] = {}
    sections = iter(scan.sections.values())
    for topic, _, _, message in contents(run):
        if topic == "/tf":
            for one in message.transforms:
                T = np.eye(4)
                turn = one.rotation
                T[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
                T[:3, 3] = one.translation.x, one.translation.y, one.translation.z
                parent = at.get(one.parent_frame_id, np.eye(4))
                at[one.child_frame_id] = parent @ T
            if message.transforms[-1].child_frame_id == "g":
                section = next(sections)
                T_b_s = section.view.T_b_s
                np.testing.assert_allclose(at["f"], section.view.T_b_f, atol=ROUNDING)
                np.testing.assert_allclose(at["s"], T_b_s, atol=ROUNDING)
                np.testing.assert_allclose(at["t"], T_b_s @ section.T_s_t, atol=ROUNDING)
                np.testing.assert_allclose(at["g"], section.T_b_g, atol=ROUNDING)
    assert next(sections, None) is None
    assert at.keys() == {"f", "s", "t", "g", "j", "base_link"}


def test_a_viewer_can_move_the_arm_by_its_urdf(run: Path) -> None:
    with (run / "scan.mcap").open("rb") as stream:
        (urdf,) = make_reader(stream).iter_attachments()
    root = ElementTree.fromstring(urdf.data)
    moving = [one.get("name") for one in root.iter("joint") if one.get("type") == "revolute"]
    states = next(m for topic, _, _, m in contents(run) if topic == "/joints")
    assert [joint.name for joint in states.joints] == moving
    fixed = next(m for topic, _, _, m in contents(run) if topic == "/tf")
    assert root.find("link[@name='base_link']") is not None
    assert {one.child_frame_id for one in fixed.transforms} == {"base_link", "j"}


def test_a_viewer_finds_points_scene_joints_and_log(run: Path) -> None:
    scan, found = read_recorded_scan(run), contents(run)
    clouds = [m for topic, _, _, m in found if topic == "/profile"]
    joints = [m for topic, _, _, m in found if topic == "/joints"]
    assert len(clouds) == len(joints) == len(scan.views)
    for cloud, states, taken in zip(clouds, joints, scan.views, strict=True):
        assert cloud.frame_id == "s"
        table = np.frombuffer(cloud.data).reshape(-1, cloud.point_stride // 8)
        names = [field.name for field in cloud.fields]
        np.testing.assert_array_equal(table[:, names.index("x")], taken.profile.x_s)
        np.testing.assert_array_equal(table[:, names.index("z")], taken.profile.z_s)
        np.testing.assert_array_equal([joint.position for joint in states.joints], taken.q)
    scenes = [m for topic, _, _, m in found if topic == "/scene"]
    assert len(scenes) == len(scan.sections)
    for scene, section in zip(scenes, scan.sections.values(), strict=True):
        (entity,) = scene.entities
        assert entity.frame_id == "b"
        drawn = [(p.x, p.y, p.z) for p in entity.lines[0].points]
        np.testing.assert_array_equal(drawn, section.points_b)
    assert [len(scene.entities[0].triangles) for scene in scenes] == [0, 1, 1, 1]
    assert all(len(scene.entities[0].triangles[0].points) == 24 for scene in scenes[1:])
    logs = [m for topic, _, _, m in found if topic == "/log"]
    assert [(m.name, m.message) for m in logs] == [(e.name, e.detail) for e in scan.events]
    assert logs[-1].name == "stop"
