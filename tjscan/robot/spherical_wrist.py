"""All joint configurations of an arm with a spherical wrist for one pose, in closed form.

Axis 2 is square to axis 1 and parallel to axis 3; axes 4, 5 and 6 meet in a point, 5 square to
both others: at most eight configurations (turned to the pose or away, elbow up or down, wrist
flipped or not) hold one pose. Most industrial arms are so: see Brandstötter, Angerer and Hofbaur
2014, An analytical solution of the inverse kinematics problem of industrial serial manipulators
with an ortho-parallel basis and a spherical wrist, Austrian Robotics Workshop. Here it is solved
by the axes as they lie at zero, so that an arm may be at zero in any posture and count its angles
either way.
"""

from __future__ import annotations

from math import pi

import numpy as np

from tjscan.core.frames import Array, array_dataclass, rot_y
from tjscan.robot.closed_form import (
    COSINE_ROUNDING,
    GEOMETRY_TOLERANCE,
    WRIST_SINGULARITY_SINE,
    cosine_or_nan,
)


@array_dataclass
class SphericalWristArm:
    """The geometry of an arm with a spherical wrist, as it stands at zero.

    Frame a has its origin in joint 1, z along axis 1 and y along axis 2. In its plane of x and z a
    point is the number z + ix: a turn by t about y multiplies it by exp(it).

    Parameters
    ----------
    R_0_a : ndarray, shape (3, 3)
        Axes of frame a in the first joint's frame.
    R_6_a : ndarray, shape (3, 3)
        The same in the last joint's frame.
    wrist_6 : ndarray, shape (3,)
        Where axes 4, 5 and 6 meet, in the last joint's frame, in metres.
    shoulder, upper, fore : complex
        Joint 2, from there to joint 3, and from there to the wrist, in metres.
    aside : float
        How far the wrist is along y, in metres.
    elbow_sign : float
        -1 if joint 3 counts its angle about -y, else 1.
    R_a_w : ndarray, shape (3, 3)
        Axes of the wrist in frame a: y along axis 5, z along axis 4.
    wrist_bend : float
        Angle about axis 5 from axis 4 to axis 6, in radians.
    """

    R_0_a: Array
    R_6_a: Array
    wrist_6: Array
    shoulder: complex
    upper: complex
    fore: complex
    aside: float
    elbow_sign: float
    R_a_w: Array
    wrist_bend: float

    def inverse_branches(self, T_0_6: Array) -> Array:
        """See `ClosedFormInverse`."""
        return self._joint_angles(T_0_6, np.zeros(6))

    def all_inverse_solutions(self, T_0_6: Array, near: Array) -> Array:
        """See `ClosedFormInverse`; k is 0 to 8."""
        q = self._joint_angles(T_0_6[None], near)[0]
        return np.asarray(q[np.isfinite(q).all(axis=1)])

    def _joint_angles(self, T: Array, near: Array) -> Array:
        """The eight branches, shape (m, 8, 6); what is free is as in `near`."""
        R = self.R_0_a.T @ T[:, :3, :3] @ self.R_6_a
        x, y, z = ((T[:, :3, :3] @ self.wrist_6 + T[:, :3, 3]) @ self.R_0_a).T
        # Turned back by q1, the wrist is where the plane of the links has it: aside.
        away = np.hypot(x, y)
        bearing = np.where(away > WRIST_SINGULARITY_SINE, np.arctan2(y, x), near[0])
        reaches = away * (1 + COSINE_ROUNDING) >= abs(self.aside)
        ahead = np.sqrt(np.where(reaches, np.maximum(away**2 - self.aside**2, 0.0), np.nan))
        lean = np.arctan2(self.aside, ahead)
        q1 = np.stack((bearing - lean, bearing + pi + lean), axis=1)
        # target = exp(i q2) (upper + exp(i elbow) fore): two links in a plane.
        target = z[:, None] + 1j * np.stack((ahead, -ahead), axis=1) - self.shoulder
        lengths = abs(self.upper), abs(self.fore)
        cosine = cosine_or_nan(
            np.abs(target) ** 2 - lengths[0] ** 2 - lengths[1] ** 2, 2 * lengths[0] * lengths[1]
        )
        bend = np.arccos(cosine)[..., None] * np.array((1.0, -1.0))
        elbow = bend + np.angle(self.upper / self.fore)
        q2 = np.angle(target)[..., None] - np.angle(self.upper + np.exp(1j * elbow) * self.fore)
        # What the first three joints leave to the wrist, Rz(q4) Ry(q5 + wrist_bend) Rz(q6).
        R_a_3 = _turns_about_z_and_y(np.broadcast_to(q1[..., None], q2.shape), q2 + elbow)
        left = self.R_a_w.T @ np.swapaxes(R_a_3, -1, -2) @ R[:, None, None]
        left = left @ self.R_a_w @ rot_y(self.wrist_bend)
        sine = np.hypot(left[..., 0, 2], left[..., 1, 2])
        turn = np.arctan2(left[..., 1, 2], left[..., 0, 2])
        turn = np.where(sine > WRIST_SINGULARITY_SINE, turn, near[3])
        lean = np.arctan2(sine, left[..., 2, 2])
        q4, q5 = np.stack((turn, turn + pi), axis=-1), np.stack((lean, -lean), axis=-1)
        c4, s4, left = np.cos(q4)[..., None], np.sin(q4)[..., None], left[..., None, :, :]
        row = c4 * left[..., 1, :] - s4 * left[..., 0, :]  # (sin q6, cos q6, 0)
        q6 = np.arctan2(row[..., 0], row[..., 1])
        q = (q1[..., None, None], q2[..., None], self.elbow_sign * elbow[..., None], q4)
        q = np.broadcast_arrays(*q, q5 - self.wrist_bend, q6)
        return np.stack(q, axis=-1).reshape(len(T), 8, 6)


