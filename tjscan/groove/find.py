"""Read the groove's section off a profile, or refuse to."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.groove.bare_steel import BareSteel, find_bare_steel
from tjscan.groove.fit import (
    GrooveCandidate,
    check_corner_uncertainty,
    find_best_candidate,
    fit_groove_to_profile,
)
from tjscan.groove.fitted_profile import FittedProfile, OrderedProfilePoints
from tjscan.groove.models import OPENING_LEAST, OPENING_MOST
from tjscan.groove.prior import GroovePrior
from tjscan.groove.root import TeeCorners, find_tee_corners
from tjscan.groove.section import GrooveSection, section_from_points
from tjscan.groove.settings import DEFAULT_SETTINGS, GrooveSettings
from tjscan.groove.uncertainty import corner_estimates
from tjscan.laser.profile import Profile

LEAST_DEPTH: Final = 4e-3
"""Depth of the shallowest groove that is read, in metres."""

CONTRADICTION_SIGMAS: Final = 2.5
"""Standard deviations from which a profile contradicts what is expected of its bends."""

__all__ = [
    "DEFAULT_SETTINGS",
    "GrooveSettings",
    "find_groove",
    "find_groove_with_fit",
    "fit_groove_to_profile",
]


def find_groove(
    profile: Profile, settings: GrooveSettings = DEFAULT_SETTINGS, prior: GroovePrior | None = None
) -> GrooveSection:
    """Read the groove's section off a profile.

    Parameters
    ----------
    profile : Profile
        In frame s with x_s up the brace; the columns may run either way.
    settings : GrooveSettings
        With a model of four sides, such as `TEE`.
    prior : GroovePrior, optional
        What the sections before it say. Only with one are scale and light between the faces
        looked for, and says the section what its own profile has to say of them.

    Raises
    ------
    GrooveNotFound
        If there are too few points, no groove, more than one reading, or one that is too
        uncertain.
    ValueError
        If the model has no such section.
    """
    return find_groove_with_fit(profile, settings, prior)[0]


def find_groove_with_fit(
    profile: Profile, settings: GrooveSettings = DEFAULT_SETTINGS, prior: GroovePrior | None = None
) -> tuple[GrooveSection, OrderedProfilePoints, FittedProfile]:
    """Read the groove's section off a profile; give also the points and sides it rests on.

    Parameters and errors are those of `find_groove`.
    """
    if not settings.model.has_section_points:
        raise ValueError(f"model {settings.model.name!r} has no section of five points")
    steel = None
    if prior is None:
        row, found = find_best_candidate(profile, settings)
    else:
        steel = _read_with_prior(profile, settings, prior)
        row, found = steel.row, steel.found
    corners_s, covariance = corner_estimates(row, found.fitted, found.model)
    if steel is not None:
        covariance += steel.covariance
    found = replace(found, fitted=replace(found.fitted, corners=corners_s))
    corners = find_tee_corners(row, found, covariance + found.rivals, settings.support_tolerance)
    root = [corners.covariance[k : k + 2, k : k + 2] for k in (2, 4)]
    # Without the root's corners or with one more nothing else bears out that this is a groove.
    # Other readings of it do not object to that.
    needed = [covariance[:2, :2], *(root if found.model.name == settings.model.name else ())]
    check_corner_uncertainty(row, min(float(np.diag(c).max()) for c in needed), settings)
    section = _section(found, corners)
    if not OPENING_LEAST < section.groove_angle < OPENING_MOST:
        raise GrooveNotFound(
            "ambiguous",
            f"an opening of {np.degrees(section.groove_angle):.0f}° is not that of a groove",
            row.points,
        )
    if section.depth < LEAST_DEPTH:
        raise GrooveNotFound(
            "no bevel",
            f"what lies between wall and leg is {1e3 * section.depth:.1f} mm deep: the groove is "
            "already welded, or there is none",
            row.points,
        )
    if steel is not None:
        section = replace(section, evidence=steel.evidence)
    return section, row, found.fitted


def _read_with_prior(profile: Profile, settings: GrooveSettings, prior: GroovePrior) -> BareSteel:
    """Fit with what the sections before say, as far as the profile does not contradict it."""
    model = prior.expected_model(settings.model)
    try:
        row, found = find_best_candidate(profile, replace(settings, model=model))
        if not _contradicts_bends(found):
            return find_bare_steel(row, found, prior, settings.support_tolerance)
    except GrooveNotFound:
        if not prior.knows_bends:
            raise
    return _read_with_prior(profile, settings, prior.without_bends)


def _contradicts_bends(found: GrooveCandidate) -> bool:
    """Whether a fit bends otherwise, in the middle of what is seen of a side, than was expected."""
    for k in (0, -1):
        side, curve = found.model.sides[k], found.fitted.curves[k]
        bend = curve.rebased_at_tangent(found.fitted.middles[k]).c2
        expected = side.expected_bend
        if expected is not None and abs(bend - expected) > CONTRADICTION_SIGMAS * side.bend:
            return True
    return False


def _section(found: GrooveCandidate, corners: TeeCorners) -> GrooveSection:
    """Section of the fitted sides of a tee."""
    fitted = found.fitted
    wall, leg = fitted.curves[0], fitted.curves[-1]
    on_wall, on_leg = fitted.kept_along(0), fitted.kept_along(len(fitted.curves) - 1)
    points = np.zeros((5, 3))
    points[0, [0, 2]] = wall.points_at(float(on_wall.min()))
    points[1:4, [0, 2]] = corners.points
    points[4, [0, 2]] = leg.points_at(float(on_leg.max()))
    t1, t4 = wall.tangent_at(corners.places[0]), leg.tangent_at(corners.places[1])
    section = section_from_points(
        points,
        wall_s=(t1[0], 0.0, t1[1]),
        leg_s=(t4[0], 0.0, t4[1]),
        rms=float(np.sqrt(np.mean(fitted.residuals[fitted.keep] ** 2))),
        covariance=corners.covariance,
    )
    return replace(
        section,
        model=found.model.name,
        model_probability=found.probability * corners.form_seen,
        conditions=corners.conditions,
        absent=corners.absent,
        root_opening=corners.root_opening,
    )
