"""Where the links of a chain lie."""

from math import pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.towing.shape.area import Floor
from tjscan.towing.shape.cable import Cable, equally_spaced_links

CABLE = Cable(root=(0.3, -0.2, 0.4))


@given(st.integers(0, 2**32 - 1))
def test_angles_come_back_from_headings_and_every_link_keeps_its_length(seed: int) -> None:
    angles = np.random.default_rng(seed).normal(0, 0.3, CABLE.links)
    poses = CABLE.poses(angles)
    np.testing.assert_allclose(CABLE.angles(poses[:, 2]), angles, atol=1e-12)
    steps = np.diff(CABLE.line(angles), axis=0)
    np.testing.assert_allclose(np.hypot(*steps.T), CABLE.link_length, rtol=1e-12)
    np.testing.assert_allclose(steps[:, 1], 0.1 * np.sin(poses[:, 2]), atol=1e-12)


def test_at_its_limit_every_joint_lies_on_the_tightest_circle() -> None:
    least = 0.1 / (2 * sin(pi / 16))
    cable = Cable(links=16, least_bend_radius=least)
    line = cable.line(np.full(16, cable.joint_limit))[1:]
    np.testing.assert_allclose(np.linalg.norm(line - line.mean(axis=0), axis=1), least, rtol=1e-9)


def test_vehicles_sit_at_equal_distances_and_the_last_at_the_tip() -> None:
    assert equally_spaced_links(60, 6) == (9, 19, 29, 39, 49, 59)
    assert equally_spaced_links(60, 2) == (29, 59)


def test_corners_are_put_counter_clockwise() -> None:
    square = [(0, 0), (0, 1), (1, 1), (1, 0)]
    np.testing.assert_array_equal(Floor(square).outline, square[::-1])
    np.testing.assert_array_equal(Floor(square[::-1]).outline, square[::-1])


def test_a_piece_that_hangs_by_friction_is_as_long_as_its_parabola() -> None:
    cable, pull = Cable(), 20.0
    (chord,) = cable.longest_chords((9,), pull)
    drag = cable.friction / cable.link_length
    x = np.linspace(0.0, chord, 2001)
    hangs = drag / (2 * pull) * x * (chord - x)
    assert np.hypot(np.diff(x), np.diff(hangs)).sum() == pytest.approx(1.0, rel=2e-3)
    assert cable.longest_chords((9,), np.inf) == pytest.approx(1.0)
