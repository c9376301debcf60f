"""Where the beads of a layer shall lie, and how its area is shared: descent on the bead model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tjscan.core.frames import Array, Mask
from tjscan.welding.bead import BeadModel, column_widths, lay_beads
from tjscan.welding.state import WeldState
from tjscan.welding.target import WeldTarget

Step = tuple[float, float]

FIRST_STEPS: Final[tuple[Step, ...]] = ((2e-3, 0.15), (1e-3, 0.1), (0.5e-3, 0.05))
"""Rounds of the descent: steps of the aim, metres, and of a bead's part of its layer."""

LATER_STEPS: Final = FIRST_STEPS[1:]
"""The same for a layer whose aims were sought before."""

BELOW_TARGET_WEIGHT: Final = 4.0
"""Metal that is missing counts so many times as metal that is too much."""

SAG_WEIGHT: Final = 25.0
"""The same, in the last layer, for what is missing below the line between the toes."""

STRAY_WEIGHT: Final = 3e-3
"""Cost of an aim's square distance from where the descent began, metres: without it neighbouring
stations find different ways to lay a layer, and what is smoothed between them is none."""

AGREEMENT_STATIONS: Final = 1.0
"""Standard deviation, in stations, of the smoothing after each round."""

ARC_WANDER: Final = 0.5e-3
"""Standard deviation of an arc's place about its wire, metres (assumption)."""

CAP_SPREAD: Final = 1.12
"""The last layer's aims begin so much farther apart than evenly: its beads have to cover the
toes."""

PULL_ASIDE: Final = 0.5
"""Share of gravity that pulls aside in the sections, that of 30°: beyond it, beads are stacked from
the lower side up (assumption)."""

TOE_MARGIN: Final = 20
"""Columns beside the toes that are looked at."""


def planning_columns(state: WeldState) -> WeldState:
    """Every other column of a state, of those between its toes and beside them."""
    first = int(max(state.toes[:, 0].min() - TOE_MARGIN, 0)) // 2 * 2
    kept = slice(first, int(state.toes[:, 1].max() + TOE_MARGIN), 2)
    columns = {name: getattr(state, name)[:, kept] for name in ("u", "base", "w")}
    return replace(state, toes=(state.toes - first) / 2, **columns)


def even_aims(state: WeldState, top: Array, target: WeldTarget, count: int, spread: float) -> Array:
    """Evenly spaced aims across a layer in the order of its beads, shape (count, n), metres.

    In turn from both sides inwards, or, where gravity pulls aside, from the lower side up: each
    bead then rests on the one before.

    Parameters
    ----------
    state : WeldState
    top : ndarray, shape (n, m)
        Of the layer.
    target : WeldTarget
    count : int
        Beads.
    spread : float
        How much farther apart they are.
    """
    open_ = target.between & (top > state.w)
    rows = np.arange(len(state.s))
    first = open_.argmax(axis=1)
    last = open_.shape[1] - 1 - open_[:, ::-1].argmax(axis=1)
    left, right = state.u[rows, first], state.u[rows, last]
    order = sorted(range(count), key=lambda j: (min(j, count - 1 - j), j))
    aside = float(np.median(np.sin(state.tilt)))
    if abs(aside) > PULL_ASIDE:
        order = sorted(range(count), reverse=aside < 0)
    places = [0.5 + spread * ((j + 0.5) / count - 0.5) for j in order]
    return np.array([left + place * (right - left) for place in places])


