"""The bench's second ray caster against closed forms, and against its own steel."""

import math
from dataclasses import replace

import numpy as np
import pytest
from _second_caster import (
    MM,
    SECOND_FILLED,
    SECOND_GROOVES,
    SecondFault,
    View,
    WedgeGroove,
    between_faces,
    draw_wedge,
    march,
)

VIEW = View(np.array((0.0, 0.01)), np.linspace(-0.21, 0.21, 300))
MARCHED = 1e-7
"""Twelve bisections of a quarter of a millimetre, in metres."""


def groove(seed: int) -> WedgeGroove:
    return draw_wedge(np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(3))
def test_rays_end_on_the_lines_through_the_corners(seed: int) -> None:
    g = replace(groove(seed), bends={})
    points = VIEW.points(march(g, VIEW))
    points = points[np.isfinite(points[:, 0])]
    p2, p3, p4 = g.corners
    off = []
    for start, along in ((p2, g.wall), (p2, p3 - p2), (p3, p4 - p3), (p4, g.leg)):
        normal = np.array((-along[1], along[0])) / np.linalg.norm(along)
        off.append(np.abs((points - start) @ normal))
    assert np.min(off, axis=0).max() < MARCHED
    # Seen from the sensor, wall, bevel, root and leg follow each other.
    assert (np.diff(np.argmin(off, axis=0)[::-1]) >= 0).all()


@pytest.mark.parametrize("fault", [*SECOND_GROOVES, *SECOND_FILLED], ids=lambda f: f.name)
def test_corners_are_on_the_surface_and_rows_repeat(fault: SecondFault) -> None:
    shot = fault.shoot(3)
    np.testing.assert_array_equal(shot.points, fault.shoot(3).points)
    # What stands out over wall and leg, or on a corner, hides it: it is inside.
    g = shot.groove
    bare = replace(g, discs=[], proud={k: v for k, v in g.proud.items() if k in ("bevel", "root")})
    assert np.abs(bare.steel(*g.corners.T)).max() < 1e-9


@pytest.mark.parametrize("fault", SECOND_FILLED[3:6], ids=lambda f: f.name)
def test_the_area_left_is_that_of_the_air_in_the_groove(fault: SecondFault) -> None:
    for seed in range(20):
        g = fault.shoot(seed).groove
        p2, _, p4 = g.corners
        along = np.linalg.solve(np.column_stack((-g.wall, -g.leg)), p4 - p2)[0]
        origin = p2 - along * g.wall
        # A weld that reaches out over the leg leaves less than the air behind the wall's line.
        if (origin - p4) @ g.leg > 0:
            break
    flat = replace(g, bends={})
    low, high = g.corners.min(axis=0) - 0.03, g.corners.max(axis=0) + 0.03
    step = 0.05 * MM
    x, z = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    inside = ~(flat.steel(x, z) > 0)
    inside &= (origin[0] - x) * g.wall[1] - (origin[1] - z) * g.wall[0] > 0
    assert np.count_nonzero(inside) * step**2 == pytest.approx(g.area, rel=0.01)


def test_light_between_faces_is_all_of_it_at_the_notch_and_none_far_away() -> None:
    g = groove(1)
    depth = march(g, VIEW)
    pulled = depth - between_faces(0.8, 0.8)(g, VIEW, depth, np.random.default_rng(2))
    away = np.linalg.norm(VIEW.points(depth) - g.corners[1:].mean(axis=0), axis=1)
    root = math.dist(*g.corners[1:]) / 2
    assert np.abs(pulled[away < 0.9 * root] - 0.8 * MM).max() < 0.02 * MM
    assert pulled[away > 20 * MM].max() < 0.02 * MM
    assert g.affected.tolist() == [False, True, True]
