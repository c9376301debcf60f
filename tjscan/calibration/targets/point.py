"""Points that an arm carries or touches, as a laser tracker or an artefact has them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets.target import LinearisedModel, TargetModel
from tjscan.core.frames import Array, pose, skew_matrix
from tjscan.core.pose_vector import boxplus, left_jacobian

START_ROUNDS: Final = 30
"""Place of the tracker and place on the flange are found in turn; they settle in ten."""


@dataclass(frozen=True, slots=True, eq=False)
class PointModel(TargetModel):
    """Points that are fixed on a flange, in a frame that is fixed in the room.

    Its nine parameters are a step of T_b_t, the pose of that frame in the arm's base, and the place
    of the point on the flange, metres; both unknown. The sensor's pose has no part in it.

    Parameters
    ----------
    points_t : ndarray, shape (n, 3)
        As measured, or as the certificate of an artefact has them, metres.
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.
    T_b_t : ndarray, shape (4, 4)
        Where the step begins.
    noise : NoiseModel
        `touch` is that of a point, each axis.
    """

    points_t: Array
    T_b_f: Array
    T_b_t: Array
    noise: NoiseModel

    @property
    def prior_information(self) -> Array:
        """None: all of it is unknown."""
        return np.zeros((9, 9))

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Distances between the points by the arm and as measured, frame b."""
        step, p_f = np.split(np.array(target), [6])
        T_b_t, R, n = boxplus(self.T_b_t, step), self.T_b_f[:, :3, :3], len(self.points_t)
        carried, measured = R @ p_f, self.points_t @ T_b_t[:3, :3].T
        one = np.tile(np.eye(3), (n, 1, 1))
        by_turn = skew_matrix(measured) @ left_jacobian(step[3:])
        return LinearisedModel(
            self.T_b_f[:, :3, 3] + carried - measured - T_b_t[:3, 3],
            np.zeros((n, 3, 6)),
            np.concatenate((-one, by_turn, R), axis=2),
            np.concatenate((one, -skew_matrix(carried)), axis=2),
            self.noise.touch**2 * one,
            self.noise,
        )

    def at_other_poses(self, T_b_f: Array) -> Self:
        """Return the same points at other flange poses."""
        return replace(self, T_b_f=T_b_f)

    def result_fields(self, target: Array, covariance: Array) -> dict[str, Any]:
        """None: the frame of the points is a part of no sensor's calibration."""
        return {}


def start_of_points(points_t: Array, T_b_f: Array, noise: NoiseModel) -> tuple[PointModel, Array]:
    """Model of measured points, and its parameters to start from, shape (9,).

    Parameters
    ----------
    points_t : ndarray, shape (n, 3)
        Metres.
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses by the arm's model.
    noise : NoiseModel
        See `PointModel`.
    """
    R, p_f, T_b_t = T_b_f[:, :3, :3], np.zeros(3), np.eye(4)
    for _ in range(START_ROUNDS):
        points_b = T_b_f[:, :3, 3] + R @ p_f
        middle_b, middle_t = points_b.mean(axis=0), points_t.mean(axis=0)
        R_b_t = Rotation.align_vectors(points_b - middle_b, points_t - middle_t)[0].as_matrix()
        # The place on the flange, and that of the frame with it.
        A = np.concatenate((R, -np.tile(np.eye(3), (len(R), 1, 1))), axis=2).reshape(-1, 6)
        off = (points_t @ R_b_t.T - T_b_f[:, :3, 3]).ravel()
        p_f, p_b_t = np.split(np.linalg.lstsq(A, off, rcond=None)[0], 2)
        T_b_t = pose(R_b_t, p_b_t)
    return PointModel(points_t, T_b_f, T_b_t, noise), np.concatenate((np.zeros(6), p_f))
