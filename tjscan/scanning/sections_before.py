"""Reading a section with what those before it show, and checking that it can follow them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import dist, isnan, nan, radians
from typing import Final, Protocol

import numpy as np

from tjscan.core.errors import ConfigurationError, GrooveNotFound, SetPointTooFar
from tjscan.core.frames import Array, inverse_pose, rotation_angle_between, unit_vector
from tjscan.groove.prior import GroovePrior
from tjscan.groove.root import (
    BURIED_DEPTH_IN_CHORDS,
    ROOT_NOT_SEEN,
    WELD_IN_GROOVE,
    WELD_IN_ROOT,
)
from tjscan.groove.section import TACK_WELD, GrooveSection, section_from_points
from tjscan.laser.profile import Profile
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import (
    TIGHTEST_GROOVE_BEND_RADIUS,
    ProfileView,
    ScannedSection,
    Sections,
    SetPoint,
    StepRequest,
    Substep,
)
from tjscan.scanning.target import ScanDirection

FARTHEST_SET_POINT_STEPS: Final = 2.0
"""Steps that a set-point lies from the last section, at most."""

LARGEST_VIEW_SHIFT: Final = 0.02
"""Metres that the groove may be meant to appear from where the plan wants it in the sensor."""

ORTHONORMAL_TOLERANCE: Final = 1e-6
"""How far from orthonormal a rotation may be that was computed."""


def check_set_point(to: SetPoint, step: StepRequest, plan: ScanPlan) -> None:
    """Refuse a set-point that is further from the last section than its step allows.

    Parameters
    ----------
    to : SetPoint
        Of either substep.
    step : StepRequest
        The step under way.
    plan : ScanPlan
        Where in the sensor the groove shall appear.

    Raises
    ------
    SetPointTooFar
        If it is no pose, too far away, turned too far, or at another stand-off than was planned.
    """
    for name, T in (("T_b_t", to.T_b_t), ("T_s_t", to.T_s_t)):
        if not _is_rigid_pose(T):
            raise SetPointTooFar(f"its {name} is no pose")
    p_b = to.T_b_t[:3, 3]
    starts = (step.groove_origin_b, step.last.T_b_t[:3, 3])
    away = min(float(np.linalg.norm(p_b - start)) for start in starts)
    if not away <= FARTHEST_SET_POINT_STEPS * step.length:  # a length that is no number allows none
        raise SetPointTooFar(
            f"it is {1e3 * away:.1f} mm from the last section, after a step of "
            f"{1e3 * step.length:.1f} mm"
        )
    T_b_s = to.T_b_t @ inverse_pose(to.T_s_t)
    turn = rotation_angle_between(step.last.view.T_b_s, T_b_s)
    if turn > step.max_rotation:
        raise SetPointTooFar(
            f"it turns the sensor by {np.degrees(turn):.0f}° from the last section, "
            f"{np.degrees(step.max_rotation):.0f}° are plausible for a step of "
            f"{1e3 * step.length:.1f} mm"
        )
    beside = float(np.linalg.norm(to.T_s_t[:3, 3] - (plan.offset, 0.0, plan.standoff)))
    if beside > LARGEST_VIEW_SHIFT:
        raise SetPointTooFar(
            f"the groove would appear {1e3 * beside:.1f} mm from where it is planned in the sensor"
        )


def _is_rigid_pose(T: Array) -> bool:
    if T.shape != (4, 4) or not np.isfinite(T).all() or np.abs(T).max() > 1e6:
        return False
    R = T[:3, :3]
    orthonormal = np.abs(R @ R.T - np.eye(3)).max() < ORTHONORMAL_TOLERANCE and np.linalg.det(R) > 0
    return bool(orthonormal and (T[3] == (0.0, 0.0, 0.0, 1.0)).all())


MOST_PRIOR_SECTIONS: Final = 30
"""Sections that are looked back upon."""

KNOWN_ROOT_SIGMA: Final = 1e-3
"""Standard deviation of a corner of the root in metres from which a view does not show it well: a
fifth of a usual root's width."""

