"""Grooves as they are fitted up: what is there is read, what is not is not invented."""

import numpy as np
import pytest
from grooves import MM, Groove, Noise, pulled_in, raised_cosine, seen, turned

from tjscan.core.frames import Array
from tjscan.groove.read import read_groove
from tjscan.groove.root import OPEN_ROOT, SEAM_BESIDE
from tjscan.groove.section import TACK_WELD, GrooveSection
from tjscan.laser.profile import Profile

NOISE = Noise(sigma=0.03 * MM)
SURE = 0.4 * MM
SEEDS = range(4)


def bowed(start: Array, end: Array, height: float, power: float = 1.0) -> Array:
    """A parabola over a chord, towards the sensor, shape (41, 2); blunter with a lower power."""
    s = np.linspace(0, 1, 41)[:, None]
    along = end - start
    away = np.array([along[1], -along[0]]) / np.linalg.norm(along)
    return np.asarray(start + s * along - height * (4 * s * (1 - s)) ** power * away)


def normalised(section: GrooveSection, corners: Array) -> Array:
    """Squared errors of the corners over what the section states, shape (3,)."""
    off = section.points_s[1:4, [0, 2]] - corners
    return np.array(
        [
            e @ np.linalg.solve(c, e) / 2
            for e, c in zip(off, section.corner_covariances_s, strict=True)
        ]
    )


