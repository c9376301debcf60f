"""All joint configurations of a Universal Robots type of arm for one pose, in closed form.

Joints 2, 3 and 4 of such an arm are parallel, joint 2 is square to joint 1, joint 5 to joint 4
and joint 6 to joint 5, each pair meeting: at most eight configurations (shoulder left or right,
wrist flipped or not, elbow up or down) hold one pose. The derivation stands beside the lines;
z_i is the axis of DH frame i.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import acos, asin, atan2, cos, hypot, pi, sin
from typing import Final

import numpy as np

from tjscan.core.frames import Array, pose, rot_x, rot_z

ROUNDING: Final = 1e-7
"""How far beyond 1 a sine or cosine may be and still be the border of the reach."""

FREE_WRIST: Final = 1e-9
"""Below this |sin(q5)| the axes 4 and 6 are parallel, and only their sum is given."""


@dataclass(frozen=True, slots=True)
class UrDhLengths:
    """Standard DH lengths in metres; the twists are 90, 0, 0, 90, -90, 0 degrees."""

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float


def all_inverse_solutions(geometry: UrDhLengths, T_0_6: Array, free_wrist: float) -> Array:
    """All joint configurations that hold a flange pose, whatever the joint limits.

    Parameters
    ----------
    geometry : UrDhLengths
        The arm.
    T_0_6 : ndarray, shape (4, 4)
        Pose of DH frame 6 in DH frame 0.
    free_wrist : float
        Angle of joint 6 in radians where the pose leaves it free.

    Returns
    -------
    ndarray, shape (k, 6)
        Radians; k is 0 (out of reach) to 8, or up to 12 where joint 6 is free.
    """
    found = list(_configurations(geometry, T_0_6, free_wrist))
    return np.array(found).reshape(-1, 6)


def _configurations(g: UrDhLengths, T_0_6: Array, free_wrist: float) -> Iterator[list[float]]:
    R, z6 = T_0_6[:3, :3], T_0_6[:3, 2]
    p5 = T_0_6[:3, 3] - g.d6 * z6
    # z1 = (sin q1, -cos q1, 0), and the wrist stands d4 along it: p5 . z1 = d4.
    ratio = _bounded(g.d4, hypot(p5[0], p5[1]))
    if ratio is None:
        return
    bearing = atan2(p5[1], p5[0])
    for q1 in (bearing + asin(ratio), bearing + pi - asin(ratio)):
        z1 = np.array([sin(q1), -cos(q1), 0.0])
        # z1 in frame 6 is (sin q5 cos q6, -sin q5 sin q6, cos q5).
        x, y, z = (float(part) for part in R.T @ z1)
        lean = atan2(hypot(x, y), z)
        for q5, q6 in _wrists(g, T_0_6, p5, lean, (x, y), free_wrist):
            for q2, q3, q4 in _planar(g, T_0_6, q1, q5, q6):
                yield [q1, q2, q3, q4, q5, q6]


def _wrists(
    g: UrDhLengths,
    T_0_6: Array,
    p5: Array,
    lean: float,
    z1_6: tuple[float, float],
    free_wrist: float,
) -> Iterator[tuple[float, float]]:
    """Joints 5 and 6."""
    x, y = z1_6
    if sin(lean) > FREE_WRIST:
        yield lean, atan2(-y, x)
        yield -lean, atan2(y, -x)
        return
    # Joint 6 only turns the hand's elbow round p5. Beside the angle asked for, take the two
    # that bring it nearest to the shoulder and furthest from it: if any is in reach, one is.
    # The hand's elbow is at p5 - d5 z4, and z4 in frame 6 is (-sin q6, -cos q6, 0).
    from_shoulder = T_0_6[:3, :3].T @ (p5 - [0, 0, g.d1])
    inward = atan2(-from_shoulder[0], -from_shoulder[1])
    for q6 in (free_wrist, inward, inward + pi):
        yield lean, q6


def _planar(
    g: UrDhLengths, T_0_6: Array, q1: float, q5: float, q6: float
) -> Iterator[tuple[float, float, float]]:
    """Joints 2, 3, 4: two links and a hand in the plane square to z1."""
    T_0_1 = pose(rot_z(q1) @ rot_x(pi / 2), [0, 0, g.d1])
    T_4_5 = pose(rot_z(q5) @ rot_x(-pi / 2), [0, 0, g.d5])
    T_5_6 = pose(rot_z(q6), [0, 0, g.d6])
    T_1_4 = np.linalg.solve(T_0_1, T_0_6) @ np.linalg.inv(T_4_5 @ T_5_6)
    x, y = float(T_1_4[0, 3]), float(T_1_4[1, 3])
    cosine = _bounded(x * x + y * y - g.a2**2 - g.a3**2, 2 * g.a2 * g.a3)
    if cosine is None:
        return
    # R_1_4 = Rz(q2 + q3 + q4) Rx(90 deg).
    q234 = atan2(T_1_4[1, 0], T_1_4[0, 0])
    for q3 in (acos(cosine), -acos(cosine)):
        q2 = atan2(y, x) - atan2(g.a3 * sin(q3), g.a2 + g.a3 * cos(q3))
        yield q2, q3, q234 - q2 - q3


def _bounded(part: float, whole: float) -> float | None:
    """``part / whole`` where that is a sine or cosine, None where no angle has it."""
    if abs(part) > abs(whole) * (1 + ROUNDING) or whole == 0:
        return None
    return min(max(part / whole, -1.0), 1.0)