ROOT_WIDENING_LENGTH: Final = 0.02
"""Metres of groove over which a root may go on widening: round a joint it goes to and fro."""

SECTION_STEPS_AHEAD_BOUNDS: Final = (0.3, 2.0)
"""Steps that a section is ahead of the last one, at least and at most."""

MOST_SECTION_STEPS_ASIDE: Final = 1.0
"""Steps that it is aside of the end of the step, at most."""

SIDE_ALLOWANCE: Final = 3e-3
"""Metres aside that need no bend of the groove: errors of reading, of the arm, of teaching."""

LEAST_UPRIGHT_COSINE: Final = 0.25
"""Least cosine between the wall's tangent and x_s, and between the wall's normal and the view."""

LARGEST_CHANCE_SIGMAS: Final = 5.0
"""Standard deviations by which two readings of the same groove hardly ever differ."""

LARGEST_GROOVE_ANGLE_CHANGE: Final = (radians(3), radians(250))
"""Radians by which the groove angle differs from section to section, and radians per metre.

The tightest groove (see `TIGHTEST_GROOVE_BEND_RADIUS`) changes by 200° per metre; a laser plane
that is turned a little further than the last one sees a little more.
"""

LARGEST_ROOT_CHANGE: Final = (0.1, 5.0)
LARGEST_DEPTH_CHANGE: Final = (0.1, 3.0)
"""Share by which root width and depth differ, and share per metre, of the same groove."""

BEAD_HEIGHT_ALLOWANCE: Final = 0.8e-3
"""Metres by which root width and depth may differ in addition: weld beads are no planes."""

SAME_SECTION_DISTANCE: Final = 0.5e-3
"""Metres by which the corners differ that are read in two views of the same section."""

SAME_SECTION_DISTANCE_PER_SQUARED_TURN: Final = 0.08
"""Metres by which they differ more, per squared radian between the views.

A turned laser plane meets the edges elsewhere, and the edges are not quite parallel to the step:
on joints of 168 to 610 mm that made up to half of it.
"""


LARGEST_SLOPE_OFF: Final = 0.2
"""Metres by which a groove, per metre along it, leaves its direction as it is known, at most."""

TACK_END_LENGTH: Final = 4e-3
"""Metres beyond a tack weld within which its end may reach."""

PLANNING_SPACING: Final = 8e-3
"""Metres between the sections of a continuous scan that are looked back upon: so they reach as far
back as those of a stepwise one."""


def planning_sections(sections: Sections) -> list[ScannedSection]:
    """The last sections that are `PLANNING_SPACING` or more from each other, the oldest first."""
    chosen, origin = [sections[-1]], sections[-1].T_b_g[:3, 3]
    for section in reversed(sections):
        if dist(here := section.T_b_g[:3, 3], origin) >= PLANNING_SPACING:
            chosen.append(section)
            origin = here
            if len(chosen) == MOST_PRIOR_SECTIONS:
                break
    return chosen[::-1]


class GrooveReader(Protocol):
    """Reads the groove in a profile, or raises GrooveNotFound."""

    def __call__(self, profile: Profile, *, prior: GroovePrior | None = None) -> GrooveSection:
        """Read, with what the sections before the profile's show of it; with None, without."""
        ...


def prior_for_view(view: ProfileView, sections: Sections) -> GroovePrior:
    """What the finished sections show of the one that a view is taken for."""
    before = [one for one in sections if one.view.index < view.index][-MOST_PRIOR_SECTIONS:]
    if not before:
        return GroovePrior()
    origins = np.array([one.T_b_g[:3, 3] for one in before])
    steps = np.linalg.norm(np.diff(origins, axis=0), axis=1)
    # Ahead of the last section the sensor has gone as far as the groove.
    last = float(np.linalg.norm(view.T_b_s[:3, 3] - before[-1].view.T_b_s[:3, 3]))
    aways = np.append(steps, last)[::-1].cumsum()[::-1]
    seen = ((one.groove.evidence, away) for one, away in zip(before, aways.tolist(), strict=True))
    return GroovePrior.from_sections([(found, away) for found, away in seen if found is not None])


