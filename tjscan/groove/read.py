"""Read the groove's section off a profile, or refuse to: the stages in their order."""

from __future__ import annotations

from dataclasses import replace
from math import cos, degrees, hypot, sqrt
from typing import Final

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove import kernel
from tjscan.groove.prior import GroovePrior
from tjscan.groove.reflections import with_doubt_from_others
from tjscan.groove.root import ROOT_NOT_SEEN, read_root
from tjscan.groove.search import find_supported_fits
from tjscan.groove.section import GrooveSection
from tjscan.groove.settings import (
    DEFAULT_SETTINGS,
    LARGEST_OPENING_ANGLE,
    LEAST_OPENING_ANGLE,
    GrooveSettings,
)
from tjscan.groove.shape import corner_estimates
from tjscan.groove.sides import GrooveFit, Index, select_points
from tjscan.groove.steel import fit_bare_steel
from tjscan.laser.profile import Profile

LEAST_DEPTH, LEAST_DEPTH_OVER_FACE = 4e-3, 1.5e-3
"""How far the shallowest bevel that is read goes behind the wall, and that of a groove with a face
of its root or of a weld, in metres: where a groove is welded up, its cap and the leg look like a
shallow one without a face."""

SURE_LENGTH_SIGMAS: Final = 2.5
"""Standard deviations of its own length by which a bevel shallower than `LEAST_DEPTH` is longer
than nothing."""

FARTHEST_POINT_RATIO: Final = 4.0
"""Points at more than this many times the median depth, or less than that share, are none."""

CONTRADICTION_SIGMAS: Final = 2.5
"""Standard deviations from which a profile contradicts what is expected of its bends."""


def read_groove(
    profile: Profile, settings: GrooveSettings = DEFAULT_SETTINGS, prior: GroovePrior | None = None
) -> GrooveSection:
    """Read the groove's section off a profile.

    Parameters
    ----------
    profile : Profile
        In frame s with x_s up the brace; the columns may run either way.
    settings : GrooveSettings
        With a model of four sides, such as `TEE_GROOVE`.
    prior : GroovePrior, optional
        What the sections before it show. Mill scale is looked for without them, too; where light
        between the faces pulls the notch in, only with them.

    Raises
    ------
    GrooveNotFound
        If there are too few points, no groove, more than one reading, or one that is too
        uncertain.
    ValueError
        If the model has no such section.
    """
    return read_groove_with_fit(profile, settings, prior)[0]


def read_groove_with_fit(
    profile: Profile, settings: GrooveSettings = DEFAULT_SETTINGS, prior: GroovePrior | None = None
) -> tuple[GrooveSection, GrooveFit]:
    """Read the groove's section off a profile; give also the fit that it rests on.

    Parameters and errors are as of `read_groove`.
    """
    if not settings.model.has_section_points:
        raise ValueError(f"model {settings.model.name!r} has no section of five points")
    tolerance, row = settings.support_tolerance, order_points(profile, settings)
    fit = _fit_on_steel(row, settings, prior, tolerance)
    corners, covariance = corner_estimates(fit)
    covariance += fit.steel_covariance
    fit = replace(fit, fitted=replace(fit.fitted, corners=corners))
    section = read_root(fit, covariance + fit.other_readings, tolerance)
    # Without the root's corners or with one more nothing else supports that this is a groove.
    # Other readings of it do not object to that.
    root = section.covariance_s.diagonal().reshape(3, 2).max(axis=1)[1:].tolist()
    top = float(covariance.diagonal()[:2].max())
    needed = min(top, *root) if fit.model.name == settings.model.name else top
    _check_corner_uncertainty(fit.row, needed, settings)
    _check_shape(section, fit.row.points)
    return section, fit


def fit_groove(profile: Profile, settings: GrooveSettings = DEFAULT_SETTINGS) -> GrooveFit:
    """Fit the sides and corners of a groove of any model to a profile.

    Parameters and errors are as of `read_groove`; the points come ordered from the first
    side to the last.
    """
    row = order_points(profile, settings)
    best, *others = find_supported_fits(row, settings)
    fit = with_doubt_from_others(best, others)
    corners, covariance = corner_estimates(fit)
    variances = np.diag(covariance)[:-2].reshape(-1, 2).max(axis=1)
    # What is not seen well has its uncertainty; one of the tops has to be known.
    _check_corner_uncertainty(row, float(variances[[0, -1]].min()), settings)
    fitted = replace(fit.fitted, corners=corners)
    return replace(fit, fitted=fitted, covariance=covariance + fit.other_readings)


