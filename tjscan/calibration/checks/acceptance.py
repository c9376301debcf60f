"""Quality of an estimate: residuals of each profile, and refusal of bad results."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.calibration.checks.motion import MAX_CONDITION
from tjscan.calibration.result import HandEyeUncertainty, SampleResidual
from tjscan.calibration.solve.refine import RefinedEstimate, leave_one_out_changes
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
    deletion = leave_one_out_changes(estimate)
    found = []
    for i, name in enumerate(names):
        r = settled.stacked.residuals[settled.stacked.profile == i]
        off, misfit = _offset_and_tilt(r), np.sqrt(deletion.chi2[i] / len(r))
        used, step = estimate.used[i], deletion.step[i]
        found.append(SampleResidual.from_changes(name, used, off, misfit, step))
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
