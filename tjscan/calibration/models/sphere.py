"""Arcs on a ball: where the laser plane cuts it, and what the errors come from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tjscan.calibration.fits.circle import CircleFit
from tjscan.calibration.models.linearised import LinearisedModel
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets import SphereTarget
from tjscan.core.frames import Array, skew_matrix


@dataclass(frozen=True, slots=True, eq=False)
class SphereModel:
    """Residuals of arcs on a ball: its centre against each arc's, and the radius of the arc.

    The target's parameters are the centre in b and how much larger the ball is than stated (than
    nothing, where its radius is unknown); metres.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.
    centres_s : ndarray, shape (n, 3)
        Of the arcs, y = 0.
    radii : ndarray, shape (n,)
        Of the arcs.
    covariances : ndarray, shape (n, 3, 3)
        Of centre x, centre z and radius of each arc.
    sphere : SphereTarget
        The ball.
    noise : NoiseModel
        For the arm's errors.
    by_laser : ndarray, shape (n, 3, m), or None
        As `circle_by_laser` gives it for each arc.
    """

    T_b_f: Array
    centres_s: Array
    radii: Array
    covariances: Array
    sphere: SphereTarget
    noise: NoiseModel
    by_laser: Array | None = None

    @classmethod
    def from_arc_fits(
        cls,
        T_b_f: Array,
        fits: list[CircleFit],
        sphere: SphereTarget,
        noise: NoiseModel,
        by_laser: Array | None = None,
    ) -> Self:
        """Model of the arcs that were seen from n poses.

        Parameters
        ----------
        T_b_f : ndarray, shape (n, 4, 4)
            Flange poses, as the arm read them.
        fits : list of CircleFit
            The arc seen from each.
        sphere : SphereTarget
            The ball.
        noise : NoiseModel
            For the arm's errors.
        by_laser : ndarray or None
            As of the class.
        """
        return cls(
            T_b_f,
            np.stack([fit.centre_s for fit in fits]),
            np.array([fit.radius for fit in fits]),
            np.stack([fit.covariance for fit in fits]),
            sphere,
            noise,
            by_laser,
        )

    def seen_from(self, T_b_f: Array) -> Self:
        """Return the same arcs, taken from other flange poses, shape (n, 4, 4)."""
        return replace(self, T_b_f=T_b_f)

    @property
    def prior_information(self) -> Array:
        """Nothing is known of the centre; of the radius, what is stated; shape (4, 4)."""
        tolerance = self.sphere.tolerance if self.sphere.radius is not None else np.inf
        return np.diag((0.0, 0.0, 0.0, tolerance**-2))

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Residuals in metres, k = 3: centre along x_s, along z_s, and the ball's radius.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (4,)
            Centre in b, and the radius less that stated, metres.
        """
        radius = (self.sphere.radius or 0.0) + float(target[3])
        R_b_f, p_b_f = self.T_b_f[:, :3, :3], self.T_b_f[:, :3, 3]
        R, n = T_f_s[:3, :3], len(self.radii)
        centre_f = np.einsum("nji,nj->ni", R_b_f, target[:3] - p_b_f)
        lever_f = centre_f - T_f_s[:3, 3]
        centre_s = lever_f @ R
        # The laser plane cuts the ball |y| from its centre: y² + r² = R².
        slant = np.hypot(centre_s[:, 1], self.radii)
        residuals = np.column_stack(
            (
                centre_s[:, 0] - self.centres_s[:, 0],
                centre_s[:, 2] - self.centres_s[:, 2],
                slant - radius,
            )
        )
        by_centre = np.zeros((n, 3, 3))
        by_centre[:, 0, 0] = by_centre[:, 1, 2] = 1.0
        by_centre[:, 2, 1] = centre_s[:, 1] / slant
        in_flange = by_centre @ R.T
        by_pose = np.concatenate((-in_flange, in_flange @ skew_matrix(lever_f)), axis=2)
        by_target = in_flange @ R_b_f.transpose(0, 2, 1)
        by_radius = np.zeros((n, 3, 1))
        by_radius[:, 2] = -1.0
        by_target = np.concatenate((by_target, by_radius), axis=2)

        by_arc = np.zeros((n, 3, 3))
        by_arc[:, 0, 0] = by_arc[:, 1, 1] = -1.0
        by_arc[:, 2, 2] = self.radii / slant
        # An error of the flange's pose moves the ball in f.
        moved_b = in_flange @ R_b_f.transpose(0, 2, 1)
        lever_b = target[:3] - p_b_f
        by_arm = np.concatenate((-moved_b, moved_b @ skew_matrix(lever_b)), axis=2)
        own = by_arc @ self.covariances @ by_arc.transpose(0, 2, 1)
        by_laser = None if self.by_laser is None else by_arc @ self.by_laser
        return LinearisedModel(residuals, by_pose, by_target, by_arm, own, self.noise, by_laser)
