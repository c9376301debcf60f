"""An alignment takes back what looks like a motion of all, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.uncertainty.budget import (
    BudgetComponent,
    UncertaintyBudget,
    aligned_budget,
    points_moved_by_twist,
)

AZIMUTHS = np.linspace(-2.0, 2.0, 15)


def tee() -> tuple[Array, Array]:
    """Five points of sections about a brace of 0.2 m on a leg of 0.3 m, and walls' normals."""
    out = np.column_stack((np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(15)))

    def on_leg(rho: float) -> tuple[Array, Array]:
        x, y = rho * out[:, 0], rho * out[:, 1]
        z = np.sqrt(0.09 - y**2)
        return np.column_stack((x, y, z)), np.column_stack((np.zeros(15), y, z)) / 0.3

    (p4, leg), (p5, _) = on_leg(0.2), on_leg(0.24)
    up = np.array((0.0, 0.0, 1.0))
    p2 = 0.2 * out + (p4[:, 2:] + 0.02) * up
    points = np.stack((p2 + 0.04 * up, p2, p4 + 0.003 * up, p4, p5), axis=1)
    return points, np.stack((out, leg), axis=1)


def budget_of(points: Array, *, shared: bool) -> UncertaintyBudget:
    n, m = len(points), points.shape[-1]
    return UncertaintyBudget(
        (BudgetComponent("cause", "stated", shared, points, np.zeros((n, 4, m))),)
    )


@pytest.mark.parametrize("by_tubes", [False, True])
def test_a_motion_of_all_sections_is_gone(by_tubes: bool) -> None:
    points, normals = tee()
    moved = points_moved_by_twist(points, 1e-4 * np.eye(6))
    found = aligned_budget(budget_of(moved, shared=True), points, normals, by_tubes=by_tubes)
    assert np.abs(found.components[0].points).max() < 1e-12


def test_a_brace_that_seems_too_thick_stays_so() -> None:
    points, normals = tee()
    thick = np.zeros((15, 5, 3, 1))
    thick[:, :3, :, 0] = 1e-4 * normals[:, :1]
    found = aligned_budget(budget_of(thick, shared=True), points, normals, by_tubes=True)
    np.testing.assert_allclose(found.components[0].points, thick, atol=1e-12)


@pytest.mark.parametrize("by_tubes", [False, True])
def test_what_sections_have_for_themselves_moves_the_alignment_as_drawn(by_tubes: bool) -> None:
    """Against least squares of drawn distances, on the walls alone."""
    rng, (points, normals) = np.random.default_rng(1), tee()
    own = 1e-4 * rng.normal(size=(15, 5, 3, 4))
    found = aligned_budget(budget_of(own, shared=False), points, normals, by_tubes=by_tubes)
    at, across = points[:, [0, 1, 3, 4]], normals[:, [0, 0, 1, 1]]
    design = np.concatenate((across, np.cross(at, across)), axis=2).reshape(60, 6)
    if by_tubes:
        leg = np.tile((0, 0, 1.0, 1.0), 15)
        extra = (1 - leg, leg, leg * design[:, 1], leg * design[:, 4])
        design = np.column_stack((design, *extra))
    drawn = []
    for _ in range(4000):
        off = np.einsum("nkcm,nm->nkc", own, rng.standard_normal((15, 4)))[:, [0, 1, 3, 4]]
        away = np.einsum("nkc,nkc->nk", across, off).ravel()
        motion = -np.linalg.lstsq(design, away, rcond=None)[0][:6]
        drawn.append(motion[:3] + np.cross(motion[3:], points[7, 2]))
    stated = found.components[1].points[7, 2]
    stated, sampled = stated @ stated.T, np.cov(np.array(drawn), rowvar=False)
    assert np.linalg.norm(stated - sampled) < 0.1 * np.linalg.norm(stated)
    np.testing.assert_array_equal(found.components[0].points, own)
