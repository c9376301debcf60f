"""Partly filled grooves whose flanks are known: nothing else is assumed of the weld."""

from dataclasses import replace

import numpy as np
import pytest
from grooves import MM, Groove, Noise, seen, turned

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.filled import FilledGroove, KnownFlanks, read_filled_groove
from tjscan.groove.read import read_groove
from tjscan.laser.profile import Profile

NOISE = Noise(sigma=0.03 * MM)
GROOVE = Groove(root=0.006, curvature=2.0)


def flanks(groove: Groove = GROOVE) -> KnownFlanks:
    sides = groove.outline()
    points = np.vstack((sides[0][0], groove.corners, sides[3][200]))
    wall, _, _, leg = groove.directions
    return KnownFlanks.of_points(points, wall, leg)


def weld(rise: float, out: float, bow: float, groove: Groove = GROOVE) -> list[Array]:
    """Sides with a weld so far up the bevel and out on the leg; its arc is `bow` of its width."""
    wall, bevel, _, leg = groove.outline()
    start = bevel[1] + rise * (bevel[0] - bevel[1]) / np.linalg.norm(bevel[0] - bevel[1])
    far = np.linalg.norm(leg - leg[0], axis=1) > out
    end = leg[far][0]
    s, along = np.linspace(0, 1, 41)[:, None], end - start
    towards = np.array((-along[1], along[0]))
    surface = start + s * along + 4 * bow * s * (1 - s) * towards
    return [wall, np.array((bevel[0], start)), surface, leg[far]]


def area_left(sides: list[Array]) -> float:
    """Over the weld, to where wall and leg meet, by the shoelace formula."""
    wall, leg = GROOVE.directions[0], sides[3][1] - sides[3][0]
    top, foot = sides[1][0], sides[3][0]
    along = np.linalg.solve(np.column_stack((wall, -leg)), foot - top)[0]
    x, z = np.vstack((top, sides[2], top + along * wall)).T
    return 0.5 * float(x @ np.roll(z, -1) - z @ np.roll(x, -1))


def assert_area(found: FilledGroove, sides: list[Array]) -> None:
    section, true = found.section, area_left(sides)
    assert abs(section.area - true) < max(3.5 * section.area_sigma, 1e-12)
    assert section.area_sigma < 0.03 * abs(true) + 1 * MM**2


@pytest.mark.parametrize("bow", [-0.08, 0.0, 0.15])
@pytest.mark.parametrize("rise", [6.0, 15.0, 28.0])
def test_the_area_left_is_that_over_the_weld(rise: float, bow: float) -> None:
    sides = weld(rise * MM, 0.8 * rise * MM, bow)
    found = read_filled_groove(seen(sides, NOISE, 1), flanks())
    assert_area(found, sides)
    assert np.linalg.norm(found.section.points_s[1, [0, 2]] - GROOVE.corners[0]) < 0.06 * MM


@pytest.mark.parametrize("closed", [-2.0, 1.0, 2.0])
def test_a_wall_that_has_moved_is_found_with_its_bevel(closed: float) -> None:
    sides, known = weld(15 * MM, 12 * MM, 0.05), flanks()
    # The groove was wider or narrower when it was scanned.
    away, corners = np.array((known.wall[1], -known.wall[0])), known.corners.copy()
    corners[:2] += closed * MM * away
    found = read_filled_groove(seen(sides, NOISE, 2), replace(known, corners=corners))
    assert_area(found, sides)
    off = found.section.points_s[1, [0, 2]] - GROOVE.corners[0]
    spread = found.section.corner_covariances_s[0]
    assert off @ np.linalg.solve(spread, off) < 14  # 99.9 % of chi-squared with two


def test_over_a_covered_top_the_corner_goes_with_the_wall() -> None:
    sides = weld(33.5 * MM, 30 * MM, 0.02)
    found = read_filled_groove(seen(sides, NOISE, 3), flanks())
    assert found.section.absent == ("p2",)
    spread = found.section.corner_covariances_s[0]
    across = flanks().wall @ np.array(((0, 1), (-1, 0)))
    assert np.sqrt(across @ spread @ across) < 0.03 * MM < 0.14 * MM < np.sqrt(np.trace(spread))


@pytest.mark.parametrize("seed", range(3))
def test_reflections_are_no_steel(seed: int) -> None:
    sides = weld(15 * MM, 12 * MM, 0.05)
    profile = seen(sides, NOISE, seed)
    rng, z = np.random.default_rng(seed), profile.z_s.copy()
    for first in rng.integers(220, 400, 4):
        z[first : first + 20] += rng.choice((-1, 1)) * rng.uniform(2, 8) * MM
    shifted = Profile(profile.x_s * z / profile.z_s, z)
    found = read_filled_groove(shifted, flanks())
    true = profile.points[profile.valid]
    off = np.linalg.norm(found.points[:, None] - true, axis=2).min(axis=1)
    assert off.max() < 0.4 * MM
    # A hole may hide more or less.
    assert abs(found.section.area - area_left(sides)) < 3.5 * found.section.area_sigma


def test_a_bare_groove_has_the_area_of_its_section() -> None:
    profile = seen(GROOVE.outline(), NOISE, 4)
    section = read_groove(profile)
    bare = (v[..., [0, 2]] for v in (section.points_s, section.wall_s, section.leg_s))
    found = read_filled_groove(profile, KnownFlanks.of_points(*bare))
    sigma = np.hypot(section.area_sigma, found.section.area_sigma)
    assert abs(found.section.area - section.area) < 3 * sigma


def test_the_order_of_the_columns_does_not_matter() -> None:
    profile = seen(weld(15 * MM, 12 * MM, 0.05), NOISE, 5)
    a = read_filled_groove(profile, flanks())
    b = read_filled_groove(Profile(profile.x_s[::-1], profile.z_s[::-1]), flanks())
    assert b.section.area == pytest.approx(a.section.area, rel=1e-9)


def test_sigmas_are_those_of_the_points() -> None:
    sides = weld(15 * MM, 12 * MM, 0.05)
    profile, clean = seen(sides, NOISE, 6), seen(sides, replace(NOISE, sigma=1e-9), 6)
    found = read_filled_groove(profile, flanks())
    z = dict(zip(profile.x_s / profile.z_s, clean.z_s, strict=True))
    off = [p[1] - z[p[0] / p[1]] for p in found.points[found.weld]]
    ratio = np.std(off) / np.median(found.sigmas[found.weld])
    assert 0.5 < ratio < 1.5


@pytest.mark.parametrize("moved", [(8.0, 0.0), (0.0, -12.0)])
def test_another_groove_is_refused(moved: tuple[float, float]) -> None:
    known = flanks()
    elsewhere = replace(known, corners=known.corners + MM * np.array(moved))
    with pytest.raises(GrooveNotFound):
        read_filled_groove(seen(weld(15 * MM, 12 * MM, 0.05), NOISE, 7), elsewhere)


def test_known_flanks_turn_with_the_sensor() -> None:
    """What is known in a frame that is turned by a little is still enough."""
    known = flanks()
    small = 0.003
    off = replace(
        known,
        corners=known.corners[2] + turned(known.corners - known.corners[2], small),
        wall=turned(known.wall, small),
        leg=turned(known.leg, small),
    )
    sides = weld(15 * MM, 12 * MM, 0.05)
    assert_area(read_filled_groove(seen(sides, NOISE, 8), off), sides)
