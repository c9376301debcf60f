"""A calibration verified with a line that it does not rest on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from tjscan.calibration.fits.samples import LineSample
from tjscan.calibration.models.combined import CombinedModel
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.solve.refine import predicted_residuals, refine_by_least_squares
from tjscan.calibration.solve.seen import SeenBoard

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
    board: SeenBoard, result: HandEyeCalibration, fresh: LineSample
) -> Verification:
    """Verify a calibration with a line that took no part in it.

    What arm and laser err by in all lines alike is no contradiction: the line may miss what its
    own errors, those of the calibration, and what both have in common explain.

    Parameters
    ----------
    board : SeenBoard
        The lines that `result` was found from.
    result : HandEyeCalibration
        From them.
    fresh : LineSample
        A line on the same board.
    """
    every = replace(board, samples=[*board.samples, fresh])
    used = np.array([*(one.used for one in result.residuals), False])
    start = every.start_at(result.T_f_s)
    model = CombinedModel.of([start.model], every.T_b_f, result.geometry)
    estimate = refine_by_least_squares(model, result.T_f_s, start.target, used)
    r, covariance = predicted_residuals(estimate, len(used) - 1)
    covariance = result.sigma_scale**2 * covariance
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
