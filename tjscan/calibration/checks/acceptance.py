"""Quality of an estimate: residuals of each profile, and refusal of bad results."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from tjscan.calibration.checks.motion import MAX_CONDITION
from tjscan.calibration.noise import geometry_correlation
from tjscan.calibration.result import HandEyeCalibration, HandEyeUncertainty, SampleResidual
from tjscan.calibration.solve import refine
from tjscan.calibration.solve.combined import CombinedModel
from tjscan.calibration.solve.refine import RefinedEstimate
from tjscan.calibration.targets.line import LineFit
from tjscan.calibration.targets.plane import SeenBoard
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array

MAX_SIGMA_SCALE: Final = 3.0
"""Residuals so many times larger than stated contradict the noise model. Smaller excess, if it is
significant, widens the covariance."""
MAX_SIGMA_SCALE_AFTER_REJECTION: Final = 2.0
"""The same limit if profiles were left out: without the worst ones the others look better than
they are, and which ones are bad is itself in doubt."""
MAX_SIGMA_POSITION: Final = 5e-3
MAX_SIGMA_ROTATION: Final = float(np.radians(1.0))
"""Metres and radians RMS; a drawing of the bracket is better than a calibration less certain."""


def check_scaled_condition(estimate: RefinedEstimate) -> float:
    """Condition of the pose's normal equations, each parameter in units of its own certainty.

    Parameters
    ----------
    estimate : RefinedEstimate
        Of any targets.

    Raises
    ------
    CalibrationRefused
        If some combination of the parameters is much less certain than each of them.
    """
    covariance = estimate.covariance[:6, :6]
    sigma = np.sqrt(np.diag(covariance))
    values = np.linalg.eigvalsh(covariance / np.outer(sigma, sigma))
    condition = float(np.sqrt(values[-1] / max(values[0], 1e-300)))
    if condition > MAX_CONDITION:
        raise CalibrationRefused(
            "ill-conditioned",
            f"the condition number is {condition:.0f}, the limit {MAX_CONDITION:.0f}; see the "
            "target from more directions and at different heights",
        )
    return condition


def sample_residuals(
    names: list[str], estimate: RefinedEstimate, settled: RefinedEstimate
) -> tuple[SampleResidual, ...]:
    """Residuals of each profile, and the change of the result without it.

    Parameters
    ----------
    names : list of str
        Of the profiles, in order.
    estimate : RefinedEstimate
        From these profiles.
    settled : RefinedEstimate
        The same with the targets where the arm sees them; see `settle_targets`.
    """
    falls, steps = refine.leave_one_out_changes(estimate)
    found = []
    for i, name in enumerate(names):
        r = settled.stacked.residuals[settled.stacked.profile == i]
        off, misfit = _offset_and_tilt(r), np.sqrt(falls[i] / len(r))
        found.append(SampleResidual.from_changes(name, estimate.used[i], off, misfit, steps[i]))
    return tuple(found)


def _offset_and_tilt(r: Array) -> tuple[float, float | None]:
    """Of a line (2 residuals), an arc (3) or a roof (4: two lines)."""
    if len(r) == 3:
        return float(np.hypot(r[0], r[1])), None
    offsets, tilts = r[0::2], r[1::2]
    return float(offsets[np.argmax(np.abs(offsets))]), float(tilts[np.argmax(np.abs(tilts))])


def residual_excess(estimate: RefinedEstimate, residuals: tuple[SampleResidual, ...]) -> float:
    """By how much residuals exceed the noise model: one unless that is significant.

    Parameters
    ----------
    estimate : RefinedEstimate
        Of all profiles.
    residuals : tuple of SampleResidual
        Of its profiles, to name the worst.

    Raises
    ------
    CalibrationRefused
        If they are larger than any noise model within reason allows.
    """
    sigma_scale = estimate.sigma_scale
    if sigma_scale <= (MAX_SIGMA_SCALE if estimate.used.all() else MAX_SIGMA_SCALE_AFTER_REJECTION):
        return sigma_scale
    worst = sorted(residuals, key=lambda one: -one.misfit)[:3]
    shown = ", ".join(
        f"{one.name} ({1e3 * one.offset:+.2f} mm"
        + ("" if one.tilt is None else f", {np.degrees(one.tilt):+.2f}°")
        + ")"
        for one in worst
    )
    raise CalibrationRefused(
        "residuals that the noise model can't explain",
        f"they are {sigma_scale:.1f} times larger than stated range and pose noise allow; worst "
        f"are {shown}. Check the sensor's own calibration, that board and sensor sit tight and "
        "that each line belongs to its pose; or state the noise that this cell really has",
    )


def check_certainty(covariance: Array) -> None:
    """Refuse a result that is worse than a drawing of the bracket.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
        Of T_f_s.

    Raises
    ------
    CalibrationRefused
        With how uncertain it is.
    """
    sure = HandEyeUncertainty(covariance)
    if sure.position > MAX_SIGMA_POSITION or sure.rotation > MAX_SIGMA_ROTATION:
        raise CalibrationRefused(
            "too uncertain",
            f"the sensor's place is certain to {1e3 * sure.position:.2f} mm and "
            f"{np.degrees(sure.rotation):.2f}° only; take more lines, tilted further, and turned "
            "about the board's normal",
        )


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
    by its own errors, by errors of the calibration, and by errors that both have in common.

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
    plane, start = every.start_at(result.T_f_s)
    model = CombinedModel((plane,), geometry_correlation(every.T_b_f), result.geometry)
    estimate = refine.refine_by_least_squares(model, result.T_f_s, start, used)
    r, covariance = refine.predicted_residuals(estimate, len(used) - 1)
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