@dataclass(frozen=True, slots=True, eq=False)
class AimSearch:
    """Coordinate descent on the bead model, at each station by itself.

    Parameters
    ----------
    model : BeadModel
    state : WeldState
        Before the beads, at k stations.
    top : ndarray, shape (k, m)
        Of the layer, metres.
    chord : ndarray, shape (k, m), or None
        Line between the toes, for the last layer.
    area : ndarray, shape (k,)
        Of all the beads, m².
    widths : ndarray, shape (count, k)
        Of each, metres.
    """

    model: BeadModel
    state: WeldState
    top: Array
    chord: Array | None
    area: Array
    widths: Array

    def descend(self, begin: Array, steps: Sequence[Step]) -> tuple[Array, Array]:
        """Aims, and parts of the layer's area, each (count, k).

        Parameters
        ----------
        begin : ndarray, shape (count, k)
            Aims to begin with, metres.
        steps : sequence of (float, float)
            `FIRST_STEPS` or `LATER_STEPS`.
        """
        aims, shares = begin.copy(), np.full_like(begin, 1 / len(begin))
        for step in steps:
            best = self._cost(0, self.state.w, begin, aims, shares)
            for bead in range(len(aims)):
                below, _ = self._lay(range(bead), self.state.w, aims, shares)
                for tried in _variants(aims, shares, bead, step):
                    cost = self._cost(bead, below, begin, *tried)
                    better = cost < best
                    aims, shares = np.where(better, (tried), (aims, shares))
                    best = np.minimum(cost, best)
            aims, shares = gaussian_filter1d(
                (aims, shares), AGREEMENT_STATIONS, axis=2, mode="nearest"
            )
        return aims, shares

    def keep_from_edges(self, begin: Array, aims: Array, shares: Array) -> Array:
        """The aims, that of the next bead moved to where it costs least while the arc wanders.

        The best aim beside a toe may be an arc's wander from where all of the pool runs out of the
        groove.

        Parameters
        ----------
        begin, aims, shares : ndarray, shape (count, k)
            As of `descend`.
        """
        shifts = ARC_WANDER * np.arange(-3, 4)
        moved = (np.concatenate((aims[:1] + shift, aims[1:])) for shift in shifts)
        costs = np.array([self._cost(0, self.state.w, begin, one, shares) for one in moved])
        costs = costs[:-2] + costs[1:-1] + costs[2:]
        nearest = np.argsort(np.abs(shifts[1:-1]), kind="stable")
        best = shifts[1:-1][nearest][np.argmin(costs[nearest], axis=0)]
        best = gaussian_filter1d(best, AGREEMENT_STATIONS, mode="nearest")
        return np.concatenate((aims[:1] + best, aims[1:]))

    def _lay(self, beads: range, w: Array, aims: Array, shares: Array) -> tuple[Array, Mask]:
        """Surfaces after some of the beads, and where a pool of theirs would fall."""
        state = self.state
        falls = np.zeros(len(w), dtype=np.bool_)
        for k in beads:
            area = self.area * shares[k]
            laid = lay_beads(
                self.model, state.u, w, centre=aims[k], width=self.widths[k], area=area,
                tilt=state.tilt,
            )  # fmt: skip
            w = laid.w
            falls |= laid.falls
        return w, falls

    def _cost(self, first: int, w: Array, begin: Array, aims: Array, shares: Array) -> Array:
        """Cost of laying beads from one on, shape (k,), m³; infinite where a pool would fall."""
        w, falls = self._lay(range(first, len(aims)), w, aims, shares)
        off = w - np.maximum(self.top, self.state.w)
        square = off**2 * np.where(off < 0, BELOW_TARGET_WEIGHT, 1.0)
        if self.chord is not None:
            sag = np.minimum(w - np.maximum(self.chord, self.state.w), 0.0)
            square += SAG_WEIGHT * sag**2
        cost = np.einsum("ij,ij->i", column_widths(self.state.u), square)
        cost += STRAY_WEIGHT * np.sum((aims - begin) ** 2, axis=0)
        return np.where(falls, np.inf, cost)


def _variants(aims: Array, shares: Array, bead: int, step: Step) -> list[tuple[Array, Array]]:
    """Aims and shares with those of one bead changed; later beads make up for its share."""
    found = []
    for change in (step[0], -step[0]):
        moved = aims.copy()
        moved[bead] += change
        found.append((moved, shares))
    later = len(aims) - 1 - bead
    for change in (step[1] / len(aims), -step[1] / len(aims)) if later else ():
        parted = shares.copy()
        parted[bead] += change
        parted[bead + 1 :] -= change / later
        found.append((aims, parted))
    return found
