"""Planning the next bead from the last look: what is missing is carried over by its volume."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.planning.wps import WeldingProcedure
from tjscan.welding.bead import BeadModel, column_widths, interpolate_rows, lay_beads
from tjscan.welding.learning import WeldLearner
from tjscan.welding.shrinkage import ShrinkageModel, close_groove
from tjscan.welding.state import WeldState
from tjscan.welding.target import (
    WeldTarget,
    area_lost_by_closing,
    layer_top,
    remaining_area,
)

AIM_STEPS: Final = (2e-3, 1e-3, 0.5e-3)
"""Steps in which aims are tried, metres; shares of the area are tried beside them."""

AREA_SHARE_STEPS: Final = (0.15, 0.1, 0.05)
"""By how much a bead's part of its layer is tried more or less, beside each step of the aim."""

LARGEST_AIM_CHANGE: Final = 1e-3
"""A replan within a layer moves an aim by no more, metres: with a wrong bead model it overshoots."""

BELOW_TARGET_WEIGHT: Final = 4.0
"""Metal that is missing counts so many times as metal that is too much."""

SAG_WEIGHT: Final = 12.0
"""The same for what is missing below the line between the toes, in the last layer."""

LEAST_COVER: Final = 0.1e-3
"""Columns with less weld metal count as bare in a look, metres."""

LARGEST_BARE_CHANGE: Final = 0.4e-3
"""A bare column that is seen farther than this from where it was has metal on it, metres."""

TOE_MARGIN: Final = 20
"""Columns beside the toes that planning looks at."""

BARE_MARGIN: Final = 4
"""Columns beside the metal that show neither the groove's face nor the bead well."""

POOLING_LENGTH: Final = 10e-3
"""Over which the place of the left side is averaged along the groove, metres."""

REGISTRATION_SIGMA: Final = 0.06e-3
"""Standard deviation of a look's place along the leg against the first scan's, metres."""

FACE_SIGMA: Final = 0.03e-3
"""Standard deviation of the height of a pooled face in a look against the first scan, metres."""

PLANNING_STRIDE: Final = 5
"""Aims are sought at every such station."""

SMOOTHING_LENGTH: Final = 10e-3
"""Speed and aim change over this length along the groove, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BeadOrder:
    """Beads of a weld in their order.

    Parameters
    ----------
    counts : tuple of int
        Beads of each layer, from the root on.
    feeds : tuple of float
        Wire feed of each bead, m/s.
    weaves : tuple of float
        Width of the weave of each bead, metres.
    cap_height : float
        Of the reinforcement, metres.
    """

    counts: tuple[int, ...]
    feeds: tuple[float, ...]
    weaves: tuple[float, ...]
    cap_height: float

    def layer_of(self, bead: int) -> tuple[int, int]:
        """Layer of a bead (from 0) and how many of the layer's beads come before it."""
        layer = 0
        while bead >= self.counts[layer]:
            bead -= self.counts[layer]
            layer += 1
        return layer, bead


@array_dataclass
class NextBead:
    """A bead as it is to be laid at n stations.

    Parameters
    ----------
    number : int
        From 0.
    layer : int
        From 0.
    s : ndarray, shape (n,)
        Lengths along the groove, metres.
    aim : ndarray, shape (n, 2)
        u and w where the wire's tip shall truly be, metres.
    tip : ndarray, shape (n, 2)
        Where the torch's pose has to have it: less its learnt offset.
    wanted, area : ndarray, shape (n,)
        Area that is missing, and that which the WPS allows, m².
    speed, feed, weave, heat_input : ndarray, shape (n,)
        m/s, m/s, metres and J/m.
    carried : ndarray, shape (n,)
        Area that is left to later beads because of a limit, m²; below zero if it is too much.
    """

    number: int
    layer: int
    s: Array
    aim: Array
    tip: Array
    wanted: Array
    area: Array
    speed: Array
    feed: Array
    weave: Array
    heat_input: Array
    carried: Array

    def stretches_at_limit(self, least: float = 0.02) -> tuple[tuple[float, float, float], ...]:
        """From where to where a limit of the WPS acts, and the area carried over there.

        Parameters
        ----------
        least : float
            Share of the wanted area from which it counts.
        """
        at = np.abs(self.carried) > least * np.abs(self.wanted)
        changes = np.flatnonzero(np.diff(np.concatenate(((False,), at, (False,))).astype(int)))
        return tuple(
            (float(self.s[a]), float(self.s[b - 1]), float(self.carried[a:b].mean()))
            for a, b in zip(changes[::2], changes[1::2], strict=True)
        )