def find_spherical_wrist(axes: Array, placements: Array) -> SphericalWristArm | None:
    """The geometry of an arm of six joints if it has a spherical wrist, up to its calibration.

    Parameters
    ----------
    axes : ndarray, shape (6, 3)
        Unit vectors along which the joints turn, each in its own frame.
    placements : ndarray, shape (6, 4, 4)
        Frame of each joint, at zero, in the frame of the joint before it.
    """
    T = [np.eye(4)]
    for placement in placements[1:]:
        T.append(T[-1] @ placement)
    p = np.array([one[:3, 3] for one in T])
    z = np.array([one[:3, :3] @ axis for one, axis in zip(T, axes, strict=True)])
    square = np.abs([z[0] @ z[1], z[3] @ z[4], z[4] @ z[5]])
    if max(*square, *np.abs(np.cross(z[1], z[2]))) > GEOMETRY_TOLERANCE:
        return None
    across = np.eye(3) - z[3:, :, None] * z[3:, None, :]  # distances from axes 4, 5 and 6
    wrist = np.linalg.solve(across.sum(axis=0), (across @ p[3:, :, None]).sum(axis=0)[:, 0])
    y_a = z[1] - z[1] @ z[0] * z[0]
    y_a /= np.linalg.norm(y_a)
    R_0_a = np.column_stack((np.cross(y_a, z[0]), y_a, z[0]))
    x, y, height = (np.array((p[1], p[2], wrist)) @ R_0_a).T
    shoulder, elbow, end = (complex(real, imag) for real, imag in zip(height, x, strict=True))
    off = np.linalg.norm(across @ (wrist - p[3:])[..., None], axis=1).max()
    if off > GEOMETRY_TOLERANCE or min(abs(elbow - shoulder), abs(end - elbow)) < 0.01:
        return None
    y_w = z[4] - z[4] @ z[3] * z[3]
    y_w /= np.linalg.norm(y_w)
    R_0_w = np.column_stack((np.cross(y_w, z[3]), y_w, z[3]))
    sine, _, cosine = z[5] @ R_0_w
    return SphericalWristArm(
        R_0_a,
        T[5][:3, :3].T @ R_0_a,
        T[5][:3, :3].T @ (wrist - p[5]),
        shoulder,
        elbow - shoulder,
        end - elbow,
        float(y[2]),
        float(np.sign(z[1] @ z[2])),
        R_0_a.T @ R_0_w,
        float(np.arctan2(sine, cosine)),
    )


def _turns_about_z_and_y(about_z: Array, about_y: Array) -> Array:
    """Rz(about_z) Ry(about_y), shape (..., 3, 3), for angles in radians, shape (...)."""
    cz, sz, cy, sy = np.cos(about_z), np.sin(about_z), np.cos(about_y), np.sin(about_y)
    rows = ((cz * cy, -sz, cz * sy), (sz * cy, cz, sz * sy), (-sy, 0 * cy, cy))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
