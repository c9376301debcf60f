"""Lines that a simulated hand takes from a board, with errors as the noise model states them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.plucker import Plane, transform_plane
from tjscan.calibration.window import Window
from tjscan.frames import Array, inverse, pose
from tjscan.laser.faults import speckle
from tjscan.laser.profile import Profile


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedHand:
    """An arm with a laser on it, in front of a plane.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The truth that calibration looks for.
    plane : Plane
        The board, frame b.
    window : Window
        The laser's range.
    noise : NoiseModel, optional
        Errors; none at all without it.
    """

    T_f_s: Array
    plane: Plane
    window: Window
    noise: NoiseModel | None = None

    def profile(self, T_b_f: Array, rng: np.random.Generator) -> Profile:
        """What the laser sees when the arm *says* that the flange is at T_b_f."""
        noise = self.noise
        if noise is not None:
            slip = pose(
                Rotation.from_rotvec(noise.rotation * rng.standard_normal(3)).as_matrix(),
                noise.position * rng.standard_normal(3),
            )
            T_b_f = pose(T_b_f[:3, :3] @ slip[:3, :3], T_b_f[:3, 3] + slip[:3, 3])
        seen = transform_plane(inverse(T_b_f @ self.T_f_s), self.plane)
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
            z = z + speckle(rng, window.columns, noise.range, noise.correlation)
        return Profile(x, z)

    def touches(self, points_b: Array, rng: np.random.Generator) -> Array:
        """Where the arm says that its probe tip touched the plane next to points, shape (n, 3)."""
        points = points_b - self.plane.distance(points_b)[:, None] * self.plane.u
        sigma = 0.0 if self.noise is None else self.noise.touch
        return np.asarray(points + sigma * rng.standard_normal(points.shape))
