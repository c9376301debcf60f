"""Verification of a calibration with a fresh line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.solve.combined import CombinedModel
from tjscan.calibration.solve.refine import predicted_residuals, refine_by_least_squares
from tjscan.calibration.targets.line import LineFit
from tjscan.calibration.targets.plane import SeenBoard
from tjscan.calibration.targets.target import PosedFit

FALSE_ALARM_PROBABILITY: Final = 1e-3
"""Probability to reject a good calibration."""


@dataclass(frozen=True, slots=True)
class Verification:
    """How well a fresh line agrees with what a calibration predicts.

    Parameters
    ----------
    offset, sigma_offset : float
        Distance of its centroid from the plane and its standard deviation, in metres.
    tilt, sigma_tilt : float
        Angle out of the plane and its standard deviation, in radians.
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
    board: SeenBoard, result: HandEyeCalibration, fresh: PosedFit[LineFit]
) -> Verification:
    """Verify a calibration with a line that took no part in it.

    An error of arm or laser that is alike in all lines is no contradiction: the line may be off
    by its own errors, by those of the calibration, and by errors that both have in common.

    Parameters
    ----------
    board : SeenBoard
        The lines that `result` was found from.
    result : HandEyeCalibration
        From them.
    fresh : PosedFit
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
