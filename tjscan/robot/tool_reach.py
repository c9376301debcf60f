"""Where along a line an arm can hold a tool that may turn about its own axis.

A torch, or any tool that works at a point and along its axis, may be turned about that axis, its
spin, as the arm likes. At every place of the line all spins and all branches of the inverse
kinematics are looked at; what holds the tool there, clear of everything, is a node, and nodes of
neighbouring places are joined if no joint has to jump: the ladder graph of Cartesian planning.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np

from tjscan.core.frames import Array, Mask, inverse_pose, pose, rot_z
from tjscan.robot.kinematics import Kinematics

TOOL_SPINS: Final = 72
"""Of the tool about its axis that are tried, evenly round."""

LARGEST_SPIN_CHANGE: Final = 3
"""By how many of these the spin may change from one place to the next."""

_SPIN_CHANGES: Final = tuple(range(-LARGEST_SPIN_CHANGE, LARGEST_SPIN_CHANGE + 1))

JOINT_JUMP_ANGLE: Final = np.radians(30.0)
"""A joint that turns further from one place to the next is taken to jump."""

OUT_OF_REACH_TEXT: Final = "out of the arm's reach"
NEAR_SINGULARITY_TEXT: Final = "the arm is too near to a singularity"

Hindrance = Callable[[Array], str]
"""What keeps an arm from having these joint angles, shape (6,); empty if nothing does."""


class ToolConfigurations:
    """How an arm can hold a tool along a line, its z axis the one it may turn about.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    T_f_tool : ndarray, shape (4, 4)
        The tool on the flange.
    poses : ndarray, shape (m, n, 4, 4)
        n poses at each of m places that must all be held with the same spin and in the same branch,
        in frame b.
    hindrance : callable
        What keeps the arm from having joint angles.
    singular : float
        Least singular value of the arm's Jacobian, see `Kinematics.smallest_singular_value`. It is
        looked at for the first pose of a place alone, the others being near.
    closed : bool
        Whether the last place is followed by the first.

    Raises
    ------
    ConfigurationError
        If the arm has no closed form of its inverse kinematics.

    Attributes
    ----------
    can : ndarray, shape (m, TRIED_SPINS, 8)
        Whether a spin and a branch of the inverse hold it, clear of everything.
    q : ndarray, shape (m, TRIED_SPINS, 8, 6)
        Joint angles at the first of the poses of each place, from -pi to pi.
    turns : ndarray, shape (m, 2 LARGEST_SPIN_CHANGE + 1, TRIED_SPINS, 8)
        Sum of the joints' squared turns to a node of the following place, from the node that is
        -LARGEST_SPIN_CHANGE, ..., LARGEST_SPIN_CHANGE spins before; infinite if there is no way.
    hindrances : tuple of str
        The most frequent hindrance at each place; empty if the tool can be held there.
    closed : bool
        Whether the last place is followed by the first.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        T_f_tool: Array,
        poses: Array,
        hindrance: Hindrance,
        *,
        singular: float,
        closed: bool,
    ) -> None:
        m, n = poses.shape[:2]
        spun = np.array([pose(rot_z(2 * np.pi * k / TOOL_SPINS)) for k in range(TOOL_SPINS)])
        T_tool_f = inverse_pose(T_f_tool)
        first, can, hindrances = [], np.zeros((m, TOOL_SPINS, 8), dtype=bool), []
        for i in range(m):
            T = poses[i][:, None] @ spun @ T_tool_f
            q = kinematics.inverse_branches(T.reshape(-1, 4, 4)).reshape(n, TOOL_SPINS, 8, 6)
            first.append(q[0])
            beyond = [kinematics.joint_limit_excess(q + 2 * np.pi * turn) for turn in (-1, 0, 1)]
            within = np.isfinite(q) & (np.min(beyond, axis=0) <= 0)
            reasons: Counter[str] = Counter()
            for spin, branch in np.argwhere(within.all(axis=(0, 3))):
                held = q[:, spin, branch]
                if kinematics.smallest_singular_value(held[0]) < singular:
                    reason = NEAR_SINGULARITY_TEXT
                else:
                    reason = next(filter(None, map(hindrance, held)), "")
                can[i, spin, branch] = not reason
                reasons[reason] += 1
            likely = (reason for reason, _ in reasons.most_common())
            hindrances.append("" if can[i].any() else next(likely, OUT_OF_REACH_TEXT))
        self.can, self.q, self.closed = can, np.array(first), closed
        self.turns, self.hindrances = _squared_joint_turns(can, self.q), tuple(hindrances)

    def stretches(self) -> tuple[tuple[int, int], ...]:
        """Longest runs of places along which the tool can be led without a jump.

        Returns
        -------
        tuple of (int, int)
            First and last place, both included, none within another. If the line closes, a last
            place may be beyond the number of places, up to two turns on.
        """
        m, found = len(self.can), list[tuple[int, int]]()
        for first in range(m):
            if not self.can[first].any():
                continue
            last = self._last_place_reached(first, first + 2 * m if self.closed else m - 1)
            if found and found[-1][1] >= last:
                continue
            found.append((first, last))
            if last >= first + m:
                return ((first, last),)
        if self.closed and len(found) > 1:  # the first ones may be part of a later one, a turn on
            found = [one for one in found if one[1] + m > found[-1][1] or one is found[-1]]
        return tuple(found)

    def path(self, first: int, last: int) -> tuple[Array, Array]:
        """The way of the joints from place to place that turns them least.

        Parameters
        ----------
        first, last : int
            Places of one of the `stretches`.

        Returns
        -------
        spins : ndarray, shape (k,)
            Radians, of k places, without jumps.
        q : ndarray, shape (k, 6)
            Joint angles at the first of the poses of each place, without jumps: whole turns are
            left to the caller.
        """
        places = np.arange(first, last + 1) % len(self.can)
        cost, before = np.where(self.can[places[0]], 0.0, np.inf), []
        for place in places[:-1]:
            total = np.stack([np.roll(cost, k, axis=0) for k in _SPIN_CHANGES]) + self.turns[place]
            step = total.argmin(axis=0)
            cost = np.take_along_axis(total, step[None], axis=0)[0]
            before.append(step)
        spin, branch = np.unravel_index(int(np.argmin(cost)), cost.shape)
        chosen = [int(spin)]
        for step in reversed(before):
            chosen.append((chosen[-1] - _SPIN_CHANGES[step[chosen[-1], branch]]) % TOOL_SPINS)
        chosen.reverse()
        spins = np.unwrap(2 * np.pi * np.array(chosen) / TOOL_SPINS)
        return spins, np.unwrap(self.q[places, chosen, branch], axis=0)

    def _last_place_reached(self, first: int, limit: int) -> int:
        joined, alive = np.isfinite(self.turns), self.can[first]
        for place in range(first, limit):
            goes = joined[place % len(self.can)]
            reached = [np.roll(alive, k, axis=0) & goes[i] for i, k in enumerate(_SPIN_CHANGES)]
            alive = np.logical_or.reduce(reached)
            if not alive.any():
                return place
        return limit


def _squared_joint_turns(can: Mask, q: Array) -> Array:
    """Squared turns from place to place, as `ToolConfigurations` has them.

    The last place leads to the first; this is not used if the line does not close.
    """
    found = []
    for a in range(len(can)):
        b = (a + 1) % len(can)
        for k in _SPIN_CHANGES:
            turn = q[b] - np.roll(q[a], k, axis=0)
            turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
            both = np.roll(can[a], k, axis=0) & can[b]
            with np.errstate(invalid="ignore"):
                goes = both & (np.abs(turn).max(axis=2) <= JOINT_JUMP_ANGLE)
            found.append(np.where(goes, np.sum(turn**2, axis=2), np.inf))
    return np.array(found).reshape(len(can), len(_SPIN_CHANGES), TOOL_SPINS, 8)