@dataclass(slots=True)
class WeldPlanner:
    """Plans one bead after another from a belief, which looks correct.

    Parameters
    ----------
    belief : WeldState
        What the first scan shows.
    order : BeadOrder
    wps : WeldingProcedure
    model : BeadModel
    shrinkage : ShrinkageModel
    learner : WeldLearner
    learns : bool
        Whether what was learnt is used for planning.

    Attributes
    ----------
    total : ndarray, shape (n,)
        Area of the whole weld as first planned, m².
    done : int
        Beads that were laid.
    """

    belief: WeldState
    order: BeadOrder
    wps: WeldingProcedure
    model: BeadModel = field(default_factory=BeadModel)
    shrinkage: ShrinkageModel = field(default_factory=ShrinkageModel)
    learner: WeldLearner = field(default_factory=WeldLearner)
    learns: bool = True
    total: Array = field(init=False)
    done: int = 0
    _closing_variance: Array = field(init=False)
    _aims: dict[int, Array] = field(default_factory=dict)
    _laid: tuple[WeldState, NextBead] | None = None

    def __post_init__(self) -> None:
        self._closing_variance = np.zeros_like(self.belief.s)
        self.total = self.missing_area() + self.belief.metal_area

    @property
    def shrinkage_factor(self) -> float:
        """Shrinkage over the model's, as learnt."""
        return self.learner.shrinkage.value if self.learns else 1.0

    def missing_area(self) -> Array:
        """Area that is still to be filled when all has shrunk, shape (n,), m²."""
        state, cap = self.belief, self.order.cap_height
        open_area = remaining_area(state, WeldTarget.over(state, cap))
        metal = state.metal_area
        first = np.where(state.first_area > 0, state.first_area, open_area / sum(self.order.counts))
        final = self.shrinkage_factor * self.shrinkage.transverse(metal + open_area, first)
        by = np.maximum(final - state.closed, 0.0)
        return open_area - area_lost_by_closing(state, by, self.shrinkage.turn_per_metre, cap)

    def next_bead(self) -> NextBead:
        """Plan the next bead from the belief."""
        layer, before = self.order.layer_of(self.done)
        share = float(np.cumsum(self.order.counts)[layer] / sum(self.order.counts))
        left = self.order.counts[layer] - before
        layer_area = self.missing_area() - (1 - share) * self.total
        layer_area = np.maximum(layer_area, 0.02 * self.total)
        aims, shares = self._seek_aims(layer_area, share, left)
        s = self.belief.s
        coarse = s[::PLANNING_STRIDE]
        step = float(np.median(np.diff(s)))
        smooth = [
            gaussian_filter1d(np.interp(s, coarse, row), SMOOTHING_LENGTH / step, mode="nearest")
            for row in (aims[0], shares[0])
        ]
        area = gaussian_filter1d(layer_area * smooth[1], SMOOTHING_LENGTH / step, mode="nearest")
        return self._set_bead(layer, smooth[0], area)

    def _set_bead(self, layer: int, aim_u: Array, wanted: Array) -> NextBead:
        """Speed and wire feed of a bead within the WPS."""
        wps, gain = self.wps, self.learner.gain.value if self.learns else 1.0
        limits = wps.arc
        feed = np.full_like(wanted, self.order.feeds[self.done])
        speed = np.clip(
            gain * wps.deposition_rate(feed) / wanted, *self._speed_limits(feed, limits)
        )
        feed = np.clip(feed * wanted * speed / (gain * wps.deposition_rate(feed)), *limits.wire_feed)
        speed = np.clip(
            gain * wps.deposition_rate(feed) / wanted, *self._speed_limits(feed, limits)
        )
        area = gain * wps.deposition_rate(feed) / speed
        (aim_w,) = interpolate_rows(aim_u, self.belief.u, self.belief.w)
        aim = np.column_stack((aim_u, aim_w))
        tip = aim - (self.learner.offset.value if self.learns else 0.0, 0.0)
        weave = np.full_like(wanted, self.order.weaves[self.done])
        return NextBead(
            self.done,
            layer,
            self.belief.s,
            aim,
            tip,
            wanted,
            area,
            speed,
            feed,
            weave,
            wps.heat_input(feed, speed),
            wanted - area,
        )

    def _speed_limits(self, feed: Array, limits: object) -> tuple[Array, Array]:
        """Least and largest travel speed by the windows of speed and heat input, m/s."""
        arc = self.wps.arc
        power = arc.thermal_efficiency * arc.power_at(feed)
        low = np.maximum(arc.travel_speed[0], power / arc.heat_input[1])
        high = np.minimum(arc.travel_speed[1], power / arc.heat_input[0])
        return low, np.maximum(high, low)

    def _seek_aims(self, layer_area: Array, share: float, left: int) -> tuple[Array, Array]:
        """Aims and parts of the layer's area for its remaining beads, each (left, k)."""
        rows = slice(None, None, PLANNING_STRIDE)
        state, area = _planning_columns(self.belief.part(rows)), layer_area[rows]
        target = WeldTarget.over(state, self.order.cap_height)
        top = layer_top(state, target, share, area)
        search = _AimSearch(
            self.model, state, top, target.chord if share >= 1 else None, area,
            self._widths(area, left),
        )
        layer, before = self.order.layer_of(self.done)
        known = self._aims.get(layer)
        if known is None:
            aims = _first_aims(state, top, target, left)
            aims, shares = search.descend(aims, np.full_like(aims, 1 / left), AIM_STEPS)
            self._aims[layer] = aims
        else:
            start = known[before:]
            aims, shares = search.descend(start, np.full_like(start, 1 / left), AIM_STEPS[1:])
            aims = np.clip(aims, start - LARGEST_AIM_CHANGE, start + LARGEST_AIM_CHANGE)
        return aims, shares

    def _widths(self, area: Array, left: int) -> Array:
        """Width of each remaining bead of the layer, shape (left, k), metres."""
        found = []
        for bead in range(self.done, self.done + left):
            feed = np.full_like(area, self.order.feeds[bead])
            speed = np.clip(
                left * self.wps.deposition_rate(feed) / area, *self._speed_limits(feed, self.wps.arc)
            )
            heat = self.wps.heat_input(feed, speed)
            found.append(self.model.bead_width(heat, self.order.weaves[bead]))
        return np.array(found)

    def after_bead(self, bead: NextBead, laid: Mask | None = None) -> None:
        """Carry the belief on by the bead model.

        Parameters
        ----------
        bead : NextBead
            As it was laid.
        laid : ndarray of bool, shape (n,), optional
            Stations at which it was laid; everywhere if left out.
        """
        before = self.belief
        gain = self.learner.gain.value if self.learns else 1.0
        ends = self.model.area_along_bead(bead.s - bead.s[0], bead.s[-1] - bead.s)
        self.learner.add_set_area(bead.area * ends / gain * (1.0 if laid is None else laid))
        rows = np.arange(len(bead.s)) if laid is None else np.flatnonzero(laid)
        part = before.part(rows)
        width = self.model.bead_width(bead.heat_input, bead.weave)
        after = part.lay(
            self.model,
            self.shrinkage,
            centre=bead.aim[rows, 0],
            width=width[rows],
            area=(bead.area * ends)[rows],
            factor=self.shrinkage_factor,
        )
        self.belief = before.replaced(rows, after)
        step = self.belief.closed - before.closed
        self._closing_variance = self._closing_variance + (self.learner.shrinkage.sigma * step) ** 2
        self._laid = before, bead
        self.done += 1

    def take_look(self, u: Array, w: Array, sigma: Array, read: Mask) -> None:
        """Put what a look shows in the belief's place.

        Parameters
        ----------
        u, w : ndarray, shape (n, k)
            Surface seen at the stations, registered to the first scan, u growing; metres.
        sigma : ndarray, shape (n,)
            Standard deviation of its heights, metres.
        read : ndarray of bool, shape (n,)
            Stations at which it was read; the belief stays elsewhere.
        """
        predicted = self.belief
        found = see_closing(predicted, u, w, read)
        gain = self._closing_variance / (self._closing_variance + found.variance)
        shift = gain * found.shift
        self._closing_variance = (1 - gain) * self._closing_variance
        turn = self.shrinkage.turn_per_metre * shift
        at, base, before = close_groove(predicted.u, predicted.base, predicted.w, shift, turn)
        seen_w = resample_rows(at, u, w)
        # Bare faces are known from the first scan, better than from this look.
        bare = (before - base <= LEAST_COVER) & (np.abs(seen_w - base) < LARGEST_BARE_CHANGE)
        surface = np.where(read[:, None], np.where(bare, base, seen_w), before)
        seen = replace(predicted, u=at, base=base, w=surface, closed=predicted.closed + shift)
        if self.done == 1:
            seen = replace(seen, first_area=np.where(read, seen.metal_area, seen.first_area))
        self.belief = seen
        if self.done:
            metal = seen.metal_area
            width = float(np.median(np.diff(seen.toe_points[:, :, 0], axis=1)))
            mean_sigma = float(np.sqrt(np.mean(sigma**2) / max(int(read.sum()), 1)))
            self.learner.learn_gain(metal, read, width * mean_sigma)
            expected = self.shrinkage.transverse(metal, seen.first_area)
            closed = predicted.closed + found.shift
            self.learner.learn_shrinkage(closed, expected, np.where(read, found.variance, np.inf))
        if self._laid is not None:
            self._learn_offset(*self._laid, predicted, read)
            self._laid = None

    def _learn_offset(
        self, before: WeldState, bead: NextBead, predicted: WeldState, read: Mask
    ) -> None:
        """Learn the torch's offset from where the last bead's centre lies."""
        rows = np.flatnonzero(read)[::PLANNING_STRIDE]
        old, new = before.part(rows), self.belief.part(rows)
        aim = bead.aim[rows, 0]
        width = self.model.bead_width(bead.heat_input, bead.weave)[rows]

        def centre(w: Array) -> Array:
            added = w - old.w
            weights = np.where(np.abs(old.u - aim[:, None]) < width[:, None], added, 0.0)
            weights *= column_widths(old.u)
            return np.asarray(np.sum(weights * old.u, axis=1) / np.sum(weights, axis=1))

        found = [
            centre(
                lay_beads(
                    self.model, old.u, old.w, centre=aim + step, width=width,
                    area=bead.area[rows], tilt=old.tilt,
                ).w
            )
            for step in (0.0, AIM_STEPS[-1])
        ]
        sensitivity = (found[1] - found[0]) / AIM_STEPS[-1]
        expected = predicted.part(rows)
        beside = centre(old.w + _added(new, old)) - centre(old.w + _added(expected, old))
        spread = float(np.std(beside) / np.sqrt(max(len(rows) / 3, 1)))
        self.learner.learn_offset(beside, sensitivity, spread)


