"""Whether a section that was read can be the one that was looked for."""

from __future__ import annotations

from math import radians
from typing import Final

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, rotation_angle, unit
from tjscan.groove.section import GrooveSection
from tjscan.scanning.section import ScannedSection, Substep
from tjscan.scanning.step_request import TIGHTEST, StepRequest

SHORTEST: Final = 0.3
"""Steps that a section lies ahead of the last one, at least."""

LONGEST: Final = 2.0
"""Steps that it lies ahead, at most."""

ASIDE: Final = 1.0
"""Steps that it lies aside of where the step led, at most."""

BESIDE: Final = 3e-3
"""Metres aside that need no bend of the groove: errors of reading, of the arm, of a hand."""

UPRIGHT: Final = 0.25
"""Least cosine between the wall's tangent and x_s, and between the wall's normal and the view."""

SIGMAS: Final = 5.0
"""Standard deviations by which two readings of the same groove hardly ever differ."""

OPENING: Final = (radians(3), radians(250))
"""Radians by which the opening differs from section to section, and radians per metre.

The tightest groove (see `TIGHTEST`) changes by 200° per metre; a laser plane that is turned a
little further than the last one sees a little more.
"""

WIDTH: Final = (0.1, 5.0)
DEPTH: Final = (0.1, 3.0)
"""Share by which root width and depth differ, and share per metre, of the same groove."""

SMALL: Final = 0.8e-3
"""Metres by which root width and depth may differ besides: weld beads are no planes."""


SAME: Final = 0.5e-3
"""Metres by which the corners differ that are read in two views of the same section."""

SKEW: Final = 0.08
"""Metres by which they differ more, per squared radian between the views.

A turned laser plane meets the edges elsewhere, and the edges are not quite parallel to the step:
on joints of 168 to 610 mm that made up to half of it.
"""


def check_step(found: ScannedSection, request: StepRequest) -> None:
    """Refuse a section that does not lie about a step ahead of the last one, as it was meant.

    Believed, such a section would turn the next set-point round and lead the arm astray.

    Parameters
    ----------
    found : ScannedSection
        What was read, in either substep.
    request : StepRequest
        The step that was made.

    Raises
    ------
    GrooveNotFound
        With reason "implausible": too near or too far, aside, turned, or on the wrong side.
    """
    check_side(found.groove)
    step, direction_b = request.length, request.direction_b
    gone = found.T_b_g[:3, 3] - request.start_b
    ahead = float(gone @ direction_b)
    aside = float(np.linalg.norm(gone - ahead * direction_b))
    if not (SHORTEST * step < ahead < LONGEST * step and aside < _most_aside(step)):
        raise GrooveNotFound(
            "implausible",
            f"what was read lies {1e3 * ahead:.1f} mm ahead of the last section and "
            f"{1e3 * aside:.1f} mm aside, a step of {1e3 * step:.1f} mm was made",
        )
    turn = rotation_angle(request.last.T_b_g, found.T_b_g)
    if turn > request.largest_turn:
        raise GrooveNotFound(
            "implausible",
            f"what was read is turned by {np.degrees(turn):.0f}° against the last section, over "
            f"{1e3 * step:.1f} mm",
        )


def check_side(groove: GrooveSection) -> None:
    """Refuse a section whose wall is not above it, or turns its back.

    Raises
    ------
    GrooveNotFound
        With reason "implausible".
    """
    up, towards = float(groove.T_s_g[0, 1]), -float(groove.T_s_g[2, 2])
    if min(up, towards) < UPRIGHT:
        raise GrooveNotFound(
            "implausible",
            f"the brace's wall rises by {up:.2f} of its length along x_s and faces the sensor by "
            f"{towards:.2f}: it is not above the groove",
        )


def check_measures(found: ScannedSection, request: StepRequest) -> None:
    """Refuse a section whose own measures can't follow those of the last one.

    Parameters
    ----------
    found : ScannedSection
        What was read, the laser plane turned as for the last section: measures of a plane that
        lies otherwise are other measures.
    request : StepRequest
        The step that was made.

    Raises
    ------
    GrooveNotFound
        With reason "implausible": the opening, the root or the depth jumps by more than what
        both readings are uncertain by and a groove changes over such a step.
    """
    last, now, step = request.last.groove, found.groove, request.length
    # A hand may have turned the plane of the last section otherwise.
    doubt = 2.0 if request.last.view.substep is Substep.TAUGHT else 1.0
    noise = SIGMAS * np.sqrt(
        np.diag(last.measure_covariance)[:3] + np.diag(now.measure_covariance)[:3]
    )
    before, after = _measures(last), _measures(now)
    allowed = noise + doubt * np.array(
        (
            OPENING[0] + OPENING[1] * step,
            SMALL + (WIDTH[0] + WIDTH[1] * step) * before[1],
            SMALL + (DEPTH[0] + DEPTH[1] * step) * before[2],
        )
    )
    beyond = np.abs(after - before) > allowed
    if not beyond.any():
        return
    k = int(beyond.argmax())
    name, unit = (("opening", "°"), ("root width", " mm"), ("depth", " mm"))[k]
    scale = np.degrees(1.0) if k == 0 else 1e3
    raise GrooveNotFound(
        "implausible",
        f"the {name} jumps from {scale * before[k]:.1f} to {scale * after[k]:.1f}{unit} over "
        f"{1e3 * step:.1f} mm, {scale * allowed[k]:.1f}{unit} are believed",
    )


def check_agreement(found: ScannedSection, request: StepRequest) -> None:
    """Refuse a corrected section that is another one than was predicted.

    The correction turns the sensor about the groove that the prediction view showed: seen along
    the step, its corners stay where they are. They would not, were the profile not of this view.

    Raises
    ------
    GrooveNotFound
        With reason "implausible".
    """
    if request.predicted is None:
        return
    step_b = unit(found.T_b_g[:3, 3] - request.start_b)
    apart = (found.points_b - request.predicted.points_b)[1:4]  # the ends are not corners
    aside = float(np.linalg.norm(apart - np.outer(apart @ step_b, step_b), axis=1).max())
    allowed = SAME + SKEW * rotation_angle(request.predicted.view.T_b_s, found.view.T_b_s) ** 2
    if aside > allowed:
        raise GrooveNotFound(
            "implausible",
            f"its corners lie {1e3 * aside:.1f} mm from where the prediction view showed them, "
            f"{1e3 * allowed:.1f} mm are believed",
        )


def _measures(groove: GrooveSection) -> Array:
    return np.array((groove.groove_angle, groove.root_width, groove.depth))


def _most_aside(step: float) -> float:
    """A circle leaves its tangent by step²/2R; straight on from the last chord it is twice that."""
    return min(BESIDE + step * step / TIGHTEST, ASIDE * step + BESIDE)
