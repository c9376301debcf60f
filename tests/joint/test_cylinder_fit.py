"""A cylinder settles on its own points, however the search began and whatever else lies about."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.joint.tubes.cylinder import Cylinder, refine_cylinder

TUBE = Cylinder(np.array((0.1, -0.2, 0.3)), np.array((0.3, 0.2, 0.9)), 0.3)
NOISE = 30e-6
SAME = 1e-7
"""Metres and radians between two ends of one search."""


def wall(rng: np.random.Generator, count: int, noise: float) -> Array:
    """Points on 150° of the tube, some way along it."""
    across = np.linalg.svd(TUBE.axis[None])[2][1:]
    turn, along = rng.uniform(0, 2.6, count), rng.uniform(-0.1, 0.1, count)
    radius = TUBE.radius + rng.normal(0, noise, count)
    ring = np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1]
    return np.asarray(TUBE.point + along[:, None] * TUBE.axis + radius[:, None] * ring)


def apart(one: Cylinder, other: Cylinder) -> float:
    """Largest difference of radius, direction, and place beside the points."""
    between = one.point - other.point
    across = between - (between @ other.axis) * other.axis
    turned = float(np.linalg.norm(np.cross(one.axis, other.axis)))
    return max(abs(one.radius - other.radius), float(np.linalg.norm(across)), turned)


@given(st.lists(st.floats(-1, 1), min_size=5, max_size=5))
@settings(max_examples=25)
def test_every_rough_start_ends_at_the_same_cylinder(start: list[float]) -> None:
    rng = np.random.default_rng(1)
    ghosts = wall(rng, 300, 1e-3)
    points = np.concatenate((wall(rng, 3000, NOISE), ghosts))
    best = refine_cylinder(TUBE, points)
    step = np.array(start) * (1e-3, 1e-3, 3e-3, 3e-3, 1e-3)
    assert apart(refine_cylinder(TUBE.boxplus(step), points), best) < SAME
    # 150° hold the axis some ten times less well than the points' mean, and there are 3000.
    assert apart(best, TUBE) < 2 * NOISE


def test_exact_points_give_the_exact_cylinder() -> None:
    points = wall(np.random.default_rng(2), 200, 0.0)
    found = refine_cylinder(TUBE.boxplus(np.full(5, 1e-3)), points)
    assert apart(found, TUBE) < SAME
    assert found.radius == pytest.approx(TUBE.radius, abs=SAME)


def test_where_nothing_lies_near_nothing_changes() -> None:
    points = wall(np.random.default_rng(3), 200, 0.0) + 10.0
    assert refine_cylinder(TUBE, points) is TUBE
