"""Lines on a plane: offset and tilt of each, and what their errors come from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tjscan.calibration.fits.line import LineFit
from tjscan.calibration.fits.line_bundle import LineBundle, stack_lines
from tjscan.calibration.models.linearised import LinearisedModel
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets import PlaneTarget
from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True, eq=False)
class PlaneModel:
    """Residuals of lines on a plane: distance of each centroid, and sine of the tilt out of it.

    Both are all that eq. (17) asks of a line. The target's parameters are those of
    `PlaneTarget.boxplus`.

    Parameters
    ----------
    lines : LineBundle
        Poses and lines.
    sigma_offset, sigma_angle : ndarray, shape (n,)
        Range errors of each line, in metres and radians.
    target : PlaneTarget
        The board.
    noise : NoiseModel
        For the arm's errors.
    by_laser : ndarray, shape (n, 2, m), or None
        As `line_by_laser` gives it for each line.
    by_arm : ndarray, shape (n, 6, m), or None
        As `ArmGeometry.moves` gives it for each pose.
    """

    lines: LineBundle
    sigma_offset: Array
    sigma_angle: Array
    target: PlaneTarget
    noise: NoiseModel
    by_laser: Array | None = None
    by_arm: Array | None = None

    @classmethod
    def from_line_fits(
        cls,
        T_b_f: Array,
        fits: list[LineFit],
        target: PlaneTarget,
        noise: NoiseModel,
        by_laser: Array | None = None,
        by_arm: Array | None = None,
    ) -> Self:
        """Model of the lines that were seen from n poses.

        Parameters
        ----------
        T_b_f : ndarray, shape (n, 4, 4)
            Flange poses, as the arm read them.
        fits : list of LineFit
            The line seen from each.
        target : PlaneTarget
            The board, and how well it is known.
        noise : NoiseModel
            For the arm's errors.
        by_laser, by_arm : ndarray or None
            As of the class.
        """
        return cls(
            stack_lines(T_b_f, fits),
            np.array([fit.sigma_offset for fit in fits]),
            np.array([fit.sigma_angle for fit in fits]),
            target,
            noise,
            by_laser,
            by_arm,
        )

    def seen_from(self, T_b_f: Array) -> Self:
        """Return the same lines, taken from other flange poses, shape (n, 4, 4)."""
        lines = replace(self.lines, R_b_f=T_b_f[:, :3, :3], p_b_f=T_b_f[:, :3, 3])
        return replace(self, lines=lines)

    @property
    def prior_information(self) -> Array:
        """Inverse covariance of the plane's (tilt, tilt, height) known beforehand, shape (3, 3)."""
        return self.target.information

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Offsets in metres and tilts in radians, k = 2, with derivatives and covariance.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (3,)
            Tilt, tilt (radians) and height (metres) of the plane from `PlaneTarget.plane`.
        """
        R_b_f, R, p = self.lines.R_b_f, T_f_s[:3, :3], T_f_s[:3, 3]
        lever_f, a_f = self.lines.points_s @ R.T, self.lines.directions_s @ R.T
        x_b = _turn(R_b_f, lever_f + p)  # from the flange to the line, in the axes of b
        a_b = _turn(R_b_f, a_f)
        tilted = self.target.plane.u + target[:2] @ self.target.axes_b
        length = np.linalg.norm(tilted)
        u = tilted / length
        by_tilt = (self.target.axes_b - np.outer(self.target.axes_b @ u, u)) / length
        arm_b = x_b + self.lines.p_b_f - self.target.centre_b
        residuals = np.stack((arm_b @ u + target[2], a_b @ u), axis=1)

        u_f = u @ R_b_f  # (n, 3): the normal as each flange sees it
        by_pose = np.zeros((len(x_b), 2, 6))
        by_pose[:, 0, :3] = u_f
        by_pose[:, 0, 3:] = _cross(lever_f, u_f)
        by_pose[:, 1, 3:] = _cross(a_f, u_f)
        by_target = np.zeros((len(x_b), 2, 3))
        by_target[:, 0, :2], by_target[:, 0, 2] = arm_b @ by_tilt.T, 1.0
        by_target[:, 1, :2] = a_b @ by_tilt.T
        # A small turn of the flange moves all points of the line together.
        by_arm = np.zeros((len(x_b), 2, 6))
        by_arm[:, 0, :3] = u
        by_arm[:, 0, 3:], by_arm[:, 1, 3:] = _cross(x_b, u), _cross(a_b, u)
        a = self.lines.directions_s
        across_f = np.stack((-a[:, 2], a[:, 1], a[:, 0]), axis=1) @ R.T
        # A line's errors lie in the laser plane; this much of them points at the board.
        share = np.einsum("ni,ni->n", across_f, u_f)
        own = np.zeros((len(a), 2, 2))
        own[:, 0, 0] = (share * self.sigma_offset) ** 2
        own[:, 1, 1] = (share * self.sigma_angle) ** 2
        by_laser = None if self.by_laser is None else share[:, None, None] * self.by_laser
        by_geometry = None if self.by_arm is None else by_arm @ self.by_arm
        if by_geometry is not None and self.target.by_arm is not None:
            by_geometry = by_geometry + by_target @ self.target.by_arm
        return LinearisedModel(
            residuals, by_pose, by_target, by_arm, own, self.noise, by_laser, by_geometry
        )


def _cross(a: Array, b: Array) -> Array:
    """Cross products of rows, shape (n, 3), with rows or with one vector: quick for few of them."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=1)


def _turn(R: Array, v: Array) -> Array:
    """Rows of v, shape (n, 3), each turned by its own R, shape (n, 3, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", R, v))
