"""What is tried where a section is not read: again, from beside, a shorter step, from before."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import radians
from typing import Final

import numpy as np

from tjscan.core import lie
from tjscan.core.errors import GrooveNotFound, JointMoved, PoseUnreachable, SetPointRefused
from tjscan.core.frames import Array, inverse, pose, rot_x
from tjscan.laser.profile import Profile
from tjscan.scanning.events import ScanEvent
from tjscan.scanning.section import ScannedSection
from tjscan.scanning.set_point import SetPoint
from tjscan.scanning.step_request import StepRequest
from tjscan.scanning.target import Direction

MISSING: Final = 6
"""Profiles in a row that may be missing, late, frozen or empty before the sensor is given up."""

AGAIN: Final = 1
"""Profiles taken again where points are there and no groove is read: noise is drawn anew."""

MERGED: Final = 7
"""Profiles of one place that are merged where that does not help either."""

FEW: Final = "too few points"
"""Reason of a profile that is as good as missing."""

SHIFT: Final = 6e-3
"""Metres by which a nudge moves the groove in the sensor."""

LARGEST_SHIFT: Final = 10e-3
"""Metres by which it does so on evidence."""

TURN: Final = radians(5)
"""By which a nudge turns the sensor about the groove: reflections and shadows move by more."""

EVIDENT: Final = 5e-3
"""Metres that a surface is nearer or further than at the last section to say where to go."""

ENOUGH: Final = 20
"""Points that say how far a surface is."""

SHORTER: Final = (0.5, 0.25)
"""Shares of a step that are tried: at once, and after a retreat."""

NotRead = (GrooveNotFound, SetPointRefused)
"""What a remedy may mend."""


@dataclass(frozen=True, slots=True)
class Nudge:
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

    def applied(self, to: SetPoint, direction: Direction) -> SetPoint:
        """The set-point, the groove seen otherwise."""
        turn = self.work_angle if direction is Direction.COUNTERCLOCKWISE else -self.work_angle
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


def takes(error: GrooveNotFound) -> int:
    """How many profiles are taken at one place before it is left."""
    return 1 + (MISSING if error.reason == FEW else AGAIN)


def nudges(
    error: GrooveNotFound, seen: Profile, before: ScannedSection, last: ScannedSection
) -> list[Nudge]:
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
    A surface that is nearer or further than at the last section says which way the stand-off has
    to go; a groove partly out of range may be so on either side. Otherwise the work angle is
    turned, first the way it has been going, then the other way.
    """
    nearer, further = Nudge(standoff=-SHIFT), Nudge(standoff=SHIFT)
    trend = last.groove.work_angle - before.groove.work_angle
    turn = TURN if trend >= 0 else -TURN
    turns = [Nudge(work_angle=turn), Nudge(work_angle=-turn)]
    off = _further(seen, last.view.profile)
    if abs(off) > EVIDENT:
        shift = float(np.clip(-off, -LARGEST_SHIFT, LARGEST_SHIFT))
        return [Nudge(standoff=shift), *turns]
    if error.reason == "out of range":
        return [Nudge(offset=-SHIFT), Nudge(offset=SHIFT), nearer, further]
    if error.reason == FEW:
        return [nearer, further, *turns]
    return [*turns, nearer, further]


def others(
    error: GrooveNotFound | SetPointRefused,
    to: SetPoint,
    seen: Profile,
    before: ScannedSection,
    request: StepRequest,
    direction: Direction,
) -> Iterator[tuple[str, SetPoint]]:
    """Set-points beside one that showed no groove, and what is other about them.

    Parameters
    ----------
    error : GrooveNotFound or SetPointRefused
        Why nothing was read.
    to : SetPoint
        Where nothing was read.
    seen : Profile
        What was seen last.
    before : ScannedSection
        The section before the one that the step starts from.
    request : StepRequest
        The step under way.
    direction : Direction
        Which way round.

    Notes
    -----
    Where a correction shows nothing, the prediction view did show something: half of the
    correction is made, then none of it. A prediction that was refused has no others.
    """
    if (predicted := request.predicted) is not None:
        T_b_s = to.T_b_t @ inverse(to.T_s_t)
        half = _halfway(predicted.view.T_b_s, T_b_s) @ to.T_s_t
        yield "half of the correction", replace(to, T_b_t=half)
        yield "none of the correction", SetPoint(predicted.T_b_t, predicted.T_s_t)
    elif isinstance(error, GrooveNotFound):
        for nudge in nudges(error, seen, before, request.last):
            yield str(nudge), nudge.applied(to, direction)


def climb(
    make: Callable[[float], ScannedSection],
    retreat: Callable[[], None],
    step: float,
    note: Callable[[ScanEvent, str], None],
) -> ScannedSection:
    """Make a step, or a shorter one, or one from where the last section is seen again.

    Parameters
    ----------
    make : callable
        Makes a step of a length.
    retreat : callable
        Goes back to the last section and sees that it lies where it lay.
    step : float
        Length in metres.
    note : callable
        Is told of every rung, and why it is climbed.

    Raises
    ------
    GrooveNotFound, SetPointRefused
        If the groove is not read by any of them.
    JointMoved
        If the last section is not where it was.
    PoseUnreachable
        If the step itself leads out of reach.
    """
    half, quarter = (share * step for share in SHORTER)
    try:
        return make(step)
    except NotRead as error:
        lost = error
    note(ScanEvent.HALF_STEP, f"{1e3 * half:.1f} mm: {lost}")
    try:
        return make(half)
    except NotRead as error:
        lost = error
    except PoseUnreachable:
        pass  # a shorter step on a bend may be out of reach: from before it looks otherwise
    note(ScanEvent.RETREAT, f"then {1e3 * quarter:.1f} mm: {lost}")
    try:
        retreat()
        return make(quarter)
    except PoseUnreachable:
        raise lost from None
    except JointMoved as moved:
        raise JointMoved(f"after {lost}, {moved.evidence}") from None


def _halfway(T_1: Array, T_2: Array) -> Array:
    """The pose in the middle of two."""
    turn = lie.so3_log(T_1[:3, :3].T @ T_2[:3, :3])
    R = T_1[:3, :3] @ lie.so3_exp(0.5 * turn)
    return pose(R, 0.5 * (T_1[:3, 3] + T_2[:3, 3]))


def _further(seen: Profile, usual: Profile) -> float:
    """Metres by which a surface is further away than another; 0 where nothing says so."""
    if min(seen.valid.sum(), usual.valid.sum()) < ENOUGH:
        return 0.0
    return float(np.nanmedian(seen.z_s) - np.nanmedian(usual.z_s))
