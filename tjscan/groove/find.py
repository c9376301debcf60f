"""Read the groove's section off a profile, or refuse to."""

from __future__ import annotations

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.fit import check_certainty, fit_profile, locate
from tjscan.groove.models import OPENING_LEAST, OPENING_MOST
from tjscan.groove.refinement import FittedProfile
from tjscan.groove.section import GrooveSection, section_from_points
from tjscan.groove.settings import DEFAULT, GrooveSettings
from tjscan.groove.uncertainty import corner_covariance
from tjscan.laser.profile import Profile

__all__ = ["DEFAULT", "GrooveSettings", "find_groove", "fit_profile"]


def find_groove(profile: Profile, settings: GrooveSettings = DEFAULT) -> GrooveSection:
    """Read the groove's section off a profile.

    Parameters
    ----------
    profile : Profile
        In frame s with x_s up the brace; the columns may run either way.
    settings : GrooveSettings
        With a model of four sides, such as `TEE`.

    Raises
    ------
    GrooveNotFound
        If there are too few points, no groove, more than one reading, or one that is too
        uncertain.
    ValueError
        If the model has no such section.
    """
    if not settings.model.has_section:
        raise ValueError(f"model {settings.model.name!r} has no section of five points")
    row, fitted = locate(profile, settings)
    covariance = corner_covariance(row, fitted, settings.model)
    check_certainty(row, covariance, settings)
    section = _section(fitted, covariance)
    if not OPENING_LEAST < section.groove_angle < OPENING_MOST:
        raise GrooveNotFound(
            "ambiguous",
            f"an opening of {np.degrees(section.groove_angle):.0f}° is not that of a groove",
            row.points,
        )
    return section


def _section(fitted: FittedProfile, covariance: Array) -> GrooveSection:
    """Section of four fitted sides."""
    wall, leg = fitted.curves[0], fitted.curves[-1]
    on_wall = fitted.along[fitted.keep & (fitted.owner == 0)]
    on_leg = fitted.along[fitted.keep & (fitted.owner == len(fitted.curves) - 1)]
    points = np.zeros((5, 3))
    points[0, [0, 2]] = wall.at(float(on_wall.min()))
    points[1:4, [0, 2]] = fitted.corners
    points[4, [0, 2]] = leg.at(float(on_leg.max()))
    t1 = wall.tangent(fitted.places[0][0])
    t4 = leg.tangent(fitted.places[-1][1])
    return section_from_points(
        points,
        wall_s=(t1[0], 0.0, t1[1]),
        leg_s=(t4[0], 0.0, t4[1]),
        rms=float(np.sqrt(np.mean(fitted.residuals[fitted.keep] ** 2))),
        covariance=covariance,
    )
