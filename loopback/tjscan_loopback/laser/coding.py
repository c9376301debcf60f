"""Profiles as the raw numbers of a sensor: what `tjscan.laser.scan3d` reads back."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.laser.profile import Profile
from tjscan.laser.scan3d import CoordinateFormat

STEP_MM: Final = 0.005
"""Millimetres per count: the step of the simulated laser."""

X_OFFSET_MM: Final = -STEP_MM * 32_768
"""x of raw number 0; z of raw number 0 is 0, which means a missing point."""

INVALID_RAW: Final = 0

RAW_X: Final = (0.0, 65_535.0)
RAW_Z: Final = (1.0, 65_535.0)
"""Least and greatest raw number of a point."""


def encode_profile(profile: Profile, layout: CoordinateFormat) -> bytes:
    """Raw numbers of a profile; points beyond what the numbers hold are missing."""
    columns = {
        "A": (1e3 * profile.x_s - X_OFFSET_MM) / STEP_MM,
        "B": np.zeros(len(profile)),
        "C": 1e3 * profile.z_s / STEP_MM,
    }
    if not layout.has_x:
        columns["C"] = _at_even_spacing(columns["A"], columns["C"])
    table = np.column_stack([columns[name] for name in layout.components])
    limit = 65_535 if layout.dtype == "<u2" else np.inf
    rounded = np.round(table) if layout.dtype == "<u2" else table
    with np.errstate(invalid="ignore"):
        good = np.all((rounded >= 0) & (rounded <= limit) & np.isfinite(table), axis=1)
    return np.where(np.asarray(good)[:, None], rounded, INVALID_RAW).astype(layout.dtype).tobytes()


def _at_even_spacing(x: Array, z: Array) -> Array:
    """Heights where each column has its own x, as rectified formats have it: the nearest point."""
    even = rectified_x(len(x))
    known = np.isfinite(x) & np.isfinite(z)
    if not known.any():
        return np.full(len(x), np.nan)
    order = np.argsort(x[known])
    rising_x, rising_z = x[known][order], z[known][order]
    nearest = np.clip(np.searchsorted(rising_x, even), 1, max(len(rising_x) - 1, 1))
    left = np.minimum(nearest - 1, len(rising_x) - 1)
    right = np.minimum(nearest, len(rising_x) - 1)
    pick = np.where(even - rising_x[left] <= rising_x[right] - even, left, right)
    spacing = rectified_spacing(len(x))
    return np.where(np.abs(rising_x[pick] - even) <= spacing / 2, rising_z[pick], np.nan)


RECTIFIED_WIDTH_MM: Final = 160.0
"""Width of a row in formats that state heights only."""


def rectified_spacing(columns: int) -> float:
    """Counts of x from one column to the next, in formats that state heights only."""
    return RECTIFIED_WIDTH_MM / STEP_MM / columns


def rectified_x(columns: int) -> Array:
    """Raw x of each column, in formats that state heights only, shape (columns,)."""
    middle = (columns - 1) / 2
    away = np.arange(columns, dtype=np.float64) - middle
    return -X_OFFSET_MM / STEP_MM + rectified_spacing(columns) * away
