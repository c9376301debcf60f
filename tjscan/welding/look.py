"""What a look at a partly filled groove says about how far the groove has closed."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tjscan.core.errors import LookRefused
from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.welding.bead import column_widths
from tjscan.welding.state import WeldState

LEAST_COVER: Final = 0.1e-3
"""Columns with less weld metal count as bare in a look, metres."""

BARE_MARGIN: Final = 4
"""Columns beside the metal that show neither the groove's face nor the bead well."""

POOLING_LENGTH: Final = 10e-3
"""Over which the place of the left side is averaged along the groove, metres."""

REGISTRATION_SIGMA: Final = 0.06e-3
"""Standard deviation of a look's place along the leg against the first scan's, metres."""

FACE_SIGMA: Final = 0.03e-3
"""Standard deviation of the height of a pooled face in a look against the first scan, metres."""


LARGEST_LOSS: Final = 0.3e-3
"""A surface seen lower than the one before by more, metres, over `LARGEST_SHARE` is refused."""

LARGEST_SHARE: Final = 0.2

OTHER_JOINT_DISTANCE: Final = 1e-3
"""Bare faces whose distance (rms) from those of the first scan is more, metres, are others'."""


COLUMN_STEP: Final = 0.25e-3
"""Between two columns of a surface, metres."""

WIDEST_GAP: Final = 1.5e-3
"""Between two points of a profile, over which its surface is not known, metres."""

LEAST_SEEN_SHARE: Final = 0.95
"""Of a section's columns between its toes, for it to count as read."""

UNSEEN_SIGMA: Final = 10e-3
"""Standard deviation of a height that no profile shows, metres."""

SCATTER_TO_SIGMA: Final = 1.4826 * np.sqrt(np.pi / 2)
"""From the median deviation of values to the standard deviation of their median, times the root
of their number."""


@array_dataclass
class SurfaceLook:
    """What a look shows at n stations.

    Parameters
    ----------
    u : ndarray, shape (k,)
        Columns across the groove, metres.
    w : ndarray, shape (n, k)
        Heights, metres.
    sigma : ndarray, shape (n, k)
        Standard deviation of each height, metres; `UNSEEN_SIGMA` where no profile shows it, and
        the height is that between its neighbours, or at a station that none shows between the
        stations before and after it.
    read : ndarray of bool, shape (n,)
        Stations at which it was read.
    """

    u: Array
    w: Array
    sigma: Array
    read: Mask


def columns_over(toes_u: Array, margin: float) -> Array:
    """Columns from a margin beside all left toes to one beside all right ones, (k,), metres."""
    low, high = float(toes_u[:, 0].min()) - margin, float(toes_u[:, 1].max()) + margin
    return np.linspace(low, high, 1 + round((high - low) / COLUMN_STEP))


def heights_over_columns(across: Array, values: Sequence[Array], u: Array) -> Array:
    """Values of a profile's points at columns, shape (len(values), k); NaN where it shows nothing.

    Parameters
    ----------
    across : ndarray, shape (p,)
        Of the points, metres.
    values : sequence of ndarray, shape (p,)
    u : ndarray, shape (k,)
        Columns, metres.
    """
    if len(across) < 2:
        return np.full((len(values), len(u)), np.nan)
    order = np.argsort(across, kind="stable")
    across = across[order]
    after = np.clip(np.searchsorted(across, u), 1, len(across) - 1)
    hidden = across[after] - across[after - 1] > WIDEST_GAP
    hidden |= (u < across[0]) | (u > across[-1])
    rows = [np.interp(u, across, row[order]) for row in values]
    return np.where(hidden, np.nan, rows)


def look_of_heights(
    s: Array, profiles: tuple[Array, Array, Array], u: Array, toes_u: Array, reach: float
) -> SurfaceLook:
    """Make a surface of the heights of profiles along a groove, by their median near each station.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Stations, metres.
    profiles : tuple of ndarray, shape (p, k)
        Place along the groove, height and its standard deviation at each column, metres; NaN
        where a profile shows nothing.
    u : ndarray, shape (k,)
        Columns, metres.
    toes_u : ndarray, shape (n, 2)
        Of the finished weld at each station: a station is read if the columns between are.
    reach : float
        To either side of a station, metres, within which profiles count.
    """
    at, heights, noise = profiles
    w, sigma = np.full((2, len(s), len(u)), np.nan)
    with warnings.catch_warnings():  # a column that no profile shows has no median
        warnings.simplefilter("ignore", RuntimeWarning)
        for k, here in enumerate(s):
            near = np.where(np.abs(at - here) < reach, heights, np.nan)
            count = np.sqrt(np.isfinite(near).sum(axis=0))
            w[k] = np.nanmedian(near, axis=0)
            scatter = SCATTER_TO_SIGMA * np.nanmedian(np.abs(near - w[k]), axis=0) / count
            stated = np.nanmedian(np.where(np.isfinite(near), noise, np.nan), axis=0)
            sigma[k] = np.maximum(stated, scatter)
    seen = np.isfinite(w)
    between = (u >= toes_u[:, :1]) & (u <= toes_u[:, 1:])
    read = (seen & between).sum(axis=1) >= LEAST_SEEN_SHARE * between.sum(axis=1)
    for row, known in zip(w, seen, strict=True):
        if known.any():
            row[~known] = np.interp(u[~known], u[known], row[known])
    if (shown := seen.any(axis=1)).any():
        for column in w.T:
            column[~shown] = np.interp(s[~shown], s[shown], column[shown])
    return SurfaceLook(u, np.nan_to_num(w), np.where(seen, sigma, UNSEEN_SIGMA), read)


