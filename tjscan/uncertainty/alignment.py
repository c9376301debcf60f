"""What an alignment to the joint leaves of the uncertainty of what was aligned."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.uncertainty.budget import (
    BudgetComponent,
    UncertaintyBudget,
    covariance_factor,
    points_moved_by_twist,
)

ALIGNMENT_CAUSE: Final = "alignment"

ON_WALLS: Final = (0, 1, 3, 4)
"""p1 and p2 lie on the brace's wall, p4 and p5 on the leg."""


def aligned_budget(
    budget: UncertaintyBudget, points: Array, normals: Array, *, by_tubes: bool
) -> UncertaintyBudget:
    """Budget of sections that were brought onto a reference by their walls.

    What the components share moves the walls, too, and the alignment takes back what of it looks
    like a motion of all: that part is gone. What each section has for itself moves the alignment
    a little, which all sections then share. The alignment counts as a least-squares fit of the
    walls' distances at p1, p2, p4 and p5, all alike.

    Parameters
    ----------
    budget : UncertaintyBudget
        Of n sections, before.
    points : ndarray, shape (n, 5, 3)
        p1 to p5, in the frame of the budget, metres; that of the joint if tubes are fitted.
    normals : ndarray, shape (n, 2, 3)
        Of the brace's wall and of the leg, at each section.
    by_tubes : bool
        Whether tubes of any size were fitted, as they are to find a joint's own frame; else what
        was measured was laid on the reference as it is.
    """
    n = len(points)
    at = points[:, ON_WALLS].reshape(-1, 3)
    across = normals[:, (0, 0, 1, 1)].reshape(-1, 3)
    turned = np.cross(at, across)
    columns = [across, turned]
    if by_tubes:
        # Radii, and how the leg lies beside and under the brace: offset along y, turn about it.
        on_leg = np.tile((0.0, 0.0, 1.0, 1.0), n)
        columns.append(
            np.column_stack((1 - on_leg, on_leg, on_leg * across[:, 1], on_leg * turned[:, 1]))
        )
    taken_back = -np.linalg.pinv(np.concatenate(columns, axis=1))[:6]
    components, own = [], np.zeros((6, 6))
    for one in budget.components:
        m = one.points.shape[-1]
        off = np.einsum("kc,kcm->km", across, one.points[:, ON_WALLS].reshape(-1, 3, m))
        if one.is_shared:
            moved = points_moved_by_twist(points, taken_back @ off)
            one = replace(one, points=one.points + moved)
        else:
            by_section = taken_back.reshape(6, n, 4).transpose(1, 0, 2) @ off.reshape(n, 4, m)
            own += np.einsum("nim,njm->ij", by_section, by_section)
        components.append(one)
    place = points_moved_by_twist(points, covariance_factor(own))
    found = BudgetComponent(ALIGNMENT_CAUSE, "observed", True, place, np.zeros((n, 4, 6)))
    return UncertaintyBudget((*components, found))
