"""Find a path of an arm through joint space if the direct one is blocked.

RRT-Connect after J. Kuffner and S. LaValle, *RRT-Connect: an efficient approach to single-query
path planning*, ICRA 2000: a tree of clear lines grows from either end, towards postures drawn by
lot, and each towards what the other has just reached.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from tjscan.core.frames import Array, readonly_copy

TREE_STEP: Final = 0.5
"""Radians of joint space, summed in squares over the joints, by which a tree grows at once."""

MOST_RANDOM_POSTURES: Final = 1000
"""Postures that are drawn before it is given up."""

DRAW_MARGIN: Final = np.pi
"""Radians beyond both ends within which a joint's angle is drawn: no way winds an arm up."""

IsClear = Callable[[Array, Array], bool]
"""Whether a straight line in joint space keeps clear, ends included."""


class _PostureTree:
    """Postures that are reached from a root by clear lines."""

    def __init__(self, root: Array) -> None:
        self.postures, self._before = [root], [-1]

    def grow(self, towards: Array, is_clear: IsClear) -> Array | None:
        """Grow a step towards a posture from the nearest one; the posture reached, if any."""
        away = towards - np.array(self.postures)
        nearest = int(np.einsum("ij,ij->i", away, away).argmin())
        length = float(np.linalg.norm(away[nearest]))
        reached = towards
        if length > TREE_STEP:
            reached = self.postures[nearest] + TREE_STEP / length * away[nearest]
        if length == 0 or not is_clear(self.postures[nearest], reached):
            return None
        self.postures.append(reached)
        self._before.append(nearest)
        return reached

    def way_to_root(self) -> list[Array]:
        """From the posture that was reached last back to the root."""
        way, at = [], len(self.postures) - 1
        while at >= 0:
            way.append(self.postures[at])
            at = self._before[at]
        return way


def find_way(
    start: Array, goal: Array, limits: tuple[Array, Array], is_clear: IsClear
) -> list[Array] | None:
    """Find postures between which straight lines in joint space keep clear.

    Parameters
    ----------
    start, goal : ndarray, shape (n,)
        Joint angles, radians.
    limits : (ndarray, ndarray), each of shape (n,)
        Least and greatest of them.
    is_clear : callable
        See `IsClear`.

    Returns
    -------
    list of ndarray of shape (n,), or None
        From start to goal, both included; the same each time. None if `MOST_RANDOM_POSTURES`
        lead to none.
    """
    dice = np.random.default_rng(0)
    least = np.maximum(limits[0], np.minimum(start, goal) - DRAW_MARGIN)
    most = np.minimum(limits[1], np.maximum(start, goal) + DRAW_MARGIN)
    first = _PostureTree(readonly_copy(start))
    one, other = first, _PostureTree(readonly_copy(goal))
    for _ in range(MOST_RANDOM_POSTURES):
        reached = one.grow(dice.uniform(least, most), is_clear)
        if reached is not None and _grow_until_connected(other, reached, is_clear):
            ways = one.way_to_root()[::-1], other.way_to_root()[1:]
            way = [*ways[0], *ways[1]]
            return _shortened_path(way if one is first else way[::-1], is_clear)
        one, other = other, one
    return None


def _grow_until_connected(tree: _PostureTree, to: Array, is_clear: IsClear) -> bool:
    """Grow a tree towards a posture as far as it goes; whether it arrived."""
    while (reached := tree.grow(to, is_clear)) is not None:
        if np.array_equal(reached, to):
            return True
    return False


def _shortened_path(way: list[Array], is_clear: IsClear) -> list[Array]:
    """Leave out postures between which the straight line keeps clear, until none is left to."""
    short = list(way)
    for span in range(len(way) - 1, 1, -1):
        at = 0
        while at + span < len(short):
            if is_clear(short[at], short[at + span]):
                del short[at + 1 : at + span]
            at += 1
    return short
