"""Every retry of a scan: what is tried again if a section is not read, how often, and why.

The scanner goes through them from the mildest to the strongest: another profile at the same place,
several of them merged, the same section from a set-point beside, a shorter step, a shorter step
from where the last section is seen again, and a step past what may hide the groove.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import radians
from typing import Final

import numpy as np

from tjscan.core import pose_vector
from tjscan.core.errors import GrooveNotFound, SetPointTooFar, TjscanError
from tjscan.core.frames import Array, inverse_pose, pose, rot_x
from tjscan.laser.profile import Profile
from tjscan.scanning.journal import ScanEvent
from tjscan.scanning.section import ScannedSection, SetPoint, StepRequest
from tjscan.scanning.target import ScanDirection

NotRead = (GrooveNotFound, SetPointTooFar)
"""What another set-point or another step may mend."""

MOST_MISSING_PROFILES: Final = 6
"""Profiles in a row that may be missing, late, frozen or empty before the sensor is given up."""

REPEATED_PROFILES: Final = 1
"""Profiles taken again if points are there and no groove is read: noise is another each time."""

MERGED_PROFILES: Final = 7
"""Profiles of one place that are merged if that does not help either."""

TOO_FEW_POINTS: Final = "too few points"
"""Reason of a profile that is as good as missing."""


SHORTER_STEP_SHARES: Final = (0.5, 0.25)
"""Shares of a step that are tried if it led to no section: the groove changes less, and fewer
poses are out of reach."""

TACK_SKIP_LENGTHS: Final = (0.03, 0.06)
"""Metres that are tried after that, where they are more than a step: tack welds are 20 to 50 mm
long, and what hides the groove may be all over one."""


@dataclass(frozen=True, slots=True)
class StepRetry:
    """Retry with another step after a step that led to no section.

    Parameters
    ----------
    event : ScanEvent
        Its name in journals and recordings.
    length : float
        Metres.
    from_last_section : bool
        Whether the arm first returns to the last section and checks that it is where it was.
    """

    event: ScanEvent
    length: float
    from_last_section: bool = False

    def describe(self, error: TjscanError) -> str:
        """Describe in a sentence what is retried, and why."""
        then = "then " if self.from_last_section else ""
        return f"{then}{1e3 * self.length:.1f} mm: {error}"


def step_retries(step: float, *, past_tacks: bool = True) -> Iterator[StepRetry]:
    """The steps that are tried in place of one that led to no section.

    Parameters
    ----------
    step : float
        Length of the one, metres.
    past_tacks : bool
        Whether something may hide the groove: then longer ones are tried in the end.

    Yields
    ------
    StepRetry
        Shorter ones first, the second from where the last section is seen again: an arm that
        lost its way finds it so.
    """
    half, quarter = SHORTER_STEP_SHARES
    yield StepRetry(ScanEvent.HALF_STEP, half * step)
    yield StepRetry(ScanEvent.RETREAT, quarter * step, from_last_section=True)
    for length in TACK_SKIP_LENGTHS:
        if past_tacks and length > step:
            yield StepRetry(ScanEvent.STEP_OVER, length, from_last_section=True)


NUDGE_SHIFT: Final = 6e-3
"""Metres by which a nudge moves the groove in the sensor."""

LARGEST_RETRY_SHIFT: Final = 10e-3
"""Metres by which it does so if the surface was seen nearer or further."""

NUDGE_TURN: Final = radians(5)
"""By which a nudge turns the sensor about the groove: reflections and shadows move by more."""

EVIDENT_RANGE_CHANGE: Final = 5e-3
"""Metres that a surface is nearer or further than at the last section to show where to go."""

FEWEST_RANGE_POINTS: Final = 20
"""Points that show how far a surface is."""


@dataclass(frozen=True, slots=True)
class ViewAdjustment:
    """A small change of where the sensor looks from.

    Parameters
    ----------
    offset, standoff : float
        By how much the groove shall appear higher (x_s) and further (z_s), metres.
    work_angle : float
        By how much higher the sensor is raised about the groove, radians.
    """

    offset: float = 0.0
    standoff: float = 0.0
    work_angle: float = 0.0

    def adjusted_set_point(self, to: SetPoint, direction: ScanDirection) -> SetPoint:
        """Set-point with its view adjusted.

        Parameters
        ----------
        to : SetPoint
            Where the groove was to be seen from.
        direction : ScanDirection
            Which way round: it decides how the work angle turns frame t.
        """
        turn = self.work_angle if direction is ScanDirection.COUNTERCLOCKWISE else -self.work_angle
        T_s_t = to.T_s_t @ pose(rot_x(turn))  # (14), (15): the work angle turns last
        T_s_t[0, 3] += self.offset
        T_s_t[2, 3] += self.standoff
        return replace(to, T_s_t=T_s_t)

    def __str__(self) -> str:
        parts = (
            (1e3 * self.offset, "mm view offset"),
            (1e3 * self.standoff, "mm stand-off"),
            (np.degrees(self.work_angle), "° work angle"),
        )
        return ", ".join(f"{value:+.1f} {name}" for value, name in parts if value)


def max_profiles_per_pose(error: GrooveNotFound) -> int:
    """How many profiles are taken at one place before it is left."""
    return 1 + (MOST_MISSING_PROFILES if error.reason == TOO_FEW_POINTS else REPEATED_PROFILES)


def view_adjustments(
    error: GrooveNotFound, seen: Profile, before: ScannedSection, last: ScannedSection
) -> list[ViewAdjustment]:
    """What to change about the view, likeliest first.

    Parameters
    ----------
    error : GrooveNotFound
        Why nothing was read.
    seen : Profile
        What was seen.
    before, last : ScannedSection
        The last two sections: where the surface was seen, and which way the work angle goes.

    Notes
    -----
    A surface that is nearer or further than at the last section shows which way the stand-off has
    to go; a groove partly out of range may be so on either side. Otherwise the work angle is
    turned, first the way it has been going, then the other way.
    """
    nearer, further = ViewAdjustment(standoff=-NUDGE_SHIFT), ViewAdjustment(standoff=NUDGE_SHIFT)
    trend = last.groove.work_angle - before.groove.work_angle
    turn = NUDGE_TURN if trend >= 0 else -NUDGE_TURN
    turns = [ViewAdjustment(work_angle=turn), ViewAdjustment(work_angle=-turn)]
    off = _distance_beyond_usual(seen, last.view.profile)
    if abs(off) > EVIDENT_RANGE_CHANGE:
        shift = float(np.clip(-off, -LARGEST_RETRY_SHIFT, LARGEST_RETRY_SHIFT))
        return [ViewAdjustment(standoff=shift), *turns]
    if error.reason == "out of range":
        aside = [ViewAdjustment(offset=-NUDGE_SHIFT), ViewAdjustment(offset=NUDGE_SHIFT)]
        return [*aside, nearer, further]
    if error.reason == TOO_FEW_POINTS:
        return [nearer, further, *turns]
    return [*turns, nearer, further]


def fallback_set_points(
    error: GrooveNotFound | SetPointTooFar,
    to: SetPoint,
    seen: Profile,
    before: ScannedSection,
    step: StepRequest,
    direction: ScanDirection,
) -> Iterator[tuple[str, SetPoint]]:
    """Set-points beside one that showed no groove, and what is other about them.

    Parameters
    ----------
    error : GrooveNotFound or SetPointTooFar
        Why nothing was read.
    to : SetPoint
        Where nothing was read.
    seen : Profile
        What was seen last.
    before : ScannedSection
        The section before the one that the step starts from.
    step : StepRequest
        The step under way.
    direction : ScanDirection
        Which way round.

    Notes
    -----
    If a correction shows nothing, the prediction view did show something: half of the
    correction is made, then none of it. A prediction that was refused has no others.
    """
    if (predicted := step.predicted) is not None:
        T_b_s = to.T_b_t @ inverse_pose(to.T_s_t)
        half = _pose_halfway(predicted.view.T_b_s, T_b_s) @ to.T_s_t
        yield "half of the correction", replace(to, T_b_t=half)
        yield "none of the correction", SetPoint(predicted.T_b_t, predicted.T_s_t)
    elif isinstance(error, GrooveNotFound):
        for nudge in view_adjustments(error, seen, before, step.last):
            yield str(nudge), nudge.adjusted_set_point(to, direction)


def _pose_halfway(T_1: Array, T_2: Array) -> Array:
    """The pose in the middle of two."""
    turn = pose_vector.rotation_to_vector(T_1[:3, :3].T @ T_2[:3, :3])
    R = T_1[:3, :3] @ pose_vector.rotation_from_vector(0.5 * turn)
    return pose(R, 0.5 * (T_1[:3, 3] + T_2[:3, 3]))


def _distance_beyond_usual(seen: Profile, usual: Profile) -> float:
    """Metres by which a surface is further away than another; 0 if nothing shows it."""
    if min(seen.valid.sum(), usual.valid.sum()) < FEWEST_RANGE_POINTS:
        return 0.0
    return float(np.nanmedian(seen.z_s) - np.nanmedian(usual.z_s))
