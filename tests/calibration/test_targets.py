"""A touched plane: found, oriented, as certain as it says, refused where it is none."""

import numpy as np
import pytest
from calibration_stage import AXES, CENTRE, HAND, NOISE, PLACES, PLANE, target
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.calibration.targets.ball import SphereTarget
from tjscan.calibration.targets.plane import PlaneTarget, fit_plane
from tjscan.core.errors import CalibrationRefused

EXACT = 1e-12


def test_three_points_fix_a_plane() -> None:
    found = fit_plane(PLACES[[0, 2, 6]], NOISE.touch, CENTRE + PLANE.u)
    np.testing.assert_allclose(found.plane.u, PLANE.u, atol=EXACT)
    assert found.plane.u0 == pytest.approx(PLANE.u0, abs=EXACT)
    assert found.is_place_known


@pytest.mark.parametrize("side", [1, -1])
def test_the_normal_points_to_the_side_asked_for(side: int) -> None:
    found = fit_plane(PLACES, NOISE.touch, CENTRE + side * PLANE.u)
    np.testing.assert_allclose(found.plane.u, side * PLANE.u, atol=EXACT)


def test_the_plane_is_as_certain_as_it_says() -> None:
    rng = np.random.default_rng(0)
    squares = []
    for _ in range(400):
        found = target(rng)
        # The truth in the terms of what was found.
        height = PLANE.signed_distances(found.centre_b)
        tilts = found.axes_b @ PLANE.u / (found.plane.u @ PLANE.u)
        wrong = np.array((*tilts, height))
        squares.append(wrong @ found.information @ wrong)
        np.testing.assert_allclose(found.boxplus(wrong).u, PLANE.u, atol=EXACT)
        assert found.boxplus(wrong).u0 == pytest.approx(PLANE.u0, abs=EXACT)
    # Chi-square with 3 degrees of freedom; 400 draws give the mean to 0.12; three of those.
    assert np.mean(squares) == pytest.approx(3.0, abs=0.37)


def test_collinear_points_are_refused_with_their_singular_values() -> None:
    rng = np.random.default_rng(0)
    line = CENTRE + np.linspace(-0.1, 0.1, 5)[:, None] * AXES[0]
    with pytest.raises(CalibrationRefused, match=r"singular values are 158\.\d+, 0\.\d+, 0\.\d+"):
        fit_plane(line + NOISE.touch * rng.standard_normal((5, 3)), NOISE.touch)
    with pytest.raises(CalibrationRefused, match="nearly on one line"):
        fit_plane(np.tile(CENTRE, (4, 1)), NOISE.touch)
    with pytest.raises(CalibrationRefused, match="a plane needs three"):
        fit_plane(PLACES[:2], NOISE.touch)


def test_a_bad_touch_is_named() -> None:
    points = HAND.touches(PLACES, np.random.default_rng(0))
    points[4] += 1e-3 * PLANE.u
    with pytest.raises(CalibrationRefused, match="touch number 5 again"):
        fit_plane(points, NOISE.touch)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_an_unknown_plane_keeps_its_start(seed: int) -> None:
    near = np.random.default_rng(seed).standard_normal(3)
    unknown = PlaneTarget.from_unknown_plane(PLANE, near)
    assert not unknown.is_place_known
    assert PLANE.signed_distances(unknown.centre_b) == pytest.approx(0.0, abs=EXACT)
    np.testing.assert_allclose(unknown.axes_b @ PLANE.u, 0, atol=EXACT)
    np.testing.assert_allclose(unknown.boxplus(np.zeros(3)).u, PLANE.u, atol=EXACT)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan])
def test_a_ball_has_a_size(radius: float) -> None:
    with pytest.raises(ValueError, match="positive"):
        SphereTarget(radius)
