"""Whether a prediction view is near enough to the ideal one that no correction is needed."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Annotated, Final

import numpy as np
from annotated_types import Gt, Le

from tjscan.core import pose_vector
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.units import DEG, MM, SettingsTable
from tjscan.groove.section import GrooveSection
from tjscan.scanning.section import ScannedSection, SetPoint
from tjscan.scanning.target import ScanDirection

DOUBT_SIGMAS: Final = 2.0
"""Standard deviations that count in addition to the deviation itself."""


@dataclass(frozen=True, slots=True)
class CorrectionCriterion(SettingsTable):
    """Criterion, table [scan.skip], for when a view is good enough to skip the correction.

    A correction changes how the sensor looks at a section, not where the section lies: its points
    are points of the groove's edges from either view. The tolerances keep the view good.

    Parameters
    ----------
    enabled : bool, optional
        Whether a correction may be left out; if this is not stated, the paper's cases always
        make it.
    position : float
        Of the groove in the laser plane, metres. About a groove the sensor's range leaves some
        centimetres free; 8 mm are a part of them.
    work_angle : float
        Of the sensor about the groove, radians. Half a narrow opening is 20°: 5° off, bevel and
        leg are seen 15° from grazing, where points begin to drop out.
    rotation : float
        Of the laser plane about the other two axes, radians. Turned by 8° beyond a pull angle of
        10° it makes a section 3.5 % wider; a hand that lags behind, the usual case, takes from
        the pull angle instead.
    """

    enabled: bool | None = None
    position: Annotated[float, Gt(0), Le(50), MM] = 8e-3
    work_angle: Annotated[float, Gt(0), Le(30), DEG] = radians(5)
    rotation: Annotated[float, Gt(0), Le(30), DEG] = radians(8)

    def allows_skipping(self, off: Array, sigma: Array) -> bool:
        """Whether a view that is off the ideal one may be kept.

        Parameters
        ----------
        off : ndarray, shape (6,)
            Position and rotation vector in frame t, see `view_deviation`; metres and radians.
        sigma : ndarray, shape (6,)
            Their standard deviations.
        """
        doubt = DOUBT_SIGMAS * sigma
        return bool(
            np.linalg.norm(off[:3]) + doubt[:3].max() <= self.position
            and abs(off[3]) + doubt[3] <= self.work_angle
            and np.linalg.norm(off[4:]) + doubt[4:].max() <= self.rotation
        )


def view_deviation(taken: ScannedSection, ideal: SetPoint) -> Array:
    """Deviation of a view from the ideal one: position and rotation vector in frame t.

    Parameters
    ----------
    taken : ScannedSection
        The section as it was seen.
    ideal : SetPoint
        From where it would best be seen.

    Returns
    -------
    ndarray, shape (6,)
        Position and rotation vector in frame t, metres and radians. The rotation about x counts
        the work angle with it.
    """
    T_t_ideal_t_taken = inverse_pose(ideal.T_b_t) @ taken.view.T_b_s @ ideal.T_s_t
    return pose_vector.pose_to_vector(T_t_ideal_t_taken)


def view_deviation_sigmas(
    groove: GrooveSection, ahead: SetPoint, step: float, direction: ScanDirection
) -> Array:
    """Standard deviations of `view_deviation`, from reading and prediction, shape (6,).

    Parameters
    ----------
    groove : GrooveSection
        What was read in the view.
    ahead : SetPoint
        The prediction, with the covariance of the ideal set-point if the predictor states it.
    step : float
        From the last section, metres.
    direction : ScanDirection
        Which way round: it decides how the work angle turns frame t.

    Notes
    -----
    Two independent estimates of the ideal set-point, the reading's and the prediction's, together
    are more certain than either: variances add as their inverses. Of the reading, the origin is as
    uncertain as the worse of p2 and p4, where these are seen; the middle of the opening half as
    much as the opening; the direction of motion as two origins a step apart.
    """
    seen = [k for k, corner in ((0, "p2"), (2, "p4")) if corner not in groove.absent] or [0, 2]
    p = max(np.trace(groove.corner_covariances_s[k]) for k in seen)
    along = 2 * p / step**2
    reading = np.array((p, p, p, 0.25 * groove.measure_covariance[0, 0], along, along))
    if ahead.covariance is None:
        return np.asarray(np.sqrt(reading))
    P = ahead.covariance
    prediction = np.diag(P)[:6].copy()
    turns = -1.0 if direction is ScanDirection.COUNTERCLOCKWISE else 1.0
    prediction[3] += P[6, 6] + 2 * turns * P[3, 6]
    total = reading + prediction
    return np.sqrt(np.divide(reading * prediction, total, out=np.zeros(6), where=total > 0))
