"""A pulled-in notch shows itself in its flanks; a sound one, and one with a curved bead, do not."""

from collections.abc import Callable

import numpy as np
import pytest
from grooves import MM, Groove, Noise, pulled_in, raised_cosine, seen

from tjscan.core.frames import Array
from tjscan.groove.read import order_points
from tjscan.groove.search import find_supported_fits
from tjscan.groove.settings import DEFAULT_SETTINGS
from tjscan.groove.shape import NotchPull, find_pull
from tjscan.groove.sides import FittedProfile
from tjscan.laser.profile import Profile

NOISE = Noise(sigma=0.03 * MM)
GROOVE = Groove(root=0.006)


def bell(away: Array) -> Array:
    return np.asarray(np.exp(-((away / (2 * MM)) ** 2)))


def cone(away: Array) -> Array:
    return np.clip(1 - away / (3 * MM), 0, 1)


def wedge(away: Array) -> Array:
    """View factor of a strip of 2.4 mm beside the edge of a wedge of 60 degrees."""
    strip = 2.4 * MM
    across = np.sqrt(away**2 + strip**2 - away * strip)
    return np.asarray((1 + (strip / 2 - away) / across) / 1.5)


def pull_of(profile: Profile) -> tuple[NotchPull, FittedProfile]:
    row = order_points(profile, DEFAULT_SETTINGS)
    found = find_supported_fits(row, DEFAULT_SETTINGS)[0]
    return find_pull(row, found.fitted, len(found.model.sides) - 2), found.fitted


@pytest.mark.parametrize("fade", [raised_cosine, bell, cone, wedge])
@pytest.mark.parametrize("by", [0.4, 0.8, 1.2])
def test_corners_lie_where_their_rays_meet_the_flanks(
    by: float, fade: Callable[[Array], Array]
) -> None:
    profile = pulled_in(seen(GROOVE.outline(), NOISE, 1), GROOVE, by * MM, fade)
    pull, fitted = pull_of(profile)
    assert pull.probability > 0.9
    places = zip((0, 1), (-3, -1), (1, -1), strict=True)
    for i, side, sign in places:
        own = fitted.curves[side].position_along_chord(*GROOVE.corners[1 + i].tolist())
        true = sign * (own - fitted.places[-2 + i][i])
        assert abs(pull.inward[i] - true) < max(0.27 * true, 0.1 * MM)


@pytest.mark.parametrize("seed", range(6))
def test_a_sound_notch_is_not_pulled_in(seed: int) -> None:
    pull, _ = pull_of(seen(GROOVE.outline(), NOISE, seed))
    assert pull.probability < 0.05


@pytest.mark.parametrize("height", [-0.9, -0.4, 0.4, 0.9])
def test_a_curved_bead_is_not_pulled_in(height: float) -> None:
    sides, (_, p3, p4) = GROOVE.outline(), GROOVE.corners
    s, along = np.linspace(0, 1, 41)[:, None], p4 - p3
    away = np.array([along[1], -along[0]]) / np.linalg.norm(along)
    sides[2] = p3 + s * along - height * MM * 4 * s * (1 - s) * away
    pull, _ = pull_of(seen(sides, NOISE, 2))
    assert pull.probability < 0.05