def read_section(
    read: GrooveReader,
    view: ProfileView,
    T_s_t: Array | Callable[[GrooveSection], Array],
    before: Sections,
) -> ScannedSection:
    """Read a section as a scan does: with what the sections before it show, tack welds named.

    Parameters
    ----------
    read : callable
        The reader of the scan.
    view : ProfileView
    T_s_t : ndarray, shape (4, 4), or callable
        Frame t in the sensor, or what gives it for a groove.
    before : sequence of ScannedSection
        The finished sections.

    Raises
    ------
    GrooveNotFound
        As the reader does.
    """
    if view.substep is Substep.FUSED and before:
        before = planning_sections(before)
    groove = read(view.profile, prior=prior_for_view(view, before))
    T = T_s_t(groove) if callable(T_s_t) else T_s_t
    return name_tack_of_section(ScannedSection(view, groove, T), before)


def root_is_seen(groove: GrooveSection) -> bool:
    """Whether the root shows, or what covers it; another view may show one that does not."""
    return not groove.absent or groove.on_tack or not isnan(groove.root_opening)


def root_is_known(groove: GrooveSection) -> bool:
    """Whether the root's corners are known well, as far as they are there."""
    variances = np.trace(groove.corner_covariances_s[1:], axis1=1, axis2=2)
    known = bool(np.sqrt(variances.max()) < KNOWN_ROOT_SIGMA)
    return known if not groove.absent else root_is_seen(groove)


def name_tack_of_section(found: ScannedSection, before: Sections) -> ScannedSection:
    """Name a tack weld where weld metal is higher in the root than before it.

    One profile shows a convex face in the root; whether that is the root bead or a tack over it
    shows the root that was seen last: no groove widens and grows shallower so fast.

    Parameters
    ----------
    found : ScannedSection
        As its profile alone was read.
    before : sequence of ScannedSection
        The sections before it.
    """
    groove = found.groove
    whole = (one for one in reversed(before) if not one.groove.absent)
    last = next((one for one in whole if root_is_known(one.groove)), None)
    if last is None or WELD_IN_ROOT not in groove.conditions:
        return found
    away = float(np.linalg.norm(found.T_b_g[:3, 3] - last.T_b_g[:3, 3]))
    wider = groove.root_width - last.groove.root_width
    shallower = last.groove.depth - groove.depth
    most_wider = largest_root_width_change(last.groove, min(away, ROOT_WIDENING_LENGTH))
    if wider < most_wider or shallower < BEAD_HEIGHT_ALLOWANCE:
        return found
    return replace(found, groove=_with_buried_root(groove))


def name_tack_ends(sections: Sections) -> tuple[ScannedSection, ...]:
    """Name the sections of a continuous scan that a tack weld's end reaches, as on it.

    Those next to a named one in which weld or nothing shows for the root belong to the tack. About
    its end, which tapers, a root seen half under it is read beside its edges.

    Parameters
    ----------
    sections : sequence of ScannedSection
        All of the scan, in order; those of a stepwise one stay as they are.
    """
    grooves, edge = [s.groove for s in sections], np.array([s.points_b[1] for s in sections])
    if not any(groove.on_tack for groove in grooves):
        return tuple(sections)
    near = np.linalg.norm(edge[:, None] - edge, axis=2) <= TACK_END_LENGTH
    hidden = np.array([WELD_IN_GROOVE in g.conditions or not root_is_known(g) for g in grooves])
    tack, before = np.array([groove.on_tack for groove in grooves]), -1
    while tack.sum() > before:
        before = tack.sum()
        tack |= hidden & (np.convolve(tack, np.ones(3), "same") > 0)
    return tuple(
        replace(one, groove=_with_buried_root(one.groove))
        if beside and not one.groove.on_tack and one.view.substep is Substep.FUSED
        else one
        for one, beside in zip(sections, near[:, tack].any(axis=1), strict=True)
    )


