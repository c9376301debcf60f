"""Laws of reading a groove: what must not matter doesn't, what must does in proportion."""

import numpy as np
import pytest
from grooves import MM, Groove, Noise, draw, seen, turned
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.groove.read import read_groove
from tjscan.groove.section import GrooveSection
from tjscan.laser.profile import Profile

EXACT = 3e-6
"""Without noise only the cubic's misfit to an arc is left, in metres."""

LONG_ARC = 10e-6
"""The same where the leg is seen for 70 mm, in metres."""

SAME = 8e-6
"""A different vantage assigns a few points at corners to the other side: a third of sigma."""

GROOVE = Groove(curvature=2.0)
NOISE = Noise(sigma=0.03 * MM)
REFLECTIVE = Noise(sigma=0.03 * MM, ghosts=0.12, missing=0.08, flyers=0.3)
CENTRE = np.array([0.0, 0.24])


def corners(section: GrooveSection) -> Array:
    return section.points_s[1:4, [0, 2]]


def moved(profile: Profile, angle: float, shift: Array) -> Profile:
    points = np.column_stack((profile.x_s, profile.z_s))
    x, z = (turned(points - CENTRE, angle) + CENTRE + shift).T
    return Profile(x, z)


@pytest.mark.parametrize("curvature", [0.0, 2.0, 3.3])
@pytest.mark.parametrize("roll", [-0.2, 0.0, 0.2])
@pytest.mark.parametrize("root", [0.002, 0.01])
def test_corners_without_noise_are_exact(curvature: float, roll: float, root: float) -> None:
    groove = Groove(curvature=curvature, roll=roll, root=root)
    section = read_groove(draw(groove, Noise(sigma=0)))
    assert np.abs(corners(section) - groove.corners).max() < EXACT
    # Ends lie on the wall above p2 and on the leg beyond p4.
    assert section.points_s[0, 0] > section.points_s[1, 0]
    assert section.points_s[4, 0] < section.points_s[3, 0]


@pytest.mark.parametrize("sigma", [0.0, 0.005, 0.03])
@pytest.mark.parametrize("curvature", [2.0, 3.3])
@pytest.mark.parametrize("high", [0.020, 0.025])
def test_little_of_the_wall_is_enough_with_noise_and_without(
    sigma: float, curvature: float, high: float
) -> None:
    # 8 mm of wall at the field's edge, and a long leg whose tangents are many.
    groove = Groove(curvature=curvature, bevel=0.024, opening=0.9, shift=(high, 0.0))
    sides = groove.outline()
    sides[0] = groove.corners[0] + np.outer((-0.008, 0), groove.directions[0])
    section = read_groove(seen(sides, Noise(sigma=sigma * MM)))
    assert np.abs(corners(section) - groove.corners).max() < 4 * sigma * MM + LONG_ARC


@pytest.mark.parametrize("opening", np.radians([45, 60, 75, 90]))
@pytest.mark.parametrize("ridge", np.radians([20, 40, 60]))
def test_angles_without_noise_are_exact(opening: float, ridge: float) -> None:
    section = read_groove(draw(Groove(opening=opening, ridge=ridge), Noise(sigma=0)))
    assert section.groove_angle == pytest.approx(opening, abs=1e-4)
    # The wall stands at the ridge's angle to the bevel.
    assert section.gamma_1 == pytest.approx(np.pi / 2 - ridge, abs=1e-4)


