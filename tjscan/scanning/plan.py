"""What a scan is asked to do, and when a prediction view needs no correction."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians
from typing import Annotated, Final, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from tjscan.core import pose_vector, units
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.gaussian_process import Matern52, OrdinaryKriging
from tjscan.groove.section import GrooveSection
from tjscan.scanning import seam_fit
from tjscan.scanning.section import ScannedSection, Sections, SetPoint, StepLengthRule
from tjscan.scanning.settle import SettleSettings
from tjscan.scanning.target import SMOOTH_PREDICTION, ScanDirection, target_pose_in_sensor

AREA_SIGMA_SHARE: Final = 0.4
"""How much the area varies round a joint, standard deviation as a share of it."""

TRIED_STEP_LENGTHS: Final = 50
"""Lengths between the shortest and the longest that are looked at."""


@dataclass(frozen=True, slots=True)
class AdaptiveStepSettings(units.SettingsTable):
    """The table [scan.adaptive]: how much may change from section to section.

    Steps are as long as that allows; the plan's step counts for the taught poses alone.

    Parameters
    ----------
    least, most : float
        Shortest and longest step, metres.
    angle_change : float
        Of the groove angle, radians.
    area_change : float
        Of the cross-section's area, square metres.
    turn : float
        Of the groove's direction, as it bends at the last section, radians.
    """

    least: Annotated[float, Ge(5), Le(300), units.MM] = 0.01
    most: Annotated[float, Ge(5), Le(300), units.MM] = 0.08
    angle_change: Annotated[float, Gt(0), Le(90), units.DEG] = radians(3.0)
    area_change: Annotated[float, Gt(0), Le(1e5), units.MM2] = 50e-6
    turn: Annotated[float, Gt(0), Le(90), units.DEG] = radians(20.0)

    def __post_init__(self) -> None:
        if self.least > self.most:
            raise ValueError("least_mm must not be larger than most_mm")


def adaptive_step_rule(adaptive: AdaptiveStepSettings) -> StepLengthRule:
    """Rule that takes the longest step over which nothing changes by more than is allowed.

    Angle and area are smooth random functions of the groove's length, measured with the sections'
    own errors: noise is not taken for change, and what can't be foreseen shortens the step.
    A change counts as what is expected and one standard deviation more.
    """
    steps = np.linspace(adaptive.least, adaptive.most, TRIED_STEP_LENGTHS)

    def rule(sections: Sections) -> float:
        track = seam_fit.RecentSections(sections)
        values, sigmas = track.shape[:, 2], track.shape_sigmas[:, 2]
        kernel = Matern52(seam_fit.SECTION_SHAPE_SIGMAS[2], seam_fit.SECTION_SHAPE_WAVELENGTH)
        angles = OrdinaryKriging(track.along, values, sigmas, kernel)
        allowed = (
            (_likely_change(angles, steps) <= adaptive.angle_change)
            & (_likely_change(_area_process(sections, track), steps) <= adaptive.area_change)
            & (seam_fit.fit_tubes_to_sections(track).seam_curvature() * steps <= adaptive.turn)
        )
        return float(steps[max(0, int(np.logical_and.accumulate(allowed).sum()) - 1)])

    return rule


def _area_process(sections: Sections, track: seam_fit.RecentSections) -> OrdinaryKriging:
    grooves = [scan.groove for scan in sections[-seam_fit.MOST_RECENT_SECTIONS :]]
    areas = np.array([groove.area for groove in grooves])
    # A hundredth: planes that are turned a little otherwise cut a little more or less.
    sigmas = np.hypot([groove.area_sigma for groove in grooves], 0.01 * areas)
    kernel = Matern52(AREA_SIGMA_SHARE * float(areas.mean()), seam_fit.SECTION_SHAPE_WAVELENGTH)
    return OrdinaryKriging(track.along, areas, sigmas, kernel)


def _likely_change(process: OrdinaryKriging, steps: Array) -> Array:
    """How much it may change over steps from the last section: expected, and once its doubt."""
    change, sigma = process.predict_change(steps, 0.0)
    return np.asarray(np.abs(change) + sigma)


SIGMAS_ADDED_TO_VIEW_DEVIATION: Final = 2.0
"""Standard deviations that count in addition to the deviation itself."""


@dataclass(frozen=True, slots=True)
class CorrectionCriterion(units.SettingsTable):
    """Criterion, table [scan.skip], for when a view is good enough to skip the correction.

    A correction changes how the sensor looks at a section, not where the section is: its points
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
    position: Annotated[float, Gt(0), Le(50), units.MM] = 8e-3
    work_angle: Annotated[float, Gt(0), Le(30), units.DEG] = radians(5)
    rotation: Annotated[float, Gt(0), Le(30), units.DEG] = radians(8)

    def allows_skipping(self, off: Array, sigma: Array) -> bool:
        """Whether a view that is off the ideal one may be kept.

        Parameters
        ----------
        off : ndarray, shape (6,)
            Position and rotation vector in frame t, see `view_deviation`; metres and radians.
        sigma : ndarray, shape (6,)
            Their standard deviations.
        """
        doubt = SIGMAS_ADDED_TO_VIEW_DEVIATION * sigma
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
    uncertain as the worse of p2 and p4, if these are seen; the middle of the opening half as
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


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanPlan(units.SettingsTable):
    """The table [scan]: step, direction, view and end of a scan.

    Parameters
    ----------
    mode : "stepwise" or "continuous"
        Whether the arm rests for every profile, or follows the groove without a stop.
    direction : ScanDirection
        Which way round the brace.
    step : float
        Distance from section to section, d_st, metres.
    prediction : int or "smooth"
        How the motion is carried on: one of the paper's cases, or along the seam of two tubes.
    pull_angle : float
        α, radians.
    standoff : float
        z_s at which the groove's origin shall appear, metres.
    offset : float
        x_s at which it shall appear, metres; negative shows more of the brace.
    length : float, optional
        Stop after this much groove, counted from the second taught section, metres.
    sections : int, optional
        Stop after this many sections, the two taught ones included.
    return_tolerance : float
        How far a section may seem to have moved when it is seen again, metres.
    speed : float
        Of a continuous scan along the groove; limits of the arm may make it slower.
    section_spacing : float
        From section to section of a continuous scan, metres.
    horizon : float
        How far beyond the last section the path of a continuous scan may lead, metres.
    criterion : CorrectionCriterion
        When a prediction view may be the section's, and no correction is made; see `skip`.
    adaptive : AdaptiveStepSettings, optional
        What may change from section to section: it decides how long the steps are, not `step`.
    settle : SettleSettings, optional
        How well the place of rest has to be known where what carries the arm sways; profiles are
        taken one by one, as the arm arrives, if left out.
    first, second : PoseSettings, optional
        The taught poses of the flange in frame b; each station has its own.
    """

    mode: Literal["stepwise", "continuous"] = "stepwise"
    direction: Annotated[ScanDirection, units.LIST_OR_WORD_IN_FILE] = ScanDirection.COUNTERCLOCKWISE
    step: Annotated[float, Ge(5), Le(300), units.MM] = 0.04
    prediction: Annotated[Literal[1, 2, 3, 4, "smooth"], units.FileKey("prediction_case")] = 3
    pull_angle: Annotated[float, Ge(-45), Le(45), units.ZeroOrAtLeast(0.5), units.DEG] = radians(10)
    standoff: Annotated[float, Ge(10), Le(2000), units.MM] = 0.23
    offset: Annotated[
        float, Ge(-500), Le(500), units.ZeroOrAtLeast(0.1), units.MM.with_key("view_offset_mm")
    ] = -0.015
    length: Annotated[float | None, Ge(5), units.MM] = None
    sections: Annotated[int | None, Ge(3)] = None
    return_tolerance: Annotated[float, Gt(0), Le(50), units.MM.with_key("resume_tolerance_mm")] = (
        0.5e-3
    )
    speed: Annotated[float, Ge(5), Le(500), units.MM_S] = 0.07
    section_spacing: Annotated[float, Ge(0.5), Le(20), units.MM.with_key("section_mm")] = 2e-3
    horizon: Annotated[float, Ge(40), Le(500), units.MM] = 0.12
    criterion: Annotated[CorrectionCriterion, units.FileKey("skip")] = field(
        default_factory=CorrectionCriterion
    )
    adaptive: AdaptiveStepSettings | None = None
    settle: SettleSettings | None = None
    first: units.PoseSettings | None = None
    second: units.PoseSettings | None = None

    @property
    def spacing(self) -> float:
        """Distance from section to section that is asked for, metres."""
        return self.step if self.mode == "stepwise" else self.section_spacing

    @property
    def expected_sections(self) -> int | None:
        """About how many sections it will have; None if it goes on as far as it can."""
        if self.length is None or self.sections is not None:
            return self.sections
        if self.mode == "continuous":
            return 1 + round((self.step + self.length) / self.section_spacing)
        return 2 + round(self.length / self.step)

    @property
    def correction_criterion(self) -> CorrectionCriterion | None:
        """Criterion for skipping corrections; None if each is made, as in the paper."""
        enabled = self.criterion.enabled
        if enabled is None:
            enabled = self.prediction == SMOOTH_PREDICTION
        return self.criterion if enabled else None

    def target_pose_in_sensor(self, work_angle: float) -> Array:
        """T_s_t for a groove with this work angle, shape (4, 4)."""
        p_s_t = (self.offset, 0.0, self.standoff)
        return target_pose_in_sensor(work_angle, self.pull_angle, p_s_t, self.direction)
