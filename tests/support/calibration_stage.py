"""A board, a hand and a set of poses for the calibration's tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from _board import BoardSimulator
from scipy.spatial.transform import Rotation

from tjscan.calibration.closed_form import plane_through_point
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets.line import LineFit, fit_line
from tjscan.calibration.targets.plane import PlaneTarget, fit_plane
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.frames import Array, inverse_pose, pose, pose_from_rounded_matrix
from tjscan.laser.model import MeasuringRange
from tjscan.laser.profile import Profile

MM = 1e-3
NOISE = NoiseModel(geometry=0.0)
"""The arm of these tests is exact but for its repeatability."""
WINDOW = MeasuringRange(near=0.190, far=0.290, apex_z=-0.028, half_angle=0.188, columns=640)
CENTRE = np.array((0.8, 0.1, 0.05))
PLANE = plane_through_point(CENTRE, (0.05, 0.02, 1.0))
AXES = PlaneTarget.from_unknown_plane(PLANE, CENTRE).axes_b
PLACES = CENTRE + 0.15 * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]) @ AXES
T_F_S = pose_from_rounded_matrix(  # the paper's eq. (26), in metres
    [
        [0.9999, -0.0129, -0.0002, -0.000749],
        [0.0129, 0.9999, 0.0082, -0.114845],
        [0.0001, -0.0082, 1.0, 0.167616],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
HAND = BoardSimulator(T_F_S, PLANE, WINDOW, NOISE)
EXACT_HAND = BoardSimulator(T_F_S, PLANE, WINDOW)


def target(rng: np.random.Generator | None = None) -> PlaneTarget:
    """The board as touched, exactly or with errors."""
    points = PLACES if rng is None else HAND.touches(PLACES, rng)
    return fit_plane(points, NOISE.touch, CENTRE + PLANE.u)


def looking(
    tilt_x: float = 0.0,
    tilt_y: float = 0.0,
    yaw: float = 0.0,
    depth: float = 0.24,
    shift: Sequence[float] = (0.0, 0.0),
) -> Array:
    """T_b_f from which the sensor looks at the board, tilted about its own axes, in degrees.

    With no tilt it stands square to the board; it turns about the point that it looks at.
    """
    u = PLANE.u
    square = np.column_stack((AXES[0], np.cross(-u, AXES[0]), -u))
    turn = Rotation.from_euler("ZXY", (yaw, tilt_x, tilt_y), degrees=True).as_matrix()
    R = square @ turn
    foot = CENTRE + np.asarray(shift) @ AXES
    return np.asarray(pose(R, foot - depth * R[:, 2]) @ inverse_pose(T_F_S))


def circle(tilt: float, count: int = 12) -> Array:
    """Poses tilted by `tilt` degrees all round, at changing depths, shape (count, 4, 4)."""
    turns = np.arange(count) * 2 * np.pi / count
    return np.stack(
        [
            looking(tilt * np.cos(a), tilt * np.sin(a), 20 * np.cos(2 * a), 0.22 + 0.02 * (i % 3))
            for i, a in enumerate(turns)
        ]
    )


def varied(rng: np.random.Generator, count: int) -> Array:
    """Poses with tilts of all sizes, shape (count, 4, 4)."""
    return np.stack(
        [
            looking(tilt_x, tilt_y, yaw, depth)
            for tilt_x, tilt_y, yaw, depth in rng.uniform(
                (-28, -28, -60, 0.22), (28, 28, 60, 0.26), (count, 4)
            )
        ]
    )


def shots(poses: Array, hand: BoardSimulator, rng: np.random.Generator) -> list[Profile]:
    """One profile from each pose."""
    return [hand.profile(T_b_f, rng) for T_b_f in poses]


def samples(poses: Array, profiles: Sequence[Profile]) -> list[PosedFit[LineFit]]:
    """Lines from profiles, named by their number."""
    return [
        PosedFit(f"line {i + 1}", T_b_f, fit_line(profile, NOISE))
        for i, (T_b_f, profile) in enumerate(zip(poses, profiles, strict=True))
    ]


def raised(profile: Profile, by: float) -> Profile:
    """A profile that is off along z."""
    return Profile(profile.x_s, profile.z_s + by)


def error(T_f_s: Array) -> Array:
    """Truth minus result: translation and rotation vector in the axes of f, shape (6,)."""
    turn = Rotation.from_matrix(T_F_S[:3, :3] @ T_f_s[:3, :3].T).as_rotvec()
    return np.concatenate((T_F_S[:3, 3] - T_f_s[:3, 3], turn))