@settings(max_examples=25, deadline=None)
@given(
    angle=st.floats(-0.26, 0.26),
    x=st.floats(-0.02, 0.02),
    z=st.floats(-0.02, 0.02),
    seed=st.integers(0, 20),
)
def test_moving_the_profile_moves_the_corners(angle: float, x: float, z: float, seed: int) -> None:
    profile, shift = draw(GROOVE, NOISE, seed), np.array([x, z])
    here, there = read_groove(profile), read_groove(moved(profile, angle, shift))
    expected = turned(corners(here) - CENTRE, angle) + CENTRE + shift
    assert np.abs(corners(there) - expected).max() < SAME
    assert there.area == pytest.approx(here.area, rel=2e-3)
    assert there.groove_angle == pytest.approx(here.groove_angle, abs=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_the_order_of_columns_does_not_matter(seed: int) -> None:
    profile = draw(GROOVE, REFLECTIVE, seed)
    back = Profile(profile.x_s[::-1], profile.z_s[::-1])
    np.testing.assert_allclose(read_groove(back).points_s, read_groove(profile).points_s, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_the_same_profile_gives_the_same_section(seed: int) -> None:
    profile = draw(GROOVE, REFLECTIVE, seed)
    np.testing.assert_array_equal(read_groove(profile).points_s, read_groove(profile).points_s)


def rms(groove: Groove, noise: Noise, columns: int = 640, runs: int = 40) -> float:
    found = [corners(read_groove(draw(groove, noise, seed, columns))) for seed in range(runs)]
    return float(np.sqrt(np.mean((np.array(found) - groove.corners) ** 2)))


def test_errors_grow_in_proportion_to_noise() -> None:
    groove = Groove()
    small, large = (rms(groove, Noise(sigma=s * MM)) for s in (0.015, 0.045))
    assert large / small == pytest.approx(3, rel=0.2)


def test_errors_shrink_with_the_root_of_the_number_of_points() -> None:
    groove = Groove(root=0.008)
    white = Noise(sigma=0.03 * MM, correlation=0)
    few, many = (rms(groove, white, columns) for columns in (160, 640))
    assert few / many == pytest.approx(2, rel=0.25)


@settings(max_examples=40, deadline=None)
@given(
    column=st.integers(0, 639),
    run=st.integers(1, 3),
    by=st.floats(-0.03, 0.03),
    seed=st.integers(0, 5),
)
def test_no_outlier_moves_a_corner_by_much(column: int, run: int, by: float, seed: int) -> None:
    profile = draw(GROOVE, NOISE, seed)
    x, z = profile.x_s.copy(), profile.z_s.copy()
    spoiled = slice(column, column + run)
    scale = 1 + by / 0.24
    x[spoiled], z[spoiled] = x[spoiled] * scale, z[spoiled] * scale
    clean = read_groove(profile)
    sigma = np.sqrt(np.diag(clean.covariance_s)).max()
    off = corners(read_groove(Profile(x, z))) - corners(clean)
    assert np.abs(off).max() < 2 * sigma


@pytest.mark.parametrize("seed", range(40))
def test_reflections_leave_corners_where_they_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    groove = Groove(
        opening=rng.uniform(0.9, 1.5),
        ridge=rng.uniform(0.4, 1.0),
        root=rng.uniform(0.004, 0.008),
        roll=rng.uniform(-0.1, 0.1),
        curvature=rng.uniform(0, 3.3),
    )
    section = read_groove(draw(groove, REFLECTIVE, seed))
    off = np.linalg.norm(corners(section) - groove.corners, axis=1)
    assert off.max() < 0.3 * MM


@pytest.mark.parametrize("correlation", [0, 2, 5])
@pytest.mark.parametrize("wall", [0.0, 0.2], ids=["straight wall", "curved wall"])
def test_errors_are_as_large_as_the_section_says(correlation: int, wall: float) -> None:
    groove = Groove(curvature=2.0, wall_curvature=wall)
    normalised = []
    for seed in range(100 * correlation, 100 * correlation + 100):
        section = read_groove(draw(groove, Noise(0.02 * MM, correlation), seed))
        off = corners(section) - groove.corners
        spread = np.linalg.inv(section.corner_covariances_s)
        normalised.append(np.einsum("ki,kij,kj->k", off, spread, off) / 2)
    # Chi-square over its degrees of freedom; 100 runs leave a quarter.
    assert np.mean(normalised) == pytest.approx(1, abs=0.25)


def test_measures_scatter_as_much_as_the_section_says() -> None:
    sections = [read_groove(draw(GROOVE, NOISE, seed)) for seed in range(60)]
    stated = np.sqrt(np.mean([np.diag(s.measure_covariance) for s in sections], axis=0))
    names = ("groove_angle", "root_width", "depth", "area")
    for name, said in zip(names, stated, strict=True):
        scatter = np.std([getattr(s, name) for s in sections])
        assert said / scatter == pytest.approx(1, abs=0.45), name


@pytest.mark.parametrize("seed", range(3))
def test_a_corner_is_doubted_beyond_which_a_face_goes_on(seed: int) -> None:
    """A bevel is ground in two facets, and the lower one is not seen: drawn on, the upper one
    meets the root's face before its end."""
    groove = Groove()
    wall, (p2, p3), face, leg = groove.outline()
    knee = p2 + 0.55 * (p3 - p2)
    top = knee + turned(p2 - knee, 0.12)
    profile = seen([wall + top - p2, np.array((top, knee, p3)), face, leg], NOISE, seed)
    bearings, (low, high) = profile.x_s / profile.z_s, sorted((knee[0] / knee[1], p3[0] / p3[1]))
    hidden = (bearings > low) & (bearings < high)
    x, z = (np.where(hidden, np.nan, v) for v in (profile.x_s, profile.z_s))
    section = read_groove(Profile(x, z))
    off = float(np.linalg.norm(corners(section)[1] - p3))
    assert 2 * MM < off < 2.5 * np.sqrt(np.trace(section.corner_covariances_s[1]))


@pytest.mark.parametrize("seed", range(3))
def test_a_corner_is_doubted_if_its_side_is_seen_again_far_beyond_it(seed: int) -> None:
    """A run of points in the bevel's place lies on the wall, drawn on, and jumps at both ends."""
    groove = Groove()
    profile, (p2, p3) = seen(groove.outline(), NOISE, seed), groove.corners[:2]
    x, z = profile.x_s.copy(), profile.z_s.copy()
    share = (x / z - p2[0] / p2[1]) / (p3[0] / p3[1] - p2[0] / p2[1])
    run, (tx, tz) = (share > 0.5) & (share < 0.65), groove.directions[0]
    depth = (p2[1] * tx - p2[0] * tz) / (tx - x[run] / z[run] * tz)
    x[run], z[run] = (
        x[run] / z[run] * depth,
        depth + z[run] - np.polyval(np.polyfit(x[run], z[run], 1), x[run]),
    )
    section = read_groove(Profile(x, z))
    assert np.linalg.norm(corners(section)[0] - p2) < 0.2 * MM
    away = np.column_stack((x[run], z[run])) - p2
    sigma = np.sqrt(np.trace(section.corner_covariances_s[0]))
    assert sigma > 0.9 * np.sqrt(np.mean(np.sum(away**2, axis=1)))
