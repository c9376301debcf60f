"""What the primary interface sends of the arm's kinematics, as the maker documents it."""

from __future__ import annotations

import struct
from typing import Final
from zlib import crc32

import numpy as np

from tjscan.core.frames import pose, rot_x, rot_z
from tjscan.robot.closed_form import DhParameters
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.urdf import ARM_MODELS, read_urdf, ur_dh_lengths

LENGTH_SIGMA: Final = 3e-4
ANGLE_SIGMA: Final = 3e-4
"""Metres and radians by which the parameters of arms differ: assumptions."""

CALIBRATED_STATUS: Final = 1
"""Calibration status: made by the maker, with a checksum that holds."""

UR_TWISTS: Final = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
"""Standard DH link twists alpha of every Universal Robots arm, in radians."""


def nominal_dh_parameters(model: str) -> DhParameters | None:
    """Parameters of a Universal Robots arm that tjscan knows by its name; None of any other."""
    if model not in ARM_MODELS:
        return None
    urdf = Kinematics.load(model).urdf
    chain, _, flange = read_urdf(urdf)
    lengths = ur_dh_lengths(chain)
    if lengths is None:
        return None
    a = (0.0, lengths.a2, lengths.a3, 0.0, 0.0, 0.0)
    d6 = lengths.d6 + chain.frames[flange].placement.translation[2]
    d = (lengths.d1, 0.0, 0.0, lengths.d4, lengths.d5, d6)
    return DhParameters(np.zeros(6), np.array(a), np.array(d), np.array(UR_TWISTS))


def draw_calibration(nominal: DhParameters, seed: int) -> DhParameters:
    """Draw the parameters of an arm of a kind; the twist of its last joint stays as it is.

    Axes 2, 3 and 4 are nearly parallel, and a real controller states lengths d of metres along
    them; here they stay near the nominal ones.
    """
    rng = np.random.default_rng(seed)
    sigmas = np.array((ANGLE_SIGMA, LENGTH_SIGMA, LENGTH_SIGMA, ANGLE_SIGMA))
    step = sigmas[:, None] * rng.standard_normal((4, 6))
    step[[1, 3], 5] = 0.0
    return DhParameters(
        nominal.theta + step[0],
        nominal.a + step[1],
        nominal.d + step[2],
        nominal.alpha + step[3],
    )


def with_dh_parameters(
    kinematics: Kinematics, nominal: DhParameters, calibrated: DhParameters
) -> Kinematics:
    """Return an arm whose joints are placed as calibrated parameters have them.

    What the length d of the last joint is off lies along its axis, and so before it as well.
    """
    T, placements = np.eye(4), []
    for i in range(6):
        placements.append(T @ pose(rot_z(calibrated.theta[i])))
        T = pose(rot_x(calibrated.alpha[i]), (calibrated.a[i], 0.0, calibrated.d[i]))
    placements[5] = placements[5] @ pose(p=(0.0, 0.0, calibrated.d[5] - nominal.d[5]))
    return kinematics.with_joint_placements(np.array(placements))


def kinematics_message(dh: DhParameters) -> bytes:
    """A robot state that holds nothing but the package Kinematics Info."""
    numbers = np.concatenate((dh.theta, dh.a, dh.d, dh.alpha))
    columns = np.stack((dh.theta, dh.a, dh.d, dh.alpha), axis=1)
    checksums = [crc32(row.tobytes()) for row in columns]
    content = struct.pack(">6I24dI", *checksums, *numbers, CALIBRATED_STATUS)
    package = struct.pack(">iB", 5 + len(content), 5) + content
    return struct.pack(">iB", 5 + len(package), 16) + package
