"""What is recorded, as messages of Foxglove's own schemas, which hold nothing else.

Lengths are in metres, angles in radians. Quaternions are stored x, y, z, w.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.timestamp_pb2 import Timestamp
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array
from tjscan.laser.profile import Profile
from tjscan.recording.topic import Topic

LINE_WIDTH_PIXELS: Final = 2.0
"""Pixels of a drawn line."""

PROFILE_TOPIC: Final = Topic.of("/profile", PointCloud)
TRANSFORMS_TOPIC: Final = Topic.of("/tf", FrameTransforms)

IDENTITY_POSE: Final = Pose(orientation=Quaternion(w=1.0))

NumericType = PackedElementField.NumericType


def frame_transforms_message(time: int, poses: Mapping[tuple[str, str], Array]) -> FrameTransforms:
    """Foxglove message with the pose of each frame in its parent frame.

    Parameters
    ----------
    time : int
        Nanoseconds since 1970.
    poses : mapping of (str, str) to ndarray, shape (4, 4)
        For ``("b", "f")`` the pose T_b_f of frame f in frame b.
    """
    message = FrameTransforms()
    for (parent, child), T in poses.items():
        one = message.transforms.add(
            timestamp=_timestamp(time), parent_frame_id=parent, child_frame_id=child
        )
        one.translation.x, one.translation.y, one.translation.z = T[:3, 3].tolist()
        turn = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
        one.rotation.x, one.rotation.y, one.rotation.z, one.rotation.w = turn
    return message


def profile_to_cloud_message(time: int, profile: Profile) -> PointCloud:
    """Foxglove point cloud message of a raw profile in frame s; NaN for a missing point."""
    columns = {"x": profile.x_s, "y": np.zeros(len(profile)), "z": profile.z_s}
    if profile.intensity is not None:
        columns["intensity"] = profile.intensity
    return PointCloud(
        timestamp=_timestamp(time),
        frame_id="s",
        pose=IDENTITY_POSE,
        point_stride=8 * len(columns),
        fields=[
            PackedElementField(name=name, offset=8 * i, type=NumericType.FLOAT64)
            for i, name in enumerate(columns)
        ],
        data=np.column_stack(list(columns.values())).astype("<f8").tobytes(),
    )


def profile_from_cloud_message(cloud: PointCloud, times: Profile) -> Profile:
    """The profile in a point cloud message that `profile_to_cloud_message` made.

    Parameters
    ----------
    cloud : PointCloud
        The message.
    times : Profile
        Without points: when it was taken, as the message states that it belongs to.

    Raises
    ------
    ValueError, KeyError
        If the message holds something else.
    """
    names = [field.name for field in cloud.fields]
    layout = [(field.type, field.offset) for field in cloud.fields]
    packed = layout == [(NumericType.FLOAT64, 8 * i) for i in range(len(layout))]
    if not names or not packed or cloud.point_stride != 8 * len(names):
        raise ValueError("a point cloud whose fields are no profile's")
    table = np.frombuffer(cloud.data, dtype="<f8").reshape(-1, len(names))
    columns = {name: table[:, i] for i, name in enumerate(names)}
    return replace(times, x_s=columns["x"], z_s=columns["z"], intensity=columns.get("intensity"))


def joint_states_message(time: int, names: Sequence[str], q: Array) -> JointStates:
    """Foxglove message with the angles of an arm's joints, radians."""
    message = JointStates(timestamp=_timestamp(time))
    for name, angle in zip(names, q.tolist(), strict=True):
        message.joints.add(name=name, position=angle)
    return message


def line_and_surface_message(time: int, name: str, line: Array, triangles: Array) -> SceneUpdate:
    """Foxglove scene message that draws a line and a surface in frame b until the end.

    Parameters
    ----------
    time : int
        Nanoseconds since 1970.
    name : str
        What is drawn; another of the same name replaces it.
    line : ndarray, shape (n, 3)
        Points of an open line, metres.
    triangles : ndarray, shape (m, 3, 3)
        Corners of each triangle, metres; m may be 0.
    """
    entity = SceneEntity(timestamp=_timestamp(time), frame_id="b", id=name)
    entity.lines.add(
        type=LinePrimitive.LINE_STRIP,
        pose=IDENTITY_POSE,
        thickness=LINE_WIDTH_PIXELS,
        scale_invariant=True,
        points=_point_messages(line),
        color=Color(r=1.0, g=0.5, b=0.0, a=1.0),
    )
    if len(triangles):
        entity.triangles.add(
            pose=IDENTITY_POSE,
            points=_point_messages(triangles.reshape(-1, 3)),
            color=Color(r=0.6, g=0.65, b=0.7, a=1.0),
        )
    return SceneUpdate(entities=[entity])


def event_log_message(time: int, level: Log.Level.ValueType, name: str, detail: str) -> Log:
    """Foxglove log message of an event: its name, and its detail."""
    return Log(timestamp=_timestamp(time), level=level, name=name, message=detail)


def _timestamp(time: int) -> Timestamp:
    stamp = Timestamp()
    stamp.FromNanoseconds(time)
    return stamp


def _point_messages(values: Array) -> list[Point3]:
    return [Point3(x=x, y=y, z=z) for x, y, z in values.tolist()]
