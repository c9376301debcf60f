"""Messages of Externally Guided Motion: what a controller sends, and what it is answered.

It sends an ``EgmRobot`` and takes an ``EgmSensor``, messages of ABB's ``egm.proto`` (protobuf).
Angles are in degrees there, lengths and times in millimetres and milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from tjscan.core.frames import Array
from tjscan.robot.cyclic.stream import CyclePacket, PacketRefused

EGM_MESSAGES: Final[dict[str, dict[int, tuple[str, str]]]] = {
    "EgmHeader": {1: ("seqno", "uint32"), 2: ("tm", "uint32"), 3: ("mtype", "int32")},
    "EgmCartesian": {1: ("x", "double"), 2: ("y", "double"), 3: ("z", "double")},
    "EgmPose": {1: ("pos", "EgmCartesian")},
    "EgmJoints": {1: ("joints", "doubles")},
    "EgmPlanned": {1: ("joints", "EgmJoints")},
    "EgmFeedBack": {1: ("joints", "EgmJoints"), 2: ("cartesian", "EgmPose")},
    "EgmState": {1: ("state", "int32")},
    "EgmRobot": {
        1: ("header", "EgmHeader"),
        2: ("feedBack", "EgmFeedBack"),
        4: ("motorState", "EgmState"),
        5: ("mciState", "EgmState"),
        8: ("rapidExecState", "EgmState"),
    },
    "EgmSensor": {1: ("header", "EgmHeader"), 2: ("planned", "EgmPlanned")},
}
"""Fields that are used, by message and number: name and type; an enumeration is an int32 here."""

TYPE_DATA, TYPE_CORRECTION = 2, 3  # mtype of what the controller sends, and of an answer

MOTORS_OFF, MCI_RUNNING, RAPID_STOPPED = 2, 3, 1  # of its states


def _message_types() -> tuple[Any, Any]:
    file = descriptor_pb2.FileDescriptorProto(name="egm.proto", package="abb.egm", syntax="proto2")
    for message, fields in EGM_MESSAGES.items():
        described = file.message_type.add(name=message)
        for number, (name, kind) in fields.items():
            field = described.field.add(name=name, number=number)
            field.label = field.LABEL_REPEATED if kind == "doubles" else field.LABEL_OPTIONAL
            if kind in EGM_MESSAGES:
                field.type, field.type_name = field.TYPE_MESSAGE, f".abb.egm.{kind}"
            else:
                field.type = field.Type.Value(f"TYPE_{kind.removesuffix('s').upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return (
        message_factory.GetMessageClass(pool.FindMessageTypeByName("abb.egm.EgmRobot")),
        message_factory.GetMessageClass(pool.FindMessageTypeByName("abb.egm.EgmSensor")),
    )


EgmRobot, EgmSensor = _message_types()


@dataclass(frozen=True, slots=True, eq=False)
class EgmPacket(CyclePacket):
    """State of the controller in one cycle; its stamp is the header's seqno.

    Parameters
    ----------
    motors, egm, rapid : int
        States of motors (motorState), motion (mciState) and program (rapidExecState); 0 is unknown.
    """

    motors: int
    egm: int
    rapid: int


def parse_packet(data: bytes) -> EgmPacket:
    """Parse a message of the controller.

    Raises
    ------
    PacketRefused
        If it is none.
    """
    robot = EgmRobot()
    try:
        robot.ParseFromString(data)
    except DecodeError as error:
        raise PacketRefused(f"it is no EgmRobot ({error})") from None
    if robot.header.mtype != TYPE_DATA:
        raise PacketRefused(f"its mtype is {robot.header.mtype}, not {TYPE_DATA} (MSGTYPE_DATA)")
    joints = np.radians(robot.feedBack.joints.joints)
    if not robot.feedBack.cartesian.HasField("pos"):
        raise PacketRefused("its feedBack has no cartesian position")
    place = robot.feedBack.cartesian.pos
    flange_b = 1e-3 * np.array((place.x, place.y, place.z))
    if joints.shape != (6,) or not np.isfinite((*joints, *flange_b)).all():
        raise PacketRefused("its feedBack has not a number for each of six joints and x, y, z")
    return EgmPacket(
        stamp=robot.header.seqno,
        time=1e-3 * robot.header.tm,
        q=joints,
        set_point=joints,
        tool_b=flange_b,
        late=0,
        motors=robot.motorState.state,
        egm=robot.mciState.state,
        rapid=robot.rapidExecState.state,
    )


def format_answer(q: Array, packet: EgmPacket) -> bytes:
    """Answer to a message: joint angles, shape (6,), radians, with its seqno and time."""
    sensor = EgmSensor()
    sensor.header.mtype = TYPE_CORRECTION
    sensor.header.seqno, sensor.header.tm = packet.stamp, round(1e3 * packet.time)
    sensor.planned.joints.joints.extend(np.degrees(q).tolist())
    return bytes(sensor.SerializeToString())
