"""A simulated hand that takes lines from a board, and a simulated probe that touches it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.plucker import Plane, transform_plane
from tjscan.calibration.session import square_poses
from tjscan.calibration.window import Window
from tjscan.core.errors import PoseUnreachable
from tjscan.core.frames import Array, inverse, pose
from tjscan.core.lie import so3_exp
from tjscan.laser.faults import speckle
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedHand:
    """An arm with a laser on it, in front of a plane.

    For tests and benches alone, which share no other home: without arm, mesh or optics it takes
    the thousands of profiles that say how well a calibration holds what it promises.

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
                so3_exp(noise.rotation * rng.standard_normal(3)),
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


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedProbe:
    """A `Probe` on a simulated arm: it stops where the tip meets the true board, or nearly.

    Parameters
    ----------
    arm : Arm
        The arm that carries the tip.
    tip_f : ndarray, shape (3,)
        The tip in frame f, in metres.
    T_b_board : ndarray, shape (4, 4)
        Where the board is believed to be: the tip comes down square to it.
    plane : Plane
        Where it truly is, frame b.
    sigma : float
        Standard deviation of the tip about it, in metres, in each axis.
    approach : float
        Metres above the board from which the tip comes down.
    rng : numpy.random.Generator
        Source of the errors.
    """

    arm: Arm
    tip_f: Array
    T_b_board: Array
    plane: Plane
    sigma: float
    approach: float
    rng: np.random.Generator

    @property
    def order(self) -> str:
        """The arm itself moves."""
        return "Move the probe tip down onto the board"

    def touch(self, place_b: Array) -> Array:
        """Come from above, touch, and go back up; raises as `Probe.touch` does."""
        up = self.T_b_board[:3, 2]
        below = float(self.plane.distance(place_b)) / float(self.plane.u @ up)
        contact_b = place_b - below * up + self.sigma * self.rng.standard_normal(3)
        for T_b_f in square_poses(self.T_b_board, self.tip_f, contact_b, self.arm.state().T_b_f):
            above = pose(T_b_f[:3, :3], T_b_f[:3, 3] + self.approach * up)
            try:
                self.arm.move_joint(above)
                touched = self.arm.move_linear(T_b_f).T_b_f
            except PoseUnreachable as error:
                unreachable = error
                continue
            self.arm.move_linear(above)
            return touched
        raise unreachable