def order_points(profile: Profile, settings: GrooveSettings) -> Profile:
    """The points of a profile by their bearings, from the wall to the leg.

    Raises
    ------
    GrooveNotFound
        If there are fewer than the settings ask for.
    """
    columns = _columns_by_bearing(profile)
    if len(columns) < settings.minimum_points:
        raise GrooveNotFound(
            "too few points",
            f"{len(columns)} of {len(profile)} columns hold a point, {settings.minimum_points} "
            "are needed. Is the surface inside the sensor's range, and the laser on?",
            profile.points[columns],
        )
    return select_points(profile, columns)


def _columns_by_bearing(profile: Profile) -> Index:
    """Columns that hold a point, from the wall to the leg."""
    if kernel.compiled is not None:
        n = len(profile)
        found, work = np.empty(n, dtype=np.intp), np.empty((2, n))
        return found[: kernel.compiled.order_points(profile.x_s, profile.z_s, work, found)]
    # Many sensors write a zero where they see nothing; and nothing is seen behind them.
    valid = profile.valid & (profile.z_s > 0)
    # Others write a far or a tiny value: no laser line reaches that far from its middle.
    middle = float(np.median(profile.z_s[valid])) if valid.any() else 0.0
    nearest, farthest = middle / FARTHEST_POINT_RATIO, middle * FARTHEST_POINT_RATIO
    valid &= (profile.z_s > nearest) & (np.maximum(profile.z_s, np.abs(profile.x_s)) < farthest)
    columns = np.flatnonzero(valid)
    bearings = -profile.x_s[columns] / profile.z_s[columns]
    return columns[np.argsort(bearings, kind="stable")]


def _fit_on_steel(
    row: Profile, settings: GrooveSettings, prior: GroovePrior | None, tolerance: float
) -> GrooveFit:
    """Fit with what the sections before show, as far as the profile does not contradict it."""
    model = prior.expected_model(settings.model) if prior else settings.model
    try:
        best, *others = find_supported_fits(row, replace(settings, model=model))
        if prior is None or not _contradicts_bends(best):
            bare = fit_bare_steel(best, prior, tolerance)
            return with_doubt_from_others(bare, others)
    except GrooveNotFound:
        if prior is None or not np.isfinite(prior.bend_sigmas).any():
            raise
    unbent = replace(prior, bends=np.zeros(2), bend_sigmas=np.full(2, np.inf))
    return _fit_on_steel(row, settings, unbent, tolerance)


def _contradicts_bends(fit: GrooveFit) -> bool:
    """Whether a fit bends otherwise, in the middle of what is seen of a side, than was expected."""
    for k in (0, -1):
        side, curve = fit.model.sides[k], fit.fitted.curves[k]
        bend = curve.rebased_at_tangent(fit.fitted.middles[k]).c2
        expected = side.expected_bend
        if expected is not None and abs(bend - expected) > CONTRADICTION_SIGMAS * side.bend:
            return True
    return False


def _check_corner_uncertainty(row: Profile, variance: float, settings: GrooveSettings) -> None:
    """Refuse a groove if a coordinate that has to be known, of a variance in m², is not."""
    sigma = sqrt(variance)
    if sigma > settings.largest_sigma:
        raise GrooveNotFound(
            "ambiguous",
            f"a corner is known to {1e3 * sigma:.2f} mm (one standard deviation) only: too little "
            "of its sides is seen. Look at the groove more squarely.",
            row.points,
        )


def _check_shape(section: GrooveSection, points: Array) -> None:
    """Refuse a section whose opening or bevel is no groove's to be welded."""
    bevel = (section.points_s[1] - section.points_s[2])[[0, 2]]
    length = hypot(*bevel.tolist())
    depth = length * cos(section.gamma_1)
    across = np.concatenate((bevel, -bevel)) / length
    sigma = sqrt(max(float(across @ section.covariance_s[:4, :4] @ across), 0.0))
    sure = depth > LEAST_DEPTH or (
        depth > LEAST_DEPTH_OVER_FACE
        and ROOT_NOT_SEEN not in section.conditions
        and length > SURE_LENGTH_SIGMAS * sigma
    )
    left = f"the bevel goes {1e3 * max(depth, 0.0):.1f} mm behind the wall"
    if sure and section.area <= 0:
        sure, left = False, "nothing is left to fill"
    if not sure:
        raise GrooveNotFound(
            "no bevel", f"{left}: the groove is already welded, or there is none", points
        )
    if not LEAST_OPENING_ANGLE < section.groove_angle < LARGEST_OPENING_ANGLE:
        raise GrooveNotFound(
            "ambiguous",
            f"an opening of {degrees(section.groove_angle):.0f}° is not a groove's",
            points,
        )
