"""Where no groove can be read with confidence, none is."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from grooves import MM, Groove, Noise, draw, seen

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.read import read_groove
from tjscan.groove.settings import BUTT_V, GrooveSettings
from tjscan.laser.profile import Profile

REASONS = {"too few points", "no bevel", "ambiguous", "out of range"}
NOISE = Noise(sigma=0.03 * MM)


def refusal(profile: Profile, settings: GrooveSettings | None = None) -> GrooveNotFound:
    with pytest.raises(GrooveNotFound) as caught:
        read_groove(profile, settings or GrooveSettings())
    assert caught.value.reason in REASONS
    return caught.value


def over(depth: Callable[[Array], Array], seed: int = 0) -> Profile:
    x = np.linspace(-0.05, 0.05, 640)
    noise = 0.03 * MM * np.random.default_rng(seed).standard_normal(640)
    return Profile(x, 0.24 + depth(x) + noise)


@pytest.mark.parametrize("count", [0, 3, 79])
def test_few_points_are_refused(count: int) -> None:
    profile = draw(Groove(), NOISE)
    x, z = np.full(640, np.nan), np.full(640, np.nan)
    x[:count], z[:count] = profile.x_s[:count], profile.z_s[:count]
    assert refusal(Profile(x, z)).reason == "too few points"


def test_zeros_that_stand_for_no_point_are_none() -> None:
    profile = draw(Groove(), NOISE)
    hidden = np.arange(640) % 5 == 0
    x, z = profile.x_s.copy(), profile.z_s.copy()
    x[hidden] = z[hidden] = np.nan
    there = read_groove(Profile(x, z))
    for x_0, z_0 in ((0.0, 0.0), (0.01, 0.0), (0.01, -0.1)):
        x[hidden], z[hidden] = x_0, z_0
        np.testing.assert_array_equal(read_groove(Profile(x, z)).points_s, there.points_s)
    assert refusal(Profile(profile.x_s, np.zeros(640))).reason == "too few points"


def test_an_empty_profile_is_refused() -> None:
    assert refusal(Profile(np.empty(0), np.empty(0))).reason == "too few points"


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("slope", [-1.0, -0.3, 0.0, 0.5])
def test_a_plane_is_refused(slope: float, seed: int) -> None:
    refusal(over(lambda x: slope * x, seed))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("slope", [-1.0, -0.4, 0.4, 1.0])
def test_one_edge_is_refused(slope: float, seed: int) -> None:
    refusal(over(lambda x: slope * np.abs(x - 0.005), seed))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("radius", [0.06, 0.15, 0.3])
def test_a_pipe_is_refused(radius: float, seed: int) -> None:
    refusal(over(lambda x: radius - np.sqrt(radius**2 - x**2), seed))


@pytest.mark.parametrize("seed", range(6))
def test_dust_is_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    refusal(over(lambda x: rng.uniform(-0.05, 0.05, x.shape), seed))


def test_a_constant_profile_is_refused() -> None:
    refusal(Profile(np.full(640, 0.01), np.full(640, 0.24)))


@pytest.mark.parametrize("seed", range(4))
def test_a_groove_upside_down_is_refused(seed: int) -> None:
    profile = draw(Groove(), NOISE, seed)
    assert refusal(Profile(-profile.x_s, profile.z_s)).reason in {"no bevel", "ambiguous"}


@pytest.mark.parametrize(("side", "word"), [(0, "wall"), (3, "leg")], ids=["no wall", "no leg"])
@pytest.mark.parametrize("seed", range(4))
def test_a_groove_that_lacks_an_end_is_out_of_range(side: int, word: str, seed: int) -> None:
    sides = Groove().outline()
    del sides[side]
    error = refusal(seen(sides, NOISE, seed))
    assert error.reason == "out of range"
    assert word in error.detail


@pytest.mark.parametrize("seed", range(4))
def test_a_groove_without_a_bevel_is_refused(seed: int) -> None:
    sides = Groove().outline()
    del sides[1]
    refusal(seen(sides, NOISE, seed))


@pytest.mark.parametrize("seed", range(4))
def test_what_lies_at_a_root_that_is_not_seen_is_not_invented(seed: int) -> None:
    groove = Groove()
    sides = groove.outline()
    del sides[2]
    section = read_groove(seen(sides, NOISE, seed))
    assert section.absent == ("p3", "p4")
    off = section.points_s[1:4, [0, 2]] - groove.corners
    assert np.linalg.norm(off[0]) < 0.2 * MM
    # What is given for the others is as uncertain as it is wrong.
    for miss, spread in zip(off[1:], section.corner_covariances_s[1:], strict=True):
        assert miss @ np.linalg.solve(spread, miss) < 9


def test_a_refusal_carries_its_points() -> None:
    error = refusal(over(lambda x: 0 * x))
    assert error.points_s is not None
    assert error.points_s.shape == (640, 2)


def test_too_uncertain_a_corner_is_refused() -> None:
    profile = draw(Groove(), Noise(sigma=0.05 * MM), 1)
    strict = GrooveSettings(largest_sigma=1e-6)
    assert refusal(profile, strict).reason == "ambiguous"


def test_a_model_without_five_points_is_wrong_use() -> None:
    with pytest.raises(ValueError, match="butt-v"):
        read_groove(draw(Groove(), NOISE), GrooveSettings(model=BUTT_V))


@pytest.mark.parametrize("name", ["noise", "largest_sigma", "largest_rms"])
def test_settings_that_can_not_be_are_refused(name: str) -> None:
    values: dict[str, Any] = {name: 0.0}
    with pytest.raises(ValueError, match="positive"):
        GrooveSettings(**values)
