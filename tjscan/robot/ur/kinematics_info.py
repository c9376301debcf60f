"""The kinematic calibration that a controller states of its own arm.

The primary interface (port 30001) sends robot states, big-endian: size (int32), type 16 (uint8),
and packages of size (int32), type (uint8) and content. Package 5, "Kinematics Info", holds six
checksums (uint32), then theta, a, d and alpha of the six joints (double), as calibrated: nominal
parameters and deltas together. See Universal Robots, *Client Interface*, and the class
KinematicsInfo of their client library. Controllers before 3.6 do not send it.
"""

from __future__ import annotations

import socket
import struct
import time
from typing import Final

import numpy as np

from tjscan.robot.closed_form import DhParameters
from tjscan.robot.kinematics import Kinematics

PRIMARY_INTERFACE_PORT: Final = 30001
KINEMATICS_READ_LIMIT: Final = 2.0
"""Seconds: a controller sends ten states a second, this package with the first ones."""

ROBOT_STATE_MESSAGE_TYPE: Final = 16
KINEMATICS_INFO_PACKAGE_TYPE: Final = 5
UR_PACKAGE_HEAD: Final = struct.Struct(">iB")
KINEMATICS_INFO_STRUCT: Final = struct.Struct(">6I24d")
MOST_MESSAGE_BYTES: Final = 1 << 16
"""A longer message is none."""

SAME_KINEMATICS_TOLERANCE: Final = 1e-5
"""Metres within which a controller's calibration is the model itself."""


COMPARED_POSTURES: Final = 200
"""Joint angles at which two descriptions are compared, always the same ones."""


def compare_flange_with_model(dh: DhParameters, kinematics: Kinematics) -> tuple[float, float]:
    """Distances, RMS and largest, of the flange by DH parameters from where a model has it.

    Parameters
    ----------
    dh : DhParameters
        As a controller states them.
    kinematics : Kinematics
        An arm with six joints.
    """
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, (COMPARED_POSTURES, 6))
    off = [dh.forward(one)[:3, 3] - kinematics.forward(one)[:3, 3] for one in q]
    apart = np.linalg.norm(off, axis=1)
    return float(np.sqrt(np.mean(apart**2))), float(apart.max())


def describe_kinematics_difference(dh: DhParameters, kinematics: Kinematics) -> str:
    """Where a controller's own calibration and a model of the arm disagree, in words."""
    rms, largest = compare_flange_with_model(dh, kinematics)
    if largest < SAME_KINEMATICS_TOLERANCE:
        return f"the controller's kinematics equal the model {kinematics.name}"
    return (
        f"the controller's own calibration has the flange {1e3 * rms:.2f} mm RMS, "
        f"{1e3 * largest:.2f} mm at most from where the model {kinematics.name} has it; "
        "poses are the controller's"
    )


def read_kinematics_info(host: str, limit: float = KINEMATICS_READ_LIMIT) -> DhParameters | None:
    """Read how a controller's arm is calibrated; None if it states nothing in time.

    Parameters
    ----------
    host : str
        The controller's address.
    limit : float
        Seconds to wait.
    """
    end = time.monotonic() + limit
    try:
        with (
            socket.create_connection((host, PRIMARY_INTERFACE_PORT), timeout=limit) as link,
            link.makefile("rb") as stream,
        ):
            while (left := end - time.monotonic()) > 0:
                link.settimeout(left)
                size, kind = UR_PACKAGE_HEAD.unpack(stream.read(UR_PACKAGE_HEAD.size))
                if not UR_PACKAGE_HEAD.size <= size <= MOST_MESSAGE_BYTES:
                    break
                body = stream.read(size - UR_PACKAGE_HEAD.size)
                if (
                    kind == ROBOT_STATE_MESSAGE_TYPE
                    and (found := find_kinematics_package(body)) is not None
                ):
                    return found
    except (OSError, struct.error):  # no controller, too late, or it hung up within a package
        pass
    return None


def find_kinematics_package(body: bytes) -> DhParameters | None:
    """Find the kinematics among the packages of a robot state, without its own head.

    A package that can't be, or holds no numbers, is as good as none.
    """
    at = 0
    while at + UR_PACKAGE_HEAD.size <= len(body):
        size, kind = UR_PACKAGE_HEAD.unpack_from(body, at)
        if size < UR_PACKAGE_HEAD.size or at + size > len(body):
            return None
        if (
            kind == KINEMATICS_INFO_PACKAGE_TYPE
            and size >= UR_PACKAGE_HEAD.size + KINEMATICS_INFO_STRUCT.size
        ):
            values = KINEMATICS_INFO_STRUCT.unpack_from(body, at + UR_PACKAGE_HEAD.size)
            numbers = np.array(values[6:]).reshape(4, 6)
            if not np.isfinite(numbers).all():
                return None
            return DhParameters(*numbers)
        at += size
    return None
