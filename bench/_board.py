"""Calibration boards for tests and benches: simulated profiles, and the usual figure of merit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tjscan.calibration.closed_form import PluckerPlane
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets.line import LineFit
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.frames import Array, inverse_pose, pose
from tjscan.core.pose_vector import rotation_from_vector
from tjscan.laser.faults import correlated_noise
from tjscan.laser.model import MeasuringRange
from tjscan.laser.profile import Profile


def transform_plane(T_b_s: Array, plane_s: PluckerPlane) -> PluckerPlane:
    """A plane of frame s in frame b."""
    u = T_b_s[:3, :3] @ plane_s.u
    return PluckerPlane(u, plane_s.u0 - float(u @ T_b_s[:3, 3]))


@dataclass(frozen=True, slots=True, eq=False)
class BoardSimulator:
    """What an arm with a laser and a probe measures of a plane.

    Without arm, mesh or optics it takes the thousands of profiles that show how true the stated
    uncertainty of a calibration is.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The truth that calibration looks for.
    plane : PluckerPlane
        The board, frame b.
    window : MeasuringRange
        The laser's range.
    noise : NoiseModel, optional
        Errors; none at all without it.
    """

    T_f_s: Array
    plane: PluckerPlane
    window: MeasuringRange
    noise: NoiseModel | None = None

    def profile(self, T_b_f: Array, rng: np.random.Generator) -> Profile:
        """What the laser sees when the arm *says* that the flange is at T_b_f."""
        noise = self.noise
        if noise is not None:
            slip = pose(
                rotation_from_vector(noise.rotation * rng.standard_normal(3)),
                noise.position * rng.standard_normal(3),
            )
            T_b_f = pose(T_b_f[:3, :3] @ slip[:3, :3], T_b_f[:3, 3] + slip[:3, 3])
        seen = transform_plane(inverse_pose(T_b_f @ self.T_f_s), self.plane)
        window = self.window
        edge = np.tan(window.half_angle)
        tangent = np.linspace(-edge, edge, window.columns)
        ray = np.column_stack((tangent, np.ones_like(tangent)))
        depth = -(seen.u0 + seen.u[2] * window.apex_z) / (ray @ seen.u[[0, 2]])
        z = window.apex_z + depth
        out = (z < window.near) | (z > window.far) | (depth <= 0)
        x = np.where(out, np.nan, depth * tangent)
        z = np.where(out, np.nan, z)
        if noise is not None:
            z = z + correlated_noise(rng, window.columns, noise.range, noise.correlation)
        return Profile(x, z)

    def touches(self, points_b: Array, rng: np.random.Generator) -> Array:
        """Where the arm says that its probe tip touched the plane next to points, shape (n, 3)."""
        points = points_b - self.plane.signed_distances(points_b)[:, None] * self.plane.u
        sigma = 0.0 if self.noise is None else self.noise.touch
        return np.asarray(points + sigma * rng.standard_normal(points.shape))


def points_rms(result: HandEyeCalibration, samples: Sequence[PosedFit[LineFit]]) -> float:
    """RMS distance from the plane of all line points that the result rests on, in metres.

    The figure that others state for their calibrations.

    Parameters
    ----------
    result : HandEyeCalibration
        From lines on a plane.
    samples : sequence of PosedFit
        The lines that it was found from.

    Raises
    ------
    ValueError
        For a calibration on a sphere.
    """
    if result.board is None:
        raise ValueError("a calibration on a sphere has no plane")
    squares, count = 0.0, 0
    for sample, residual in zip(samples, result.residuals, strict=True):
        if not residual.used or residual.tilt is None:
            continue
        fit = sample.fit
        u_s = result.board.plane.u @ (sample.T_b_f @ result.T_f_s)[:3, :3]
        # Scatter lies in the laser plane, square to the line; points are spread along it evenly.
        scatter = float(np.cross(u_s, fit.direction_s)[1]) * fit.scatter
        spread = residual.tilt * fit.span / np.sqrt(12)
        squares += int(fit.inlier.sum()) * (residual.offset**2 + spread**2 + scatter**2)
        count += int(fit.inlier.sum())
    return float(np.sqrt(squares / count))
