import numpy as np
import pytest
from grooves import MM, Groove, Noise, draw

from tjscan.errors import GrooveNotFound
from tjscan.groove.find import find_groove
from tjscan.laser.profile import Profile

EXACT = 2e-6
"""Without noise only the leg's shape beyond a parabola is left, in metres."""


@pytest.mark.parametrize("curvature", [0.0, 2.0, 3.3])
@pytest.mark.parametrize("roll", [-0.2, 0.0, 0.2])
def test_corners_without_noise_are_exact(curvature: float, roll: float) -> None:
    groove = Groove(curvature=curvature, roll=roll)
    section = find_groove(draw(groove, Noise(sigma=0)))
    tolerance = EXACT if curvature == 0 else 8 * EXACT
    assert np.abs(section.points_s[1:4, [0, 2]] - groove.corners).max() < tolerance


@pytest.mark.parametrize("seed", range(12))
def test_noise_and_reflections_leave_corners_where_they_are(seed: int) -> None:
    groove = Groove(curvature=2.5, root=0.006)
    noise = Noise(sigma=0.03 * MM, ghosts=0.1, missing=0.05, flyers=0.3)
    section = find_groove(draw(groove, noise, seed))
    assert np.abs(section.points_s[1:4, [0, 2]] - groove.corners).max() < 0.3 * MM


def test_an_empty_profile_is_refused() -> None:
    with pytest.raises(GrooveNotFound) as caught:
        find_groove(Profile(np.full(640, np.nan), np.full(640, np.nan)))
    assert caught.value.reason == "too few points"
