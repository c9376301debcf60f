"""A cycle of a tow, as its program records it."""

from __future__ import annotations

import numpy as np

from tjscan.towing.journal import TowCycle
from tjscan.towing.shape.plan import PlanTerms, TowingPlan

RNG = np.random.default_rng(1)


def make_cycle(time: float) -> TowCycle:
    """Two vehicles at a time, in seconds: any numbers, but no pose of the second."""
    seen = RNG.standard_normal((2, 3))
    seen[1] = np.nan
    plan = TowingPlan(
        RNG.standard_normal(5),
        RNG.standard_normal(5),
        RNG.standard_normal((5, 3)),
        RNG.standard_normal((2, 3)),
        PlanTerms(1.0, 2.0, 3.0, 4.0),
        1e-9,
        ("joint 3",),
        4,
        "a wall is too near",
    )
    return TowCycle(
        time,
        0.5,
        0.25,
        seen,
        RNG.standard_normal((2, 3)),
        RNG.standard_normal((2, 2)),
        RNG.standard_normal((2, 3)),
        RNG.standard_normal((2, 3)),
        np.empty((0, 5)),
        plan,
        1e-3,
        12.0,
        "a wall is too near",
        (1,),
    )
