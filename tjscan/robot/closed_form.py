"""All joint configurations of a Universal Robots type of arm for one pose, in closed form.

Joints 2, 3 and 4 of such an arm are parallel, joint 2 is square to joint 1, joint 5 to joint 4
and joint 6 to joint 5, each pair meeting: at most eight configurations (shoulder left or right,
wrist flipped or not, elbow up or down) hold one pose. The derivation is beside the lines;
z_i is the axis of DH frame i. For arms with a spherical wrist see `spherical_wrist`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final, Protocol

import numpy as np

from tjscan.core.frames import Array, array_dataclass, pose, rot_x, rot_z

COSINE_ROUNDING: Final = 1e-7
"""How far beyond 1 a sine or cosine may be and still be the border of the reach."""

WRIST_SINGULARITY_SINE: Final = 1e-9
"""Below this |sin(q5)| the axes 4 and 6 are parallel, and only their sum is given."""

GEOMETRY_TOLERANCE: Final = 0.005
"""Metres and radians by which a calibrated arm may differ from the ideal geometry."""


class ClosedFormInverse(Protocol):
    """Inverse kinematics of an arm of six joints in closed form.

    ``T_0_6`` is the pose of the last link, in the frame of its joint, in the first joint's at zero.
    """

    def inverse_branches(self, T_0_6: Array) -> Array:
        """The eight branches of the inverse at many poses, each continuous along a path.

        Parameters
        ----------
        T_0_6 : ndarray, shape (m, 4, 4)

        Returns
        -------
        ndarray, shape (m, 8, 6)
            Radians, whatever the joint limits: shoulder, elbow and wrist either way. Not a number
            if a branch does not reach the pose. A joint that the pose leaves free is anywhere.
        """

    def all_inverse_solutions(self, T_0_6: Array, near: Array) -> Array:
        """All joint configurations that hold a pose, whatever the joint limits.

        Parameters
        ----------
        T_0_6 : ndarray, shape (4, 4)
        near : ndarray, shape (6,)
            Joint angles in radians; a joint that the pose leaves free stays there.

        Returns
        -------
        ndarray, shape (k, 6)
            Radians; k is 0 out of reach.
        """


@array_dataclass
class DhParameters:
    """Standard DH parameters: frame i is Rz(theta + q) Tz(d) Tx(a) Rx(alpha) in frame i - 1.

    Parameters
    ----------
    theta, a, d, alpha : ndarray, shape (6,)
        Radians and metres.
    """

    theta: Array
    a: Array
    d: Array
    alpha: Array

    def forward(self, q: Array) -> Array:
        """Pose of frame 6 in frame 0, shape (4, 4), for joint angles, shape (6,), in radians."""
        T = np.eye(4)
        for angle, a, d, alpha in zip(self.theta + q, self.a, self.d, self.alpha, strict=True):
            T = T @ pose(rot_z(angle), (0.0, 0.0, d)) @ pose(rot_x(alpha), (a, 0.0, 0.0))
        return T


@dataclass(frozen=True, slots=True)
class UrDhLengths:
    """Standard DH lengths in metres; the twists are 90, 0, 0, 90, -90, 0 degrees."""

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float

    def all_inverse_solutions(self, T_0_6: Array, near: Array) -> Array:
        """See `ClosedFormInverse`; k is 0 to 8, or up to 12 where joint 6 is free."""
        T = T_0_6[None]
        q1 = _shoulder_angles(self, T)
        q5, q6 = _wrist_angles(T, q1)
        free = np.sin(q5[0, :, 0]) <= WRIST_SINGULARITY_SINE
        found = []
        for i in range(2):
            if not free[i]:
                found.append(_joint_angles(self, T, q1[:, i, None], q5[:, i], q6[:, i]))
                continue
            # Joint 6 only turns the hand's elbow round p5. Beside the angle asked for, take the
            # two that bring it nearest to the shoulder and furthest from it: if any is in reach,
            # one is. The hand's elbow is at p5 - d5 z4, and z4 in frame 6 is
            # (-sin q6, -cos q6, 0).
            p5 = T_0_6[:3, 3] - self.d6 * T_0_6[:3, 2]
            from_shoulder = T_0_6[:3, :3].T @ (p5 - [0, 0, self.d1])
            inward = np.arctan2(-from_shoulder[0], -from_shoulder[1])
            turns = np.array([[near[5], inward, inward + pi]])
            found.append(_joint_angles(self, T, q1[:, i, None], q5[:, i, :1] + 0 * turns, turns))
        q = np.concatenate([one.reshape(-1, 6) for one in found])
        return np.asarray(q[np.isfinite(q).all(axis=1)])

    def inverse_branches(self, T_0_6: Array) -> Array:
        """See `ClosedFormInverse`."""
        q1 = _shoulder_angles(self, T_0_6)
        q5, q6 = _wrist_angles(T_0_6, q1)
        q = _joint_angles(self, T_0_6, np.broadcast_to(q1[..., None], q5.shape), q5, q6)
        return q.reshape(len(T_0_6), 8, 6)


def _shoulder_angles(g: UrDhLengths, T: Array) -> Array:
    """Joint 1 both ways, shape (m, 2)."""
    p5 = T[:, :3, 3] - g.d6 * T[:, :3, 2]
    # z1 = (sin q1, -cos q1, 0), and the wrist is d4 along it: p5 . z1 = d4.
    lean = np.arcsin(cosine_or_nan(g.d4, np.hypot(p5[:, 0], p5[:, 1])))
    bearing = np.arctan2(p5[:, 1], p5[:, 0])
    return np.stack((bearing + lean, bearing + pi - lean), axis=1)


def _wrist_angles(T: Array, q1: Array) -> tuple[Array, Array]:
    """Joints 5 and 6 both ways, each of shape (m, k, 2): the other way is -q5, q6 + 180 degrees."""
    z1 = np.stack((np.sin(q1), -np.cos(q1), 0 * q1), axis=-1)
    # z1 in frame 6 is (sin q5 cos q6, -sin q5 sin q6, cos q5).
    x, y, z = np.moveaxis(np.einsum("mji,mkj->mki", T[:, :3, :3], z1), -1, 0)
    lean, turn = np.arctan2(np.hypot(x, y), z), np.arctan2(-y, x)
    return np.stack((lean, -lean), axis=-1), np.stack((turn, turn + pi), axis=-1)


def _joint_angles(g: UrDhLengths, T: Array, q1: Array, q5: Array, q6: Array) -> Array:
    """All six joints, the elbow both ways; q1, q5 and q6 of shape (m, ...), shape (m, ..., 2, 6).

    Joints 2, 3 and 4 are two links and a hand in the plane square to z1.
    """
    extra = (slice(None), *(None,) * (q1.ndim - 1))
    R, p = T[:, :3, :3][extra], T[:, :3, 3][extra]
    c1, s1 = np.cos(q1), np.sin(q1)
    c6, s6 = np.cos(q6)[..., None], np.sin(q6)[..., None]
    # The hand's elbow, p4 = p6 - d6 z6 - d5 z4', z4' = the axis y of frame 5 turned back.
    y4 = s6 * R[..., 0] + c6 * R[..., 1]
    p4 = p - g.d6 * R[..., 2] + g.d5 * y4
    away = p4 - np.array((0.0, 0.0, g.d1))
    x = c1 * away[..., 0] + s1 * away[..., 1]
    y = away[..., 2]
    # R_1_4 = Rz(q2 + q3 + q4) Rx(90 deg), so its x axis is the x axis of frame 4.
    x6 = c6 * R[..., 0] - s6 * R[..., 1]
    c5, s5 = np.cos(q5)[..., None], np.sin(q5)[..., None]
    x4 = c5 * x6 - s5 * R[..., 2]
    q234 = np.arctan2(x4[..., 2], c1 * x4[..., 0] + s1 * x4[..., 1])
    cosine = cosine_or_nan(x**2 + y**2 - g.a2**2 - g.a3**2, 2 * g.a2 * g.a3)
    bend = np.arccos(cosine)[..., None] * np.array((1.0, -1.0))
    q2 = np.arctan2(y, x)[..., None] - np.arctan2(g.a3 * np.sin(bend), g.a2 + g.a3 * np.cos(bend))
    q1, q5, q6 = (np.broadcast_to(q[..., None], q2.shape) for q in (q1, q5, q6))
    return np.stack((q1, q2, bend, q234[..., None] - q2 - bend, q5, q6), axis=-1)


def cosine_or_nan(part: Array | float, whole: Array | float) -> Array:
    """``part / whole`` if that is a sine or cosine, not a number if no angle has it."""
    part, whole = np.asarray(part), np.asarray(whole)
    can = (np.abs(part) <= np.abs(whole) * (1 + COSINE_ROUNDING)) & (whole != 0)
    ratio = np.divide(part, whole, out=np.full(can.shape, np.nan), where=can)
    return np.clip(ratio, -1.0, 1.0)
