from math import pi

import numpy as np
import pytest

from tjscan.towing.seam import Seam
from tjscan.towing.tables import SeamSettings


def test_a_straight_seam_has_its_own_direction() -> None:
    seam = Seam(SeamSettings(points=((2.6, -4.8), (2.6, 4.8))))
    assert seam.length == pytest.approx(9.6)
    assert seam.seconds == pytest.approx(960)
    np.testing.assert_allclose(seam.pose_at(1.0), (2.6, -3.8, pi / 2))


def test_the_heading_turns_evenly_about_a_corner_and_never_jumps() -> None:
    seam = Seam(SeamSettings(points=((0, 0), (2, 0), (2, 2)), corner=0.3))
    along = np.arange(0, 4, 0.01)
    headings = np.array([seam.pose_at(s)[2] for s in along])
    assert np.abs(np.diff(headings)).max() <= pi / 2 / 0.6 * 0.01 + 1e-9
    assert seam.pose_at(2.0)[2] == pytest.approx(pi / 4)
    assert (headings[0], headings[-1]) == (0.0, pytest.approx(pi / 2))


def test_a_torch_may_keep_its_heading_and_a_welder_may_stand() -> None:
    standing = Seam(SeamSettings(points=((2.8, 1.0),), heading=0.5, seconds=12.0))
    assert (standing.length, standing.seconds) == (0.0, 12.0)
    np.testing.assert_allclose(standing.pose_at(0.0), (2.8, 1.0, 0.5))
