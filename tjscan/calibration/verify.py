"""A calibration verified with a line that it does not rest on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtri

from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.plane_model import PlaneModel
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.samples import LineSample

FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to reject a good calibration."""


@dataclass(frozen=True, slots=True)
class Verification:
    """How well a fresh line agrees with what a calibration predicts.

    Parameters
    ----------
    offset, sigma_offset : float
        Distance of its centroid from the plane, and what it may be, in metres.
    tilt, sigma_tilt : float
        Angle out of the plane, and what it may be, in radians.
    misfit : float
        Both together, in standard deviations (RMS of the two).
    limit : float
        The largest misfit that chance explains.
    """

    offset: float
    sigma_offset: float
    tilt: float
    sigma_tilt: float
    misfit: float
    limit: float

    @property
    def agrees(self) -> bool:
        """Whether the line is as the calibration predicts, within chance."""
        return self.misfit <= self.limit


def verify_with_fresh_line(
    result: HandEyeCalibration, fresh: LineSample, noise: NoiseModel
) -> Verification:
    """Verify a calibration with a line that took no part in it.

    Parameters
    ----------
    result : HandEyeCalibration
        From lines on a plane.
    fresh : LineSample
        A line on the same plane that `result` does not rest on.
    noise : NoiseModel
        Errors of line and pose.

    Raises
    ------
    ValueError
        If the calibration was made on a sphere.
    """
    if result.board is None:
        raise ValueError("only a calibration on a plane can be verified with a line")
    model = PlaneModel.from_line_fits(fresh.T_b_f[None], [fresh.fit], result.board, noise)
    found = model.linearise(result.T_f_s, np.zeros(3))
    J = np.concatenate((found.by_pose, found.by_target), axis=2)[0]
    covariance = result.sigma_scale**2 * found.covariance[0] + J @ result.joint_covariance @ J.T
    r = found.residuals[0]
    sigma = np.sqrt(np.diag(covariance))
    misfit = np.sqrt(r @ np.linalg.solve(covariance, r) / 2)
    return Verification(
        float(r[0]),
        float(sigma[0]),
        float(r[1]),
        float(sigma[1]),
        float(misfit),
        float(np.sqrt(chdtri(2, FALSE_ALARM_PROBABILITY) / 2)),
    )
