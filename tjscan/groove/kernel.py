"""The loops over a profile's points, compiled, where they are built.

`_kernel.c` holds them; it needs a C compiler at installation. Without it, or with the variable
`WITHOUT_KERNEL` in the environment, NumPy does the same, more slowly.
"""

from __future__ import annotations

import os
from functools import lru_cache
from importlib import import_module
from types import ModuleType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.groove.settings import SideModel
from tjscan.groove.sides import SCALING_LENGTH

KERNEL_VERSION: Final = 5
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


@lru_cache
def fit_record(k: int) -> Array:
    """Room for what a compiled fit of k sides gives, in its order."""
    corner, side, matrix, vector = (k - 1, 2), (k,), (k, 4, 4), (k, 4)
    shapes = {"curves": (k, 8), "places": corner, "corners": corner, "sigmas": side, "counts": side}
    shapes |= {"middles": side, "straight": side, "curved": side, "matrices": matrix}
    shapes |= {"right": vector, "inverse": matrix, "weight": vector, "inflation": (1,)}
    return np.empty(1, [(name, np.float64, shape) for name, shape in shapes.items()])


@lru_cache
def model_values(model: tuple[SideModel, ...]) -> Array:
    """What a compiled fit knows of each side, shape (k, 6)."""
    values = [
        (s.bend, s.twist, s.expected_bend or 0.0, s.roughness, s.bead, s.expected_bend is not None)
        for s in model
    ]
    return np.array(values) * (SCALING_LENGTH ** np.array((2, 3, 2, 0, 0, 0)))


def side_priors(model: tuple[SideModel, ...]) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """What is known of each of k sides, in powers of s / 20 mm.

    Standard deviations of bend and twist, shape (k, 2), the mean of the bend, how rough it is in
    metres, and whether it is a bead, shape (k,).
    """
    values = model_values(model)
    return values[:, :2], values[:, 2], values[:, 3], values[:, 4] > 0
