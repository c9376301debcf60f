"""Messages of ROS 2 as plain data: the same for JSON and for files that ROS 2 plays.

Lengths are in metres, angles in radians, times in seconds and nanoseconds (REP 103). Quaternions
are stored x, y, z, w. Definitions are those of the packages ``geometry_msgs`` and
``trajectory_msgs``, alike since ROS 2 Foxy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO, Final

from mcap_ros2.writer import Writer
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array

_DEFINITION_SEPARATOR: Final = "\n" + 80 * "=" + "\nMSG: "
_HEADER_DEFINITION: Final = _DEFINITION_SEPARATOR.join(
    (
        "",
        "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
        "builtin_interfaces/Time\nint32 sec\nuint32 nanosec",
    )
)


@dataclass(frozen=True, slots=True)
class RosMessageType:
    """A type of message: its name, and its definition with those that it is made of."""

    name: str
    definition: str


ROS_POSE_ARRAY: Final = RosMessageType(
    "geometry_msgs/msg/PoseArray",
    _DEFINITION_SEPARATOR.join(
        (
            "std_msgs/Header header\ngeometry_msgs/Pose[] poses",
            "geometry_msgs/Pose\ngeometry_msgs/Point position\n"
            "geometry_msgs/Quaternion orientation",
            "geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z",
            "geometry_msgs/Quaternion\nfloat64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
        )
    )
    + _HEADER_DEFINITION,
)
ROS_JOINT_TRAJECTORY: Final = RosMessageType(
    "trajectory_msgs/msg/JointTrajectory",
    _DEFINITION_SEPARATOR.join(
        (
            "std_msgs/Header header\nstring[] joint_names\n"
            "trajectory_msgs/JointTrajectoryPoint[] points",
            "trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\n"
            "float64[] accelerations\nfloat64[] effort\n"
            "builtin_interfaces/Duration time_from_start",
            "builtin_interfaces/Duration\nint32 sec\nuint32 nanosec",
        )
    )
    + _HEADER_DEFINITION,
)


@dataclass(frozen=True, slots=True, eq=False)
class RosMessage:
    """A message: its type, and its fields by their names."""

    type: RosMessageType
    fields: dict[str, Any]


def pose_array_message(time: int, frame: str, poses: Array) -> RosMessage:
    """Message with poses in one frame.

    Parameters
    ----------
    time : int
        Nanoseconds since 1970.
    frame : str
        Name of the frame that they are given in.
    poses : ndarray, shape (n, 4, 4)
        Metres.
    """
    rows = []
    for T in poses:
        turn = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
        position = dict(zip("xyz", T[:3, 3].tolist(), strict=True))
        rows.append({"position": position, "orientation": dict(zip("xyzw", turn, strict=True))})
    return RosMessage(ROS_POSE_ARRAY, {"header": _ros_message_header(time, frame), "poses": rows})


def joint_trajectory_message(time: int, names: Sequence[str], q: Array, times: Array) -> RosMessage:
    """Message with the joint angles of an arm, one after the other; it states no speeds.

    Parameters
    ----------
    time : int
        Nanoseconds since 1970.
    names : sequence of str
        Names of the joints in the arm's URDF.
    q : ndarray, shape (n, k)
        Angles of the k joints, radians.
    times : ndarray, shape (n,)
        Seconds from the start, growing.
    """
    starts = (_seconds_and_nanoseconds(round(1e9 * at)) for at in times.tolist())
    unstated: dict[str, Any] = {"velocities": [], "accelerations": [], "effort": []}
    points = [
        {"positions": angles, **unstated, "time_from_start": start}
        for angles, start in zip(q.tolist(), starts, strict=True)
    ]
    # No frame: the angles are of the joints that are named.
    fields = {"header": _ros_message_header(time, ""), "joint_names": list(names), "points": points}
    return RosMessage(ROS_JOINT_TRAJECTORY, fields)


def write_ros_messages(file: BinaryIO, time: int, messages: Mapping[str, RosMessage]) -> None:
    """Write an MCAP file of messages in CDR with their definitions, as rosbag2 does.

    Parameters
    ----------
    file : file
        Open for writing bytes.
    time : int
        Nanoseconds since 1970, of all messages.
    messages : mapping of str to RosMessage
        Each by its topic.
    """
    with Writer(file) as writer:
        for topic, message in messages.items():
            schema = writer.register_msgdef(message.type.name, message.type.definition)
            writer.write_message(topic, schema, message.fields, log_time=time)


def bag_metadata(file: str, time: int, messages: Mapping[str, RosMessage]) -> dict[str, Any]:
    """What ``metadata.yaml`` of a bag of rosbag2 holds, version 5; JSON is YAML, too.

    Parameters
    ----------
    file : str
        Name of the MCAP file in the bag's folder.
    time, messages
        As for `write_ros_messages`.
    """
    count = len(messages)
    span = {
        "starting_time": {"nanoseconds_since_epoch": time},
        "duration": {"nanoseconds": 0},
        "message_count": count,
    }
    topics = [
        {
            "topic_metadata": {
                "name": topic,
                "type": message.type.name,
                "serialization_format": "cdr",
                "offered_qos_profiles": "",
            },
            "message_count": 1,
        }
        for topic, message in messages.items()
    ]
    return {
        "rosbag2_bagfile_information": {
            "version": 5,
            "storage_identifier": "mcap",
            **span,
            "relative_file_paths": [file],
            "files": [{"path": file, **span}],
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
        }
    }


def _ros_message_header(time: int, frame: str) -> dict[str, Any]:
    return {"stamp": _seconds_and_nanoseconds(time), "frame_id": frame}


def _seconds_and_nanoseconds(time: int) -> dict[str, int]:
    return dict(zip(("sec", "nanosec"), divmod(time, 1_000_000_000), strict=True))
