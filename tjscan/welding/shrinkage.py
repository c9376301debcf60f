"""How a groove closes while it is welded: transverse and angular shrinkage, pass by pass."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.welding.bead import column_widths

LEAST_METAL_HEIGHT: Final = 1e-6
"""Columns with less weld metal over the groove's faces count as bare, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShrinkageModel:
    """Shrinkage by the metal laid so far. The defaults are assumptions.

    Parameters
    ----------
    first : float
        Transverse shrinkage of the first bead, metres.
    per_decade : float
        What each tenfold of the first bead's area adds (form of Kihara and Masubuchi), metres.
    turn_per_metre : float
        Angular shrinkage over the transverse one, radians per metre.
    """

    first: float = 0.7e-3
    per_decade: float = 0.7e-3
    turn_per_metre: float = radians(0.35) / 1.5e-3

    def transverse(self, metal: Array, first_area: Array) -> Array:
        """Transverse shrinkage, metres, of areas of weld metal of which the first bead had some."""
        ratio = np.maximum(metal, 1e-12) / np.maximum(first_area, 1e-12)
        grown = self.first + self.per_decade * np.log10(np.maximum(ratio, 1.0))
        return np.where(first_area > 0, grown, 0.0)


def close_groove(
    u: Array, base: Array, w: Array, by: Array, turn: Array
) -> tuple[Array, Array, Array]:
    """Move the left side of n grooves towards the right one; the area of weld metal is kept.

    The columns are points of the material: those left of the metal move as a rigid body, those
    right of it stay, and the metal between is upset, so that it rises.

    Parameters
    ----------
    u, base, w : ndarray, shape (n, m)
        Columns: place, height of the groove's face, and of the surface over it, metres.
    by, turn : ndarray, shape (n,)
        Way to the right, metres, and turn about the groove's lowest point, radians, by which its
        top leans to the right.

    Returns
    -------
    tuple of ndarray, shape (n, m)
        u, base and w after it.
    """
    metal = w - base
    covered = metal > LEAST_METAL_HEIGHT
    bare = ~covered.any(axis=1)
    rows = np.arange(len(u))
    first, last = covered.argmax(axis=1), u.shape[1] - 1 - covered[:, ::-1].argmax(axis=1)
    left, right = u[rows, first], u[rows, last]
    span = np.where(bare | (right <= left), 1.0, right - left)
    moves = np.clip((right[:, None] - u) / span[:, None], 0.0, 1.0)
    moves[bare] = 0.0
    lowest = np.where(covered, base, np.inf).argmin(axis=1)
    pivot_u, pivot_w = u[rows, lowest][:, None], base[rows, lowest][:, None]
    moved_u = u + moves * (by[:, None] + turn[:, None] * (base - pivot_w))
    moved_base = base - moves * turn[:, None] * (u - pivot_u)
    risen = metal * column_widths(u) / column_widths(moved_u)
    return moved_u, moved_base, moved_base + risen