@pytest.mark.parametrize("height", [-0.8, 0.2, 0.4, 1.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_curved_root_bead_leaves_its_corners_where_they_are(height: float, seed: int) -> None:
    groove = Groove(root=0.007)
    sides = groove.outline()
    sides[2] = bowed(groove.corners[1], groove.corners[2], height * MM)
    section = read_groove(seen(sides, NOISE, seed))
    assert normalised(section, groove.corners).max() < 8
    off = np.linalg.norm(section.points_s[1:4, [0, 2]] - groove.corners, axis=1)
    assert off.max() < 0.3 * MM


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("rise", [4, 6])
def test_a_blunt_root_pass_has_both_its_toes(rise: int, seed: int) -> None:
    groove = Groove(root=0.004)
    sides, d = groove.outline(), groove.directions
    low, out = groove.corners[1] - rise * MM * d[1], groove.corners[2] + rise * MM * d[3]
    sides[1] = np.array([groove.corners[0], low])
    sides[2] = bowed(low, out, 0.12 * float(np.linalg.norm(out - low)), power=0.75)
    sides[3] = np.array([out, groove.corners[2] + 0.12 * d[3]])
    section = read_groove(seen(sides, NOISE, seed))
    off = np.linalg.norm(section.points_s[1:4, [0, 2]] - (groove.corners[0], low, out), axis=1)
    assert off.max() < SURE


@pytest.mark.parametrize("seed", SEEDS)
def test_a_tack_is_named_and_the_corners_under_it_are_not_known(seed: int) -> None:
    groove = Groove(root=0.004)
    sides, d = groove.outline(), groove.directions
    low, out = groove.corners[1] - 0.006 * d[1], groove.corners[2] + 0.006 * d[3]
    sides[1] = np.array([groove.corners[0], low])
    sides[2] = bowed(low, out, 0.25 * float(np.linalg.norm(out - low)))
    sides[3] = np.array([out, groove.corners[2] + 0.12 * d[3]])
    section = read_groove(seen(sides, NOISE, seed))
    assert TACK_WELD in section.conditions
    assert section.absent == ("p3", "p4")
    assert np.sqrt(np.trace(section.corner_covariances_s[1])) > SURE
    assert normalised(section, groove.corners)[0] < 8


@pytest.mark.parametrize("seed", SEEDS)
def test_an_open_root_is_named_and_measured(seed: int) -> None:
    groove, opening = Groove(root=0.006), 0.003
    d, (p2, p3, _) = groove.directions, groove.corners
    square = np.array([d[3][1], -d[3][0]])  # into the leg
    foot = p3 + opening * square
    sides = [
        groove.outline()[0],
        np.array([p2, p3]),
        np.array([p3, p3 - 0.02 * d[3]]),
        np.array([foot - 0.03 * d[3], foot + 0.12 * d[3]]),
    ]
    section = read_groove(seen(sides, NOISE, seed))
    assert OPEN_ROOT in section.conditions
    assert section.absent == ("p4",)
    assert section.root_opening == pytest.approx(opening, abs=0.3 * MM)
    assert np.linalg.norm(section.points_s[2, [0, 2]] - p3) < SURE


@pytest.mark.parametrize("bend", np.radians([-7, 7]))
def test_a_bevel_in_two_facets_has_the_corners_of_both(bend: float) -> None:
    groove = Groove()
    sides, (p2, p3, _) = groove.outline(), groove.corners
    knee = p2 + 0.5 * turned(p3 - p2, bend / 2) / np.cos(bend / 2)
    sides[1] = np.array([p2, knee, p3])
    sections = [read_groove(seen(sides, NOISE, seed)) for seed in range(6)]
    # One that takes the knee for an end states how far it may be off.
    assert max(normalised(section, groove.corners).max() for section in sections) < 8
    assert sum(section.model == "tee with two facets" for section in sections) >= 5


@pytest.mark.parametrize("seed", SEEDS)
def test_a_seam_weld_beside_the_groove_is_named(seed: int) -> None:
    groove = Groove()
    sides, d, p4 = groove.outline(), groove.directions, groove.corners[2]
    begin, end = p4 + 0.012 * d[3], p4 + 0.025 * d[3]
    sides.append(bowed(begin, end, 2 * MM))
    section = read_groove(seen(sides, NOISE, seed))
    assert SEAM_BESIDE in section.conditions
    assert normalised(section, groove.corners).max() < 8


@pytest.mark.parametrize("seed", range(8))
def test_ghosts_before_the_surface_move_no_corner_that_is_stated_to_be_known(seed: int) -> None:
    rng = np.random.default_rng(seed)
    groove = Groove()
    profile = seen(groove.outline(), NOISE, seed)
    x, z = profile.x_s.copy(), profile.z_s.copy()
    for first in rng.integers(120, 500, 4):
        run = slice(first, first + int(rng.integers(8, 25)))
        scale = 1 - rng.uniform(2, 8) * MM / z[run]
        x[run], z[run] = x[run] * scale, z[run] * scale
    section = read_groove(Profile(x, z))
    off = np.linalg.norm(section.points_s[1:4, [0, 2]] - groove.corners, axis=1)
    known = np.sqrt(np.trace(section.corner_covariances_s, axis1=1, axis2=2)) < SURE
    assert known[0]
    assert off[known].max() < 1 * MM


def moved_along_rays(profile: Profile, columns: slice, by: float) -> Profile:
    """A run of points moved away from the sensor, in metres."""
    x, z = profile.x_s.copy(), profile.z_s.copy()
    scale = 1 + by / z[columns]
    x[columns], z[columns] = x[columns] * scale, z[columns] * scale
    return Profile(x, z)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_face_longer_than_any_ghost_is_known_though_its_ends_are_hidden(seed: int) -> None:
    groove = Groove(root=0.006)
    profile = seen(groove.outline(), NOISE, seed)
    for corner in groove.corners[1:]:
        at = int(np.abs(profile.x_s / profile.z_s - corner[0] / corner[1]).argmin())
        for k in range(at - 2, at + 3):
            profile = moved_along_rays(profile, slice(k, k + 1), (1 + 2 * (k % 2)) * MM)
    profile = moved_along_rays(profile, slice(40, 55), 5 * MM)
    section = read_groove(profile)
    off = np.linalg.norm(section.points_s[1:4, [0, 2]] - groove.corners, axis=1)
    assert off.max() < 0.3 * MM
    assert np.sqrt(np.trace(section.corner_covariances_s, axis1=1, axis2=2)).max() < SURE


@pytest.mark.parametrize("by", [-0.55, 0.55])
@pytest.mark.parametrize("beside", range(-2, 3))
def test_a_stray_point_at_a_corner_is_no_steel(by: float, beside: int) -> None:
    groove = Groove()
    profile = seen(groove.outline(), NOISE, 1)
    top = int(np.linalg.norm(profile.points - groove.corners[0], axis=1).argmin())
    at = slice(top + beside, top + beside + 1)
    section = read_groove(moved_along_rays(profile, at, by * MM))
    assert np.sqrt(np.trace(section.corner_covariances_s[0])) < 0.1 * MM


@pytest.mark.parametrize("by", [-3, 3])
@pytest.mark.parametrize("share", [0.4, 0.5, 0.6])
def test_a_bevel_half_of_which_is_a_reflection_is_not_surely_elsewhere(
    by: float, share: float
) -> None:
    groove = Groove()
    profile = seen(groove.outline(), NOISE, 1)
    x, z = profile.x_s.copy(), profile.z_s.copy()
    tangents, (p2, p3, _) = x / z, groove.corners
    ends = sorted((p2[0] / p2[1], p3[0] / p3[1]))
    at = ends[0] + share * (ends[1] - ends[0])
    run = (tangents > ends[0]) & (tangents < at)
    scale = 1 + by * MM / z[run]
    x[run], z[run] = x[run] * scale, z[run] * scale
    section = read_groove(Profile(x, z))
    off = np.linalg.norm(section.points_s[1:4, [0, 2]] - groove.corners, axis=1)
    known = np.sqrt(np.trace(section.corner_covariances_s, axis1=1, axis2=2)) < SURE
    assert off[known].max(initial=0.0) < 1 * MM


@pytest.mark.parametrize("pull", [0.2, 0.4, 0.8, 1.4])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_notch_that_light_pulls_in_is_stated_to_be_unknown(pull: float, seed: int) -> None:
    groove = Groove(root=0.006)
    profile = seen(groove.outline(), NOISE, seed)
    section = read_groove(pulled_in(profile, groove, pull * MM, raised_cosine))
    assert normalised(section, groove.corners).max() < 8


@pytest.mark.parametrize("opening", [0.75, 0.9])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_leg_under_an_open_root_is_not_taken_for_the_end_of_the_bevel(
    opening: float, seed: int
) -> None:
    # Bevel and leg, drawn on, meet among points of the leg that are seen through the opening.
    groove = Groove(opening=opening, roll=-0.1)
    d, (p2, p3, _) = groove.directions, groove.corners
    foot = p3 + 3 * MM * np.array([d[3][1], -d[3][0]])
    sides = [
        groove.outline()[0],
        np.array([p2, p3]),
        np.array([p3, p3 - 2 * MM * d[3], p3 - 2 * MM * d[3] + 0.02 * np.array([1.0, -0.5])]),
        np.array([foot - 0.03 * d[3], foot + 0.12 * d[3]]),
    ]
    section = read_groove(seen(sides, NOISE, seed))
    assert OPEN_ROOT in section.conditions
    assert np.linalg.norm(section.points_s[2, [0, 2]] - p3) < 1 * MM
