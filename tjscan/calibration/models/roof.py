"""Lines on the two planes of a roof edge: offset and tilt of each, and what their errors share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tjscan.calibration.fits.roof import RoofFit
from tjscan.calibration.models.linearised import LinearisedModel
from tjscan.calibration.models.plane import PlaneModel
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets import RoofTarget
from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True, eq=False)
class RoofModel:
    """Residuals of both flanks of a roof edge; the arm's errors move both together.

    The target's parameters are those of the left plane, then those of the right one.

    Parameters
    ----------
    left, right : PlaneModel
        The lines on either plane, from the same poses.
    """

    left: PlaneModel
    right: PlaneModel

    @classmethod
    def from_roof_fits(
        cls,
        T_b_f: Array,
        fits: list[RoofFit],
        roof: RoofTarget,
        noise: NoiseModel,
        by_laser: Array | None = None,
    ) -> Self:
        """Model of the flanks that were seen from n poses.

        Parameters
        ----------
        T_b_f : ndarray, shape (n, 4, 4)
            Flange poses, as the arm read them.
        fits : list of RoofFit
            The flanks seen from each.
        roof : RoofTarget
            The planes that steps count from.
        noise : NoiseModel
            For the arm's errors.
        by_laser : ndarray, shape (n, 4, m), or None
            As `roof_by_laser` gives it for each roof.
        """
        left, right = (None, None) if by_laser is None else np.split(by_laser, 2, axis=1)
        lefts, rights = [fit.left for fit in fits], [fit.right for fit in fits]
        return cls(
            PlaneModel.from_line_fits(T_b_f, lefts, roof.left, noise, left),
            PlaneModel.from_line_fits(T_b_f, rights, roof.right, noise, right),
        )

    def seen_from(self, T_b_f: Array) -> Self:
        """Return the same flanks, taken from other flange poses, shape (n, 4, 4)."""
        left, right = (one.seen_from(T_b_f) for one in (self.left, self.right))
        return replace(self, left=left, right=right)

    @property
    def prior_information(self) -> Array:
        """Nothing is known of either plane: zeros, shape (6, 6)."""
        return np.zeros((6, 6))

    def linearise(self, T_f_s: Array, target: Array) -> LinearisedModel:
        """Offset and tilt on the left plane, then on the right one, k = 4, with derivatives.

        Parameters
        ----------
        T_f_s : ndarray, shape (4, 4)
            The sensor on the flange.
        target : ndarray, shape (6,)
            Tilt, tilt (radians) and height (metres) of the left plane, then of the right one.
        """
        left = self.left.linearise(T_f_s, target[:3])
        right = self.right.linearise(T_f_s, target[3:])
        n = len(left.residuals)
        by_target, own = np.zeros((n, 4, 6)), np.zeros((n, 4, 4))
        by_target[:, :2, :3], by_target[:, 2:, 3:] = left.by_target, right.by_target
        own[:, :2, :2], own[:, 2:, 2:] = left.own_covariance, right.own_covariance
        by_laser = None
        if left.by_laser is not None and right.by_laser is not None:
            by_laser = np.concatenate((left.by_laser, right.by_laser), axis=1)
        return LinearisedModel(
            np.concatenate((left.residuals, right.residuals), axis=1),
            np.concatenate((left.by_pose, right.by_pose), axis=1),
            by_target,
            np.concatenate((left.by_arm, right.by_arm), axis=1),
            own,
            left.noise,
            by_laser,
        )
