"""The loops over a profile's points, compiled, where they are built.

`_kernel.c` holds them; it needs a C compiler at installation. Without it, or with the variable
`WITHOUT_KERNEL` in the environment, NumPy does the same, more slowly.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache
from importlib import import_module
from itertools import accumulate, pairwise
from types import ModuleType
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.groove.settings import SideModel
from tjscan.groove.sides import (
    SCALING_LENGTH,
    CubicCurve,
    FittedProfile,
    Polyline,
)
from tjscan.laser.profile import Profile

KERNEL_VERSION: Final = 3
"""Rises with every change of what the compiled loops take and give: sources that were updated may
lie beside loops that were not built again."""

WITHOUT_KERNEL: Final = "TJSCAN_WITHOUT_KERNEL"
"""Set to anything but nothing, it keeps the compiled loops out."""


def load_kernel() -> ModuleType | None:
    """The compiled loops; None where they were not built, of another version, or switched off."""
    if os.environ.get(WITHOUT_KERNEL):
        return None
    try:
        found = import_module("tjscan.groove._kernel")
    except ImportError:
        return None
    return found if getattr(found, "KERNEL_VERSION", 0) == KERNEL_VERSION else None


compiled: ModuleType | None = load_kernel()
"""The compiled loops; None where NumPy does them."""


def refine_fit(
    compiled: ModuleType,
    row: Profile,
    start: Polyline,
    model: tuple[SideModel, ...],
    tolerance: float,
    annealed: bool,
    known: Sequence[Array],
) -> FittedProfile | None:
    """What `refinement.refine_fit` gives."""
    k, n = len(model), len(row)
    sizes = (8 * k, 2 * k - 2, 2 * k - 2, k, k, k, k, k, 16 * k, 4 * k, 16 * k, 4 * k)
    ends = [0, *accumulate((*sizes, 1))]
    values, points, keep = np.empty(ends[-1]), np.empty((2, n)), np.empty(n, dtype=np.bool_)
    found = compiled.refine_fit(
        row.x_s,
        row.z_s,
        row.columns,
        np.array(start.sides),
        start.corners,
        model_values(model),
        np.array(known),
        *(values, points, keep),
        *(row.column_count, tolerance, annealed),
    )
    if found is None:
        return None
    finished, *edges = found
    parts = [values[a:b] for a, b in pairwise(ends)]
    curves, places = parts[0].tolist(), parts[1].tolist()
    return FittedProfile(
        curves=tuple(CubicCurve(*curves[i : i + 8]) for i in range(0, 8 * k, 8)),
        places=tuple(zip(places[::2], places[1::2], strict=True)),
        corners=parts[2].reshape(-1, 2),
        edges=edges,
        spans=tuple(map(slice, edges, edges[1:])),
        along=points[0],
        residuals=points[1],
        keep=keep,
        sigmas=parts[3],
        curved=parts[7] > 0,
        equations=(parts[8].reshape(k, 4, 4), parts[9].reshape(k, 4)),
        inverse=parts[10].reshape(k, 4, 4),
        weight=parts[11].reshape(k, 4),
        counts=parts[4].astype(np.intp),
        middles=tuple(parts[5].tolist()),
        variance_inflation=float(parts[12][0]),
        straight=parts[6] if finished else None,
    )


@lru_cache
def model_values(model: tuple[SideModel, ...]) -> Array:
    """What a compiled fit knows of each side, shape (k, 6)."""
    square, cube = SCALING_LENGTH**2, SCALING_LENGTH**3
    return np.array(
        [
            (
                side.bend * square,
                side.twist * cube,
                (side.expected_bend or 0.0) * square,
                side.roughness,
                side.bead,
                side.expected_bend is not None,
            )
            for side in model
        ]
    )
