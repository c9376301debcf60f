"""A ball that an arm sees in many postures, for tests of the arm's calibration."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.arm.calibrate import ArmModel, TargetInPostures
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets.ball import SphereModel, SphereTarget
from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array, inverse_pose, pose, rot_z, transform_points
from tjscan.robot.kinematics import Kinematics

T_F_S = pose(p=(0.01, -0.115, 0.168))
CENTRE_B = np.array((0.7, -0.2, 0.1))
RADIUS = 0.03
ARC_SIGMA = np.array((20e-6, 15e-6, 20e-6))
"""Metres: of centre x, centre z and radius of an arc of 300 points with 30 µm of noise."""
NOISE = NoiseModel(position=3e-5, rotation=6e-5)
"""What the arm does not repeat, each axis: 50 µm and 0.006° RMS."""


@cache
def kinematics() -> Kinematics:
    return Kinematics.load("ur10e")


def postures(count: int, rng: np.random.Generator) -> Array:
    """Joint angles from which the sensor sees the ball, in all configurations, shape (n, 6)."""
    found: list[Array] = []
    while len(found) < count:
        azimuth, yaw = rng.uniform(-np.pi, np.pi, 2)
        lean = rng.uniform(0, np.radians(70)) * np.array((np.cos(azimuth), np.sin(azimuth), 0))
        z = -Rotation.from_rotvec(lean).as_matrix()[:, 2]
        x = np.linalg.svd(z[None])[2][1]
        R = np.column_stack((x, np.cross(z, x), z)) @ rot_z(yaw)
        seen_s = rng.uniform((-0.02, -0.018, 0.21), (0.02, 0.018, 0.27))
        T_b_f = pose(R, CENTRE_B - R @ seen_s) @ inverse_pose(T_F_S)
        try:
            ways = kinematics().all_inverse_solutions(T_b_f, rng.uniform(-2, 2, 6))
        except PoseUnreachable:
            continue
        found.append(ways[rng.integers(len(ways))])
    return np.array(found)


def observe(true: Kinematics, q: Array, rng: np.random.Generator, share: float = 1.0) -> ArmModel:
    """What the sensor sees of the ball on an arm, with this share of the stated noise."""
    centres, radii = [], []
    for one in q:
        step = share * rng.standard_normal(6) * np.repeat((NOISE.position, NOISE.rotation), 3)
        T_b_f = true.forward(one)
        turn = Rotation.from_rotvec(step[3:]).as_matrix()
        T_b_s = pose(turn @ T_b_f[:3, :3], T_b_f[:3, 3] + step[:3]) @ T_F_S
        x, y, z = transform_points(inverse_pose(T_b_s), CENTRE_B)
        off = share * ARC_SIGMA * rng.standard_normal(3)
        centres.append((x + off[0], 0.0, z + off[1]))
        radii.append(np.sqrt(RADIUS**2 - y**2) + off[2])
    T_b_f = np.array([kinematics().forward(one) for one in q])
    model = SphereModel(
        T_b_f,
        np.array(centres),
        np.array(radii),
        np.tile(np.diag(ARC_SIGMA**2), (len(q), 1, 1)),
        SphereTarget(),
        NOISE,
    )
    return ArmModel(kinematics(), (TargetInPostures(model, q, T_b_f, np.append(CENTRE_B, RADIUS)),))