def resample_rows(at: Array, u: Array, w: Array) -> Array:
    """Rows w over u at other places, shape (n, m); beyond its ends a row's end counts."""
    return np.array([np.interp(x, a, b) for x, a, b in zip(at, u, w, strict=True)])


def see_closing(belief: WeldState, u: Array, w: Array, read: Mask) -> tuple[Array, Array]:
    """How far the groove closed beyond belief, from the bare faces of its left side.

    Pooled along the groove. A face that runs across the section shows little of it, and the bevel
    is covered in the end: the variance states that.

    Parameters
    ----------
    belief : WeldState
    u, w : ndarray, shape (n, k)
        Surface seen, registered to the first scan, u growing; metres.
    read : ndarray of bool, shape (n,)
        Stations at which it was read.

    Returns
    -------
    shift, variance : ndarray, shape (n,)
        To the right, metres, and m²: infinite where nothing shows it.
    """
    seen = resample_rows(belief.u, u, w)
    covered = belief.w - belief.base > LEAST_COVER
    first = np.where(covered.any(axis=1), covered.argmax(axis=1), 0)
    index = np.arange(belief.u.shape[1])
    face = (index > 1) & (index < (first - BARE_MARGIN)[:, None]) & read[:, None]
    slope = np.gradient(belief.base, axis=1) / np.gradient(belief.u, axis=1)
    weights = np.where(face, column_widths(belief.u), 0.0)
    step = float(np.median(np.diff(belief.s)))
    lever, information, length = (
        gaussian_filter1d(np.einsum("ij,ij->i", weights, row), POOLING_LENGTH / step)
        for row in (slope * (belief.base - seen), slope**2, np.ones_like(slope))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.where(information > 0, lever / information, 0.0)
        variance = REGISTRATION_SIGMA**2 + FACE_SIGMA**2 * length / information
    return shift, np.where(read & (information > 0), variance, np.inf)


def check_look(belief: WeldState, before: WeldState, u: Array, w: Array, read: Mask) -> None:
    """Refuse a look that can't be one at this weld as it is now.

    Parameters
    ----------
    belief : WeldState
        What is expected.
    before : WeldState
        As of the last look, or the first scan.
    u, w, read : ndarray
        As of `see_closing`.

    Raises
    ------
    LookRefused
        With the reason.
    """
    if not read.any():
        raise LookRefused("nothing read", "no section shows the weld: look again from nearer")
    seen = resample_rows(belief.u, u, w)[read]
    inside = (belief.u >= u[:, :1]) & (belief.u <= u[:, -1:])
    covered = belief.w - belief.base > LEAST_COVER
    bare = (inside & ~covered)[read]
    slope = np.gradient(belief.base, axis=1) / np.gradient(belief.u, axis=1)
    distance = (np.abs(seen - belief.base[read]) / np.hypot(1, slope[read]))[bare]
    off = float(np.sqrt(np.mean(distance**2))) if distance.size else 0.0
    if off > OTHER_JOINT_DISTANCE:
        raise LookRefused(
            "another joint",
            f"the groove's faces lie {1e3 * off:.1f} mm (rms) beside those of the "
            "first scan: has the joint, or the arm's base, been moved?",
        )
    metal = covered[read] & inside[read]
    if not metal.any():
        return
    # Column by column: they are points of the material, which moved since.
    old = (before.w - before.base + belief.base)[read]
    grown = belief.w[read] - old
    laid = metal & (grown > LARGEST_LOSS)
    if laid.any():
        share = np.mean((belief.w[read] - seen)[laid] > 0.7 * grown[laid])
        if share > 1 - LARGEST_SHARE:
            raise LookRefused(
                "older than the last bead",
                f"{100 * share:.0f} % of where the last bead lies show the surface below it",
            )
    lower = np.mean((old - seen)[metal] > LARGEST_LOSS)
    if lower > LARGEST_SHARE:
        raise LookRefused(
            "lower than before",
            f"{100 * lower:.0f} % of the weld lies more than {1e3 * LARGEST_LOSS:.1f} mm below the "
            "surface before it: metal does not vanish",
        )