def _with_buried_root(groove: GrooveSection) -> GrooveSection:
    """The same section with its root under a tack weld."""
    covariance = groove.covariance_s.copy()
    up = groove.points_s[1] - groove.points_s[2]
    for k, along in ((2, up / np.linalg.norm(up)), (4, groove.leg_s)):
        way = BURIED_DEPTH_IN_CHORDS * groove.root_width * along[[0, 2]]
        covariance[k : k + 2, k : k + 2] += np.outer(way, way)
    section = section_with_corners(groove, groove.points_s, covariance)
    shown = (WELD_IN_ROOT, WELD_IN_GROOVE, ROOT_NOT_SEEN)
    others = tuple(one for one in groove.conditions if one not in shown)
    return replace(section, conditions=(TACK_WELD, *others), absent=("p3", "p4"), root_opening=nan)


def section_with_corners(
    groove: GrooveSection, points_s: Array, covariance_s: Array
) -> GrooveSection:
    """The same section with its corners elsewhere, or known otherwise.

    Parameters
    ----------
    groove : GrooveSection
    points_s : ndarray, shape (5, 3)
        p1 to p5 in frame s, metres.
    covariance_s : ndarray, shape (6, 6)
        Of x and z of p2, p3 and p4, in m².
    """
    covariance = np.zeros((8, 8))
    covariance[:6, :6], covariance[6:, 6:] = covariance_s, groove.tangent_covariance
    section = section_from_points(
        points_s,
        wall_s=groove.wall_s,
        leg_s=groove.leg_s,
        rms=groove.rms,
        covariance=covariance,
    )
    return replace(
        section,
        model=groove.model,
        model_probability=groove.model_probability,
        conditions=groove.conditions,
        absent=groove.absent,
        root_opening=groove.root_opening,
        evidence=groove.evidence,
    )


def _implausible_reading(evidence: str) -> GrooveNotFound:
    return GrooveNotFound("implausible", evidence)


def check_section_one_step_ahead(found: ScannedSection, step: StepRequest) -> None:
    """Refuse a section that is not about a step ahead of the last one, as it was meant.

    Were it accepted, such a section would turn the next set-point round and lead the arm astray.

    Parameters
    ----------
    found : ScannedSection
        What was read, in either substep.
    step : StepRequest
        The step that was made.

    Raises
    ------
    GrooveNotFound
        With reason "implausible": too near or too far, aside, or turned.
    """
    length, direction_b = step.length, step.direction_b
    gone = found.T_b_g[:3, 3] - step.groove_origin_b
    ahead = float(gone @ direction_b)
    aside = float(np.linalg.norm(gone - ahead * direction_b))
    # A circle leaves its tangent by step²/2R; straight on from the last chord it is twice that.
    bend = length * length / TIGHTEST_GROOVE_BEND_RADIUS
    most_aside = min(SIDE_ALLOWANCE + bend, MOST_SECTION_STEPS_ASIDE * length + SIDE_ALLOWANCE)
    if not (
        SECTION_STEPS_AHEAD_BOUNDS[0] * length < ahead < SECTION_STEPS_AHEAD_BOUNDS[1] * length
        and aside < most_aside
    ):
        raise _implausible_reading(
            f"what was read is {1e3 * ahead:.1f} mm ahead of the last section and "
            f"{1e3 * aside:.1f} mm aside, a step of {1e3 * length:.1f} mm was made"
        )
    turn = rotation_angle_between(step.last.T_b_g, found.T_b_g)
    if turn > step.max_rotation:
        raise _implausible_reading(
            f"what was read is turned by {np.degrees(turn):.0f}° against the last section, over "
            f"{1e3 * length:.1f} mm"
        )


