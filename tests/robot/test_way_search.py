"""A way round what blocks the direct one, in a joint space of two joints with a wall in it."""

from itertools import pairwise

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.robot.collision_checked import IsClear, find_clear_postures

LIMITS = np.full(2, -2 * np.pi), np.full(2, 2 * np.pi)
START, GOAL = np.array([-1.0, 0.0]), np.array([1.0, 0.0])


def clear_of_wall(half_height: float) -> IsClear:
    """Whether a line keeps clear of a wall of 0.2 rad between start and goal."""

    def is_clear(q: Array, goal: Array) -> bool:
        on_line = np.linspace(q, goal, 200)
        return not np.any((np.abs(on_line[:, 0]) < 0.1) & (np.abs(on_line[:, 1]) < half_height))

    return is_clear


@pytest.mark.parametrize("half_height", [0.3, 1.5, 2.5])
def test_a_way_round_keeps_clear_from_start_to_goal(half_height: float) -> None:
    is_clear = clear_of_wall(half_height)
    way = find_clear_postures(START, GOAL, LIMITS, is_clear)
    assert way is not None
    np.testing.assert_array_equal((way[0], way[-1]), (START, GOAL))
    assert all(is_clear(*line) for line in pairwise(way))
    assert 3 <= len(way) <= 6
    assert all(not is_clear(a, c) for a, c in zip(way, way[2:], strict=False))
    again = find_clear_postures(START, GOAL, LIMITS, is_clear)
    np.testing.assert_array_equal(way, again)


def test_where_nothing_is_in_the_way_it_is_direct() -> None:
    way = find_clear_postures(START, GOAL, LIMITS, lambda q, goal: True)
    np.testing.assert_array_equal(way, [START, GOAL])


def test_where_there_is_no_way_none_is_found() -> None:
    assert find_clear_postures(START, GOAL, LIMITS, clear_of_wall(50.0)) is None
