"""Balls and roof edges for tests and benches: what a sensor on an arm sees of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from _board import BoardSimulator
from scipy.spatial.transform import Rotation

from tjscan.calibration.closed_form import PluckerPlane, plane_through_point
from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets.ball import CircleFit, fit_circle
from tjscan.calibration.targets.line import LineFit
from tjscan.calibration.targets.plane import PlaneTarget, SeenBoard
from tjscan.calibration.targets.roof import RoofFit, fit_roof
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.frames import Array, inverse_pose, pose, transform_points
from tjscan.core.pose_vector import rotation_from_vector
from tjscan.laser.faults import correlated_noise
from tjscan.laser.model import MeasuringRange
from tjscan.laser.profile import Profile

BALL_B: Final = np.array((0.8, 0.1, 0.3))
EDGE_B: Final = np.array((0.8, 0.1, 0.25))
SLOPES: Final = np.radians((40.0, -45.0))
"""Of the roof's planes, about the y axis of b."""


def calibrate_on_plane(
    samples: Sequence[PosedFit[LineFit]],
    target: PlaneTarget | None,
    noise: NoiseModel,
    *,
    T_f_s_guess: Array | None = None,
) -> HandEyeCalibration:
    """Calibrate on lines that were seen on one board, touched or unknown."""
    return calibrate_on_targets([SeenBoard(samples, target, noise)], noise, T_f_s_guess=T_f_s_guess)


@dataclass(frozen=True, slots=True, eq=False)
class TargetSimulator:
    """What an arm with a laser sees of a ball at `BALL_B` and a roof edge through `EDGE_B`.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The truth that calibration looks for.
    window : MeasuringRange
        The laser's range.
    noise : NoiseModel
        Its and the arm's errors.
    radius : float
        Of the ball, metres.
    """

    T_f_s: Array
    window: MeasuringRange
    noise: NoiseModel
    radius: float = 0.030

    @property
    def planes(self) -> tuple[PluckerPlane, PluckerPlane]:
        """Of the roof, left and right."""
        left, right = (plane_through_point(EDGE_B, (-np.sin(s), 0.0, np.cos(s))) for s in SLOPES)
        return left, right

    def ball_profile(self, T_b_f: Array, rng: np.random.Generator) -> Profile:
        """The near side of the ball, when the arm *says* that the flange is at T_b_f."""
        noise, window = self.noise, self.window
        slip = rotation_from_vector(noise.rotation * rng.standard_normal(3))
        T_b_f = pose(T_b_f[:3, :3] @ slip, T_b_f[:3, 3] + noise.position * rng.standard_normal(3))
        centre = transform_points(inverse_pose(T_b_f @ self.T_f_s), BALL_B)
        edge = np.tan(window.half_angle)
        tangent = np.linspace(-edge, edge, window.columns)
        ray = np.column_stack((tangent, np.zeros_like(tangent), np.ones_like(tangent)))
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        away = centre - (0, 0, window.apex_z)
        nearest = ray @ away
        depth = nearest**2 - away @ away + self.radius**2
        along = nearest - np.sqrt(np.where(depth > 0, depth, np.nan))
        z = window.apex_z + along * ray[:, 2]
        return Profile(
            along * ray[:, 0], z + correlated_noise(rng, len(z), noise.range, noise.correlation)
        )

    def roof_profile(self, T_b_f: Array, rng: np.random.Generator) -> Profile:
        """The roof: the ridge is convex, so of both planes the farther one is seen."""
        seed = int(rng.integers(2**31))
        beyond = replace(self.window, near=self.window.apex_z + 1e-3, far=2.0)
        # The same seed, so that pose noise and range noise are the same for both planes.
        left, right = (
            BoardSimulator(self.T_f_s, plane, beyond, self.noise).profile(
                T_b_f, np.random.default_rng(seed)
            )
            for plane in self.planes
        )
        z = np.maximum(left.z_s, right.z_s)
        z[(z < self.window.near) | (z > self.window.far)] = np.nan
        return Profile(np.where(z == left.z_s, left.x_s, right.x_s), z)

    def poses(
        self, rng: np.random.Generator, count: int, target: str, tilt: float | None = None
    ) -> Array:
        """Flange poses with the ``ball`` or the ``roof`` in view, shape (count, 4, 4)."""
        ball = target == "ball"
        tilt = tilt if tilt is not None else 35.0 if ball else 18.0
        centre, high = (BALL_B, (0.01, 0.018, 0.27)) if ball else (EDGE_B, (0.01, 0.05, 0.24))
        found = []
        for _ in range(count):
            turn = rng.uniform(-1, 1, 3) * (tilt, tilt, 1.7 * tilt if ball else 1.5 * tilt)
            R = Rotation.from_euler("xyz", np.add(turn, (180, 0, 0)), degrees=True).as_matrix()
            seen_at = rng.uniform((-high[0], -high[1], 0.22), high)
            found.append(pose(R, centre - R @ seen_at) @ inverse_pose(self.T_f_s))
        return np.stack(found)

    def arcs(
        self, poses: Array, true: Array, rng: np.random.Generator
    ) -> list[PosedFit[CircleFit]]:
        """Arcs that the arm says it took from `poses` and took from `true`."""
        return [
            PosedFit(f"arc {i + 1}", T, fit_circle(self.ball_profile(t, rng), self.noise))
            for i, (T, t) in enumerate(zip(poses, true, strict=True))
        ]

    def roofs(self, poses: Array, true: Array, rng: np.random.Generator) -> list[PosedFit[RoofFit]]:
        """The same of the roof."""
        return [
            PosedFit(f"edge {i + 1}", T, fit_roof(self.roof_profile(t, rng), self.noise))
            for i, (T, t) in enumerate(zip(poses, true, strict=True))
        ]
