"""The same search on other templates."""

from dataclasses import replace

import numpy as np
import pytest
from grooves import MM, Noise, seen, turned

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.read import fit_groove
from tjscan.groove.settings import BUTT_V, BUTT_V_SHARP, TEE_GROOVE, GrooveModel, GrooveSettings
from tjscan.laser.profile import Profile

NOISE = Noise(sigma=0.03 * MM)
REFLECTIVE = Noise(sigma=0.03 * MM, ghosts=0.05, missing=0.05, flyers=0.3)
CLOSE = 0.2 * MM


def plates(root: float, angle: float = 0.5) -> list[Array]:
    """Sides of a V between two plates, 20 mm deep, the bevels at `angle` from upright."""
    half, depth = root / 2 + 0.02 * np.tan(angle), 0.02
    row = np.array(
        [[0.08, 0], [half, 0], [root / 2, depth], [-root / 2, depth], [-half, 0], [-0.08, 0]]
    )
    if root == 0:
        row = np.delete(row, 3, axis=0)
    points = np.add(turned(row, 0.05), (0.003, 0.24))
    return [points[k : k + 2] for k in range(len(points) - 1)]


def corners(sides: list[Array]) -> Array:
    return np.array([side[0] for side in sides[1:]])


@pytest.mark.parametrize("noise", [NOISE, REFLECTIVE], ids=["noise", "reflections"])
@pytest.mark.parametrize("seed", range(8))
def test_a_butt_joint_shows_its_four_corners(noise: Noise, seed: int) -> None:
    sides = plates(root=0.005)
    fitted = fit_groove(seen(sides, noise, seed), GrooveSettings(model=BUTT_V)).fitted
    off = np.linalg.norm(fitted.corners - corners(sides), axis=1)
    assert off.max() < CLOSE


@pytest.mark.parametrize("seed", range(8))
def test_a_sharp_butt_joint_shows_its_three_corners(seed: int) -> None:
    sides = plates(root=0.0)
    fitted = fit_groove(seen(sides, NOISE, seed), GrooveSettings(model=BUTT_V_SHARP)).fitted
    off = np.linalg.norm(fitted.corners - corners(sides), axis=1)
    assert off.max() < CLOSE


@pytest.mark.parametrize("bow", [0.2 * MM, 0.4 * MM])
@pytest.mark.parametrize("seed", range(4))
def test_bevels_that_bow_meet_the_plates_where_they_are_seen_to(bow: float, seed: int) -> None:
    sides = plates(root=0.0)
    for k in (1, 2):
        (start, end), share = sides[k], np.linspace(0, 1, 81)[:, None]
        along = end - start
        square = np.array((along[1], -along[0])) / np.linalg.norm(along)
        sides[k] = start + share * along + 4 * bow * share * (1 - share) * square
    fitted = fit_groove(seen(sides, NOISE, seed), GrooveSettings(model=BUTT_V)).fitted
    tops = np.linalg.norm(fitted.corners - corners(sides), axis=1)[[0, -1]]
    assert tops.max() < CLOSE


@pytest.mark.parametrize("seed", range(5))
def test_a_mirrored_groove_gives_mirrored_corners(seed: int) -> None:
    profile = seen(plates(root=0.005), REFLECTIVE, seed)
    mirrored = Profile(-profile.x_s, profile.z_s)
    settings = GrooveSettings(model=BUTT_V)
    here = fit_groove(profile, settings).fitted
    there = fit_groove(mirrored, settings).fitted
    np.testing.assert_allclose(there.corners[::-1] * (-1, 1), here.corners, atol=0.02 * MM)


@pytest.mark.parametrize("model", [BUTT_V, BUTT_V_SHARP])
def test_a_template_that_does_not_fit_is_refused(model: GrooveModel) -> None:
    flat = [np.array([[0.08, 0.24], [-0.08, 0.24]])]
    with pytest.raises(GrooveNotFound):
        fit_groove(seen(flat, NOISE), GrooveSettings(model=model))


def test_a_model_has_a_turn_between_each_two_sides() -> None:
    with pytest.raises(ValueError, match="a turn between each two"):
        replace(TEE_GROOVE, turns=TEE_GROOVE.turns[:-1])
    with pytest.raises(ValueError, match="three sides"):
        replace(TEE_GROOVE, sides=TEE_GROOVE.sides[:2], turns=TEE_GROOVE.turns[:1])
