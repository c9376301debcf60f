"""Paths of a given length between two poses: length, ends, bends."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.towing.shape.start import LENGTH_TOLERANCE, meander_headings, one_bend_headings

RADIUS = 0.2
PLACES = st.floats(-3.0, 3.0)
HEADINGS = st.floats(-np.pi, np.pi)


def walked(path: Array, start: Array, pieces: int = 4000) -> Array:
    """Where a path ends: its headings summed up."""
    edges = np.linspace(0.0, path[-1, 0], pieces + 1)
    headings = np.interp((edges[1:] + edges[:-1]) / 2, path[:, 0], path[:, 1])
    step = path[-1, 0] / pieces
    return np.asarray(start[:2] + step * np.array((np.cos(headings).sum(), np.sin(headings).sum())))


@settings(max_examples=4, deadline=None)
@given(PLACES, PLACES, HEADINGS, HEADINGS)
def test_paths_have_the_length_meet_both_poses_and_bend_no_tighter(
    x: float, y: float, begin: float, end: float
) -> None:
    """Each of them, wherever the poses are."""
    start, tip = np.array((0.0, 0.0, begin)), np.array((x, y, end))
    middle = 0.5 * tip[None, :2]
    for path in (
        *one_bend_headings(start, tip, 7.0, RADIUS)[::40],
        *meander_headings(start, tip, 7.0, RADIUS, 2, middle)[::10],
        *meander_headings(start, tip, 7.0, RADIUS, 3, middle)[::10],
    ):
        np.testing.assert_allclose(path[-1, 0], 7.0, rtol=LENGTH_TOLERANCE)
        np.testing.assert_allclose(walked(path, start), tip[:2], atol=1e-4)
        np.testing.assert_allclose(path[0, 1], begin)
        np.testing.assert_allclose(np.cos(path[-1, 1] - end), 1.0)
        assert (np.abs(np.diff(path[:, 1])) <= np.diff(path[:, 0]) / RADIUS + 1e-9).all()


def test_there_are_paths_for_a_cable_that_is_nearly_straight_and_one_that_is_slack() -> None:
    """Nine tenths of the length away, and close by."""
    for x in (6.3, 0.5):
        assert len(one_bend_headings(np.zeros(3), np.array((x, 0.0, 0.0)), 7.0, RADIUS)) > 10


def test_nothing_reaches_farther_than_the_length() -> None:
    """No path at all, and no error."""
    assert len(one_bend_headings(np.zeros(3), np.array((7.1, 0.0, 0.0)), 7.0, RADIUS)) == 0
