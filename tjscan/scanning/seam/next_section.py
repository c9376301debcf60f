"""The section that a laser plane will cut out of a seam, a step beyond the last one."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.frames import Array, cross, inverse_pose, unit_vector
from tjscan.core.gaussian_process import Matern52, OrdinaryKriging
from tjscan.scanning.seam.fit import LocalTubeFit, LocalWalls, RecentSections, with_small_steps
from tjscan.scanning.target import correction_target_pose

SHAPE_SPREAD: Final = (4e-3, 4e-3, radians(8))
"""How much the distances of p2 and p4 from the origin, and the opening, vary round a joint."""
SHAPE_WAVE: Final = 0.2
"""Metres along the groove over which they do."""

_DIFFERENCE_STEP: Final = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedSection:
    """Model of the next section, with which the predictor solves for where it will lie.

    A section is given by its origin in b (metres) and the angles of wall and leg in the laser
    plane (radians), shape (5,).

    Parameters
    ----------
    T_b_g : ndarray, shape (4, 4)
        Frame g of the last section.
    seam : LocalTubeFit
        The tubes.
    step : float
        Distance of the origins, d_st, metres.
    shape : ndarray, shape (3,)
        Distances of p2 and p4 from the origin along their tangents (metres), opening (radians).
    residuals : ndarray, shape (4,)
        What the tubes leave, see `LocalTubeFit.expected_residuals_at`.
    shape_sigmas, residual_sigmas : ndarray
        Standard deviations of both.
    residual_jacobian : ndarray, shape (4, 10)
        Derivatives of `residuals` by the seam's parameters.
    """

    T_b_g: Array
    seam: LocalTubeFit
    step: float
    shape: Array
    shape_sigmas: Array
    residuals: Array
    residual_sigmas: Array
    residual_jacobian: Array

    @classmethod
    def from_track(
        cls, track: RecentSections, seam: LocalTubeFit, T_b_g: Array, step: float
    ) -> ExpectedSection:
        """Expect the section a step beyond the last one of a track.

        Parameters
        ----------
        track : RecentSections
            The sections so far.
        seam : LocalTubeFit
            The tubes that fit them.
        T_b_g : ndarray, shape (4, 4)
            Frame g of the last section, metres.
        step : float
            Metres.
        """
        at = np.array([step])
        kernels = (Matern52(spread, SHAPE_WAVE) for spread in SHAPE_SPREAD)
        rows = zip(track.shape.T, track.shape_sigmas.T, kernels, strict=True)
        shape = [np.concatenate(OrdinaryKriging(track.along, *row).predict(at)) for row in rows]
        left = (values[[0, 1, 4, 5]] for values in seam.expected_residuals_at(step))
        return cls(T_b_g, seam, step, *np.array(shape).T, *left)

    def initial_section(self, track: RecentSections, R_b_s: Array) -> Array:
        """A section straight on along the seam, shape (5,), to start from.

        Parameters
        ----------
        track : RecentSections
            The sections so far.
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        forward = track.origins[-1] - track.origins[-2]
        t = unit_vector(cross(*self.seam.walls().normals))
        t = t if t @ forward > 0 else -t
        flat = track.tangents[:, -1] @ R_b_s
        angles = np.arctan2(flat[:, 2], flat[:, 0])
        return np.concatenate((track.origins[-1] + self.step * t, angles))

    def after_newton_step(self, section: Array, R_b_s: Array) -> Array:
        """Section after one Newton step towards what a plane of this orientation cuts, shape (5,).

        Parameters
        ----------
        section : ndarray, shape (5,)
            As the class has it.
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        around = with_small_steps(section, _DIFFERENCE_STEP)
        values = self._off_walls(self.seam.walls(), around, R_b_s)
        J = (values[1:] - values[0]).T / _DIFFERENCE_STEP
        return np.asarray(section - np.linalg.solve(J, values[0]))

    def ideal_frame_and_work_angle(self, section: Array, R_b_s: Array) -> tuple[Array, float]:
        """Ideal frame t in b, eq. (12), and work angle (radians), eq. (16), of a section.

        Parameters
        ----------
        section : ndarray, shape (5,)
            As the class has it.
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        wall, leg = _tangents_b(section, R_b_s)
        T_b_g = np.eye(4)
        T_b_g[:3, 1], T_b_g[:3, 3] = -wall, section[:3]
        gamma_2 = float(np.arcsin(np.clip(wall @ leg, -1.0, 1.0)))
        return correction_target_pose(self.T_b_g, T_b_g), 0.5 * self.shape[2] - gamma_2

    def covariance(self, section: Array, R_b_s: Array) -> Array:
        """Covariance of the ideal frame t (in its own axes) and work angle, shape (7, 7).

        Parameters
        ----------
        section : ndarray, shape (5,)
            As the class has it.
        R_b_s : ndarray, shape (3, 3)
            Orientation of the sensor.
        """
        around, thetas, shapes = (
            with_small_steps(values, _DIFFERENCE_STEP)
            for values in (section, self.seam.theta, self.shape[:2])
        )
        walls = self.seam.walls()
        by_section = _derivative(self._off_walls(walls, around, R_b_s))
        by_theta = _derivative(self._off_walls(self.seam.walls(thetas), section, R_b_s))
        by_theta[:4] -= self.residual_jacobian
        misses = [self._off_walls(walls, section, R_b_s, lengths) for lengths in shapes]
        by_shape = _derivative(np.array(misses))
        spread = by_theta @ self.seam.covariance @ by_theta.T
        spread += (by_shape * self.shape_sigmas[:2] ** 2) @ by_shape.T
        spread[range(4), range(4)] += self.residual_sigmas**2
        back = np.linalg.inv(by_section)
        seven = _derivative(np.array([self._target_change(section, one, R_b_s) for one in around]))
        total = seven @ back @ spread @ back.T @ seven.T
        total[6, 6] += (0.5 * self.shape_sigmas[2]) ** 2
        return np.asarray(total)

    def _off_walls(
        self, walls: LocalWalls, section: Array, R_b_s: Array, lengths: Array | None = None
    ) -> Array:
        """How far sections (..., 5) are from lying on the walls a step away, shape (..., 5)."""
        lengths = self.shape[:2] if lengths is None else lengths
        tangents = _tangents_b(section, R_b_s)
        points = section[..., None, :3] + lengths[:, None] * tangents
        distances, slopes = walls.offsets_and_slopes(points[..., None, :], tangents[..., None, :])
        gone = np.linalg.norm(section[..., :3] - self.T_b_g[:3, 3], axis=-1) - self.step
        on_walls = np.concatenate((distances[..., 0], slopes[..., 0]), axis=-1) - self.residuals
        gone = np.broadcast_to(gone[..., None], (*on_walls.shape[:-1], 1))
        return np.concatenate((on_walls, gone), axis=-1)

    def _target_change(self, section: Array, other: Array, R_b_s: Array) -> Array:
        """Position, rotation vector and work angle of another section's ideal in this one's t."""
        T, _ = self.ideal_frame_and_work_angle(section, R_b_s)
        T_other, work_angle = self.ideal_frame_and_work_angle(other, R_b_s)
        return np.append(pose_vector.pose_to_vector(inverse_pose(T) @ T_other), work_angle)


def _tangents_b(section: Array, R_b_s: Array) -> Array:
    """Unit vectors along wall and leg, shape (..., 2, 3)."""
    angles = section[..., 3:, None]
    return np.asarray(np.cos(angles) * R_b_s[:, 0] + np.sin(angles) * R_b_s[:, 2])


def _derivative(values: Array) -> Array:
    """Jacobian from values at a place and at steps of `_DIFFERENCE_STEP` beside it."""
    return np.asarray((values[1:] - values[0]).T / _DIFFERENCE_STEP)
