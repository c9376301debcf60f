"""What programs of ROS 2 are given: read again by another library, it says what was measured."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import tjscan
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, pose
from tjscan.recording.ros import ROS_JOINT_TRAJECTORY, ROS_POSE_ARRAY
from tjscan.robot.kinematics import Kinematics
from tjscan.scanning.recording import read_recorded_scan

RUN = Path(__file__).parents[1] / "data" / "run-0.1.0"

READ_LATER = 1.5e-3
"""Metres: sections.csv and the recording's own sections are two readings of the same profiles."""

STORE = get_typestore(Stores.ROS2_HUMBLE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("ros") / "out"
    assert tjscan("export", RUN, "--to", "ros", "--out", out) == 0
    return out


@pytest.fixture(scope="module")
def messages(folder: Path) -> dict[str, Any]:
    with Reader(folder / "export.mcap") as reader:
        return {
            connection.topic: STORE.deserialize_cdr(data, connection.msgtype)
            for connection, _, data in reader.messages()
        }


def poses_of(message: Any) -> Array:
    rows = []
    for one in message.poses:
        at, turn = one.position, one.orientation
        rotation = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).as_matrix()
        rows.append(pose(rotation, (at.x, at.y, at.z)))
    return np.array(rows)


def plain(message: Any) -> Any:
    """A message of rosbags as the plain data of JSON."""
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, list):
        return [plain(one) for one in message]
    if hasattr(message, "__dataclass_fields__"):
        names = [name for name in message.__dataclass_fields__ if name != "__msgtype__"]
        return {name: plain(getattr(message, name)) for name in names}
    return message


def test_another_library_reads_from_mcap_what_stands_in_json(
    folder: Path, messages: dict[str, Any]
) -> None:
    assert set(messages) == {"/sections", "/flange", "/joint_trajectory"}
    for topic, message in messages.items():
        assert plain(message) == json.loads((folder / f"{topic[1:]}.json").read_bytes())


def test_another_library_opens_the_folder_as_a_bag(folder: Path) -> None:
    with Reader(folder) as bag:
        assert bag.message_count == 3
        topics = {one.topic: one.msgtype for one in bag.connections}
        assert topics["/flange"] == "geometry_msgs/msg/PoseArray"
        assert len(list(bag.messages())) == 3


@pytest.mark.parametrize("kind", [ROS_POSE_ARRAY, ROS_JOINT_TRAJECTORY])
def test_definitions_are_those_of_ros(folder: Path, kind: Any) -> None:
    with Reader(folder / "export.mcap") as reader:
        found = next(one for one in reader.connections if one.msgtype == kind.name)
    other = get_typestore(Stores.EMPTY)
    from rosbags.typesys import get_types_from_msg

    other.register(get_types_from_msg(found.msgdef.data, kind.name))
    assert other.hash_rihs01(kind.name) == STORE.hash_rihs01(kind.name)


def test_the_arm_of_the_urdf_beside_stands_where_the_flange_is_said_to_be(
    folder: Path, messages: dict[str, Any]
) -> None:
    arm, path = Kinematics.load(folder / "arm.urdf"), messages["/joint_trajectory"]
    flange = messages["/flange"]
    assert tuple(path.joint_names) == arm.joint_names
    assert flange.header.frame_id == arm.base_name
    reached = np.array([arm.forward(point.positions) for point in path.points])
    np.testing.assert_allclose(poses_of(flange), reached, atol=1e-9)
    seconds = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in path.points]
    views = read_recorded_scan(RUN).views
    np.testing.assert_allclose(seconds, [v.time - views[0].time for v in views], atol=1e-9)
    assert np.all(np.diff(seconds) > 0)


def test_sections_lie_in_the_base_frame_where_the_arm_saw_them(messages: dict[str, Any]) -> None:
    seen = [section.T_b_g for section in read_recorded_scan(RUN).sections.values()]
    found = poses_of(messages["/sections"])
    order = [int(np.argmin(np.linalg.norm(found[:, :3, 3] - T[:3, 3], axis=1))) for T in seen]
    assert sorted(order) == list(range(len(seen)))
    np.testing.assert_allclose(found[order], seen, atol=READ_LATER)


def test_what_ros_cannot_take_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("export", RUN, "--to", "ros", "--units", "mm") == 2
    assert "metres" in capsys.readouterr().err
    stitched = Path(shutil.copytree(RUN, tmp_path / "stitched"))
    summary = json.loads((stitched / "summary.json").read_bytes())
    summary["stations"] = [{"name": "south", "frame": "b", "sections": 4}]
    (stitched / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    assert tjscan("export", stitched, "--to", "ros") == 2
    assert tjscan("export", RUN, "--to", "ros", "--out", tmp_path / "none" / "out") == 2
    assert "no folder" in " ".join(capsys.readouterr().err.split())
    (tmp_path / "file").touch()
    assert tjscan("export", RUN, "--to", "ros", "--out", tmp_path / "file") == 2
    assert "file is in the way" in " ".join(capsys.readouterr().err.split())