def _added(new: WeldState, old: WeldState) -> Array:
    """Height of metal that a state has more than another one, column by column, shape (n, m)."""
    return np.asarray((new.w - new.base) - (old.w - old.base))


@array_dataclass
class ClosingSeen:
    """How far the left side of a groove is from where it is believed, at n stations.

    Parameters
    ----------
    shift : ndarray, shape (n,)
        To the right, metres.
    variance : ndarray, shape (n,)
        m²; infinite where nothing shows it.
    """

    shift: Array
    variance: Array


def see_closing(belief: WeldState, u: Array, w: Array, read: Mask) -> ClosingSeen:
    """How far the groove closed beyond belief, from the bare faces of its left side.

    Pooled along the groove. A face that runs across the section shows little of it.

    Parameters
    ----------
    belief : WeldState
    u, w : ndarray, shape (n, k)
        Surface seen, registered to the first scan, u growing; metres.
    read : ndarray of bool, shape (n,)
        Stations at which it was read.
    """
    seen = resample_rows(belief.u, u, w)
    covered = belief.w - belief.base > LEAST_COVER
    first = np.where(covered.any(axis=1), covered.argmax(axis=1), 0)
    index = np.arange(belief.u.shape[1])
    face = (index > 1) & (index < (first - BARE_MARGIN)[:, None]) & read[:, None]
    slope = np.gradient(belief.base, axis=1) / np.gradient(belief.u, axis=1)
    weights = np.where(face, column_widths(belief.u), 0.0)
    step = float(np.median(np.diff(belief.s)))
    lever, information, length = (
        gaussian_filter1d(np.einsum("ij,ij->i", weights, row), POOLING_LENGTH / step)
        for row in (slope * (belief.base - seen), slope**2, np.ones_like(slope))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.where(information > 0, lever / information, 0.0)
        variance = REGISTRATION_SIGMA**2 + FACE_SIGMA**2 * length / information
    return ClosingSeen(shift, np.where(information > 0, variance, np.inf))


def resample_rows(at: Array, u: Array, w: Array) -> Array:
    """Rows w over u at other places, shape (n, m); beyond its ends a row's end counts."""
    return np.array([np.interp(x, a, b) for x, a, b in zip(at, u, w, strict=True)])


def _planning_columns(state: WeldState) -> WeldState:
    """Every other column of a state, of those between its toes and beside them."""
    first = int(max(state.toes[:, 0].min() - TOE_MARGIN, 0)) // 2 * 2
    last = int(state.toes[:, 1].max() + TOE_MARGIN)
    kept = slice(first, last, 2)
    return replace(
        state, u=state.u[:, kept], base=state.base[:, kept], w=state.w[:, kept],
        toes=(state.toes - first) / 2,
    )


def _first_aims(state: WeldState, top: Array, target: WeldTarget, count: int) -> Array:
    """Evenly spaced aims across a layer, from the leg to the brace in turn, shape (count, k)."""
    open_ = target.between & (top > state.w)
    rows = np.arange(len(state.s))
    first = open_.argmax(axis=1)
    last = open_.shape[1] - 1 - open_[:, ::-1].argmax(axis=1)
    left, right = state.u[rows, first], state.u[rows, last]
    places = (np.arange(count) + 0.5) / count
    return np.array([left + place * (right - left) for place in places])


@dataclass(slots=True, eq=False)
class _AimSearch:
    """Coordinate descent on the bead model, at each station by itself."""

    model: BeadModel
    state: WeldState
    top: Array
    chord: Array | None
    area: Array
    widths: Array

    def cost(self, first: int, w: Array, aims: Array, shares: Array) -> Array:
        """Cost of laying the beads from one on over surfaces, several variants a station."""
        n = w.shape[0] // len(self.state.s)
        u = np.tile(self.state.u, (n, 1))
        tilt, area = np.tile(self.state.tilt, n), np.tile(self.area, n)
        for k in range(first, len(aims)):
            w = lay_beads(
                self.model,
                u,
                w,
                centre=aims[k],
                width=np.tile(self.widths[k], n),
                area=area * shares[k],
                tilt=tilt,
            ).w
        goal = np.maximum(self.top, self.state.w)
        off = w - np.tile(goal, (n, 1))
        weights = np.tile(column_widths(self.state.u), (n, 1))
        square = off**2 * np.where(off < 0, BELOW_TARGET_WEIGHT, 1.0)
        if self.chord is not None:
            sag = np.minimum(w - np.tile(np.maximum(self.chord, self.state.w), (n, 1)), 0.0)
            square += SAG_WEIGHT * sag**2
        return np.asarray(np.einsum("ij,ij->i", weights, square))

    def descend(
        self, aims: Array, shares: Array, steps: Sequence[float]
    ) -> tuple[Array, Array]:
        """Improve aims and shares, each (count, k), in ever smaller steps."""
        aims, shares = aims.copy(), shares.copy()
        count, k = aims.shape
        best = self.cost(0, self.state.w, aims, shares)
        for step in steps:
            share_step = AREA_SHARE_STEPS[AIM_STEPS.index(step)]
            for bead in range(count):
                w = self.state.w
                for j in range(bead):
                    w = lay_beads(
                        self.model, self.state.u, w, centre=aims[j], width=self.widths[j],
                        area=self.area * shares[j], tilt=self.state.tilt,
                    ).w
                variants = [(step, 0.0), (-step, 0.0)]
                if count > 1:
                    variants += [(0.0, share_step), (0.0, -share_step)]
                tried = [_vary(aims, shares, bead, *variant) for variant in variants]
                costs = self.cost(
                    bead,
                    np.tile(w, (len(tried), 1)),
                    np.concatenate([a for a, _ in tried], axis=1),
                    np.concatenate([b for _, b in tried], axis=1),
                ).reshape(len(tried), k)
                for (a, b), cost in zip(tried, costs, strict=True):
                    better = cost < best
                    aims[:, better], shares[:, better] = a[:, better], b[:, better]
                    best = np.where(better, cost, best)
        return aims, shares


def _vary(
    aims: Array, shares: Array, bead: int, aim_step: float, share_step: float
) -> tuple[Array, Array]:
    """Aims and shares with those of one bead changed; shares of later beads make up for it."""
    aims, shares = aims.copy(), shares.copy()
    aims[bead] += aim_step
    change = share_step / len(aims)
    if change and bead < len(aims) - 1:
        shares[bead] += change
        shares[bead + 1 :] -= change / (len(aims) - 1 - bead)
    return aims, shares