def check_section_orientation(groove: GrooveSection) -> None:
    """Refuse a section whose wall is not above the groove, or does not face the sensor.

    Raises
    ------
    GrooveNotFound
        With reason "implausible".
    """
    up, towards = float(groove.T_s_g[0, 1]), -float(groove.T_s_g[2, 2])
    if min(up, towards) < LEAST_UPRIGHT_COSINE:
        raise _implausible_reading(
            f"the brace's wall rises by {up:.2f} of its length along x_s and faces the sensor by "
            f"{towards:.2f}: it is not above the groove"
        )


def check_second_is_ahead(
    T_b_g_first: Array, second: Array, direction: ScanDirection, least: float
) -> None:
    """Refuse taught poses that coincide or lead the other way round than the plan.

    Parameters
    ----------
    T_b_g_first : ndarray, shape (4, 4)
        Frame g of the first taught section.
    second : ndarray, shape (3,)
        Where the second one is, frame b, metres.
    direction : ScanDirection
        Which way round.
    least : float
        How far ahead it must be, metres.

    Raises
    ------
    ConfigurationError
        If it is not.
    """
    away = second - T_b_g_first[:3, 3]
    forward = float(away @ T_b_g_first[:3, 0])
    if direction is ScanDirection.CLOCKWISE:
        forward = -forward
    if forward >= least:
        return
    apart = 1e3 * float(np.linalg.norm(away))
    if forward < -least:
        raise ConfigurationError(
            f"the second taught section is {apart:.1f} mm from the first, behind it for a "
            f"{direction} scan; swap the two poses, or turn scan.direction",
            key="scan.second",
        )
    raise ConfigurationError(
        f"the second taught section is {apart:.1f} mm from the first, too close for a scan; teach "
        "the second pose about one step further on",
        key="scan.second",
    )


def check_measures_plausible(found: ScannedSection, step: StepRequest) -> None:
    """Refuse a section whose own measures can't follow the last one's.

    Parameters
    ----------
    found : ScannedSection
        What was read, the laser plane turned as for the last section: in another plane the
        measures are others.
    step : StepRequest
        The step that was made.

    Raises
    ------
    GrooveNotFound
        With reason "implausible": the groove angle, the root or the depth jumps by more than what
        both readings are uncertain by and a groove changes over such a step.
    """
    before, after, allowed = _compare_measures(found, step)
    beyond = np.abs(after - before) > allowed
    if not beyond.any():
        return
    k = int(beyond.argmax())
    name, unit = (("opening", "°"), ("root width", " mm"), ("depth", " mm"))[k]
    scale = np.degrees(1.0) if k == 0 else 1e3
    raise _implausible_reading(
        f"the {name} jumps from {scale * before[k]:.1f} to {scale * after[k]:.1f}{unit} over "
        f"{1e3 * step.length:.1f} mm, {scale * allowed[k]:.1f}{unit} are plausible"
    )


def measures_are_plausible(found: ScannedSection, step: StepRequest) -> bool:
    """Whether `check_measures_plausible` would accept a section; for the parameters see there."""
    before, after, allowed = _compare_measures(found, step)
    return not bool((np.abs(after - before) > allowed).any())


def check_agrees_with_prediction(found: ScannedSection, step: StepRequest) -> None:
    """Refuse a corrected section that is another one than was predicted.

    The correction turns the sensor about the groove that the prediction view showed: seen along
    the step, its corners stay where they are. They would not, were the profile not of this view.

    Parameters
    ----------
    found : ScannedSection
        What was read after the correction.
    step : StepRequest
        The step that was made.

    Raises
    ------
    GrooveNotFound
        With reason "implausible".
    """
    if step.predicted is None:
        return
    step_b = unit_vector(found.T_b_g[:3, 3] - step.groove_origin_b)
    apart = (found.points_b - step.predicted.points_b)[1:4]  # the ends are not corners
    aside = np.linalg.norm(apart - np.outer(apart @ step_b, step_b), axis=1)
    turn = rotation_angle_between(step.predicted.view.T_b_s, found.view.T_b_s)
    same = SAME_SECTION_DISTANCE + SAME_SECTION_DISTANCE_PER_SQUARED_TURN * turn**2
    allowed = np.maximum(same, largest_chance_differences(found.groove, step.predicted.groove))
    if (aside > allowed).any():
        k = int((aside - allowed).argmax())
        raise _implausible_reading(
            f"its corners are {1e3 * aside[k]:.1f} mm from where the prediction view showed them, "
            f"{1e3 * allowed[k]:.1f} mm are plausible"
        )


def check_leads_on(
    found: ScannedSection, last: ScannedSection, along_b: Array, gone: float
) -> None:
    """Refuse a section read in passing that is of another groove than the one right behind it.

    Parameters
    ----------
    found, last : ScannedSection
    along_b : ndarray, shape (3,)
        Direction of the groove, unit vector.
    gone : float
        Metres along the groove from one to the other.

    Raises
    ------
    GrooveNotFound
        With reason "implausible": none of its corners lies where the groove leads.
    """
    apart = (found.points_b - last.points_b)[1:4] - gone * along_b
    turned = np.outer(np.clip(apart @ along_b, -PLANNING_SPACING, PLANNING_SPACING), along_b)
    aside = np.linalg.norm(apart - turned, axis=1)
    same = SAME_SECTION_DISTANCE + LARGEST_SLOPE_OFF * gone
    chance = largest_chance_differences(found.groove, last.groove)
    seen = np.array([name not in found.groove.absent for name in ("p2", "p3", "p4")])
    if (aside > np.maximum(same, chance))[seen].all():
        raise _implausible_reading(
            f"its corners are {1e3 * aside.min():.1f} mm or more beside the groove behind it, "
            f"{1e3 * same:.1f} mm are plausible"
        )


def largest_chance_differences(one: GrooveSection, other: GrooveSection) -> Array:
    """Largest differences of p2, p3, p4 between two readings by chance, shape (3,), metres.

    Of corners that are buried, as under a tack weld, these are many.
    """
    variances = one.corner_covariances_s + other.corner_covariances_s
    return np.asarray(LARGEST_CHANCE_SIGMAS * np.sqrt(np.trace(variances, axis1=1, axis2=2)))


def largest_root_width_change(groove: GrooveSection, away: float) -> float:
    """Metres by which a root's width differs at most from a section's so many metres away."""
    share = LARGEST_ROOT_CHANGE[0] + LARGEST_ROOT_CHANGE[1] * away
    return BEAD_HEIGHT_ALLOWANCE + share * groove.root_width


def _compare_measures(found: ScannedSection, step: StepRequest) -> tuple[Array, Array, Array]:
    """Groove angle, root width and depth of the last section and this one, and what may change."""
    last, now = step.last.groove, found.groove
    # A taught laser plane may have been turned otherwise than one that the scan chose.
    factor = 2.0 if step.last.view.substep is Substep.TAUGHT else 1.0
    of_last, of_now = (np.diag(groove.measure_covariance)[:3] for groove in (last, now))
    noise = LARGEST_CHANCE_SIGMAS * np.sqrt(of_last + of_now)
    before, after = (np.array((g.groove_angle, g.root_width, g.depth)) for g in (last, now))
    changes = LARGEST_GROOVE_ANGLE_CHANGE, LARGEST_DEPTH_CHANGE
    angle, depth_share = (least + per_metre * step.length for least, per_metre in changes)
    root, depth = largest_root_width_change(last, step.length), depth_share * before[2]
    allowed = noise + factor * np.array((angle, root, BEAD_HEIGHT_ALLOWANCE + depth))
    return before, after, np.asarray(allowed)
