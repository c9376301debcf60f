"""Planning the next bead from the last look: what is missing is carried over by its volume."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from tjscan.core.frames import Array, Mask, PlanarPoints, array_dataclass
from tjscan.planning.wps import ArcSettings, RootSettings, WeldingProcedure
from tjscan.welding.aims import (
    CAP_SPREAD,
    FIRST_STEPS,
    LATER_STEPS,
    AimSearch,
    even_aims,
    planning_columns,
)
from tjscan.welding.bead import BeadModel, column_widths, interpolate_rows, lay_beads
from tjscan.welding.learning import ScalarFilter, WeldLearner
from tjscan.welding.look import (
    LEAST_COVER,
    UNSEEN_SIGMA,
    check_look,
    resample_rows,
    see_closing,
)
from tjscan.welding.shrinkage import ShrinkageModel, close_groove
from tjscan.welding.state import Rows, WeldState
from tjscan.welding.target import (
    WeldTarget,
    area_lost_by_closing,
    layer_top,
    remaining_area,
)

LARGEST_AIM_CHANGE: Final = 1e-3
"""By how much a replan within a layer moves an aim, metres: a wrong bead model overshoots."""

LARGEST_BARE_CHANGE: Final = 0.4e-3
"""A bare column that is seen farther than this from where it was has metal on it, metres."""

LEAST_LAYER_SHARE: Final = 0.02
"""A layer that is full already still gets this share of the weld's area: all beads are laid."""

LEAST_CARRIED_SHARE: Final = 0.02
"""Share of the wanted area from which what a limit of the WPS leaves counts."""

PLANNING_STEP: Final = 10e-3
"""Aims are sought at stations so far apart, and bead centres compared there, metres."""

SMOOTHING_LENGTH: Final = 10e-3
"""Standard deviation of the smoothing of aim and area along the groove, metres."""

SENSITIVITY_STEP: Final = 0.5e-3
"""By which a bead is moved to see how far its centre follows, metres."""


LEAST_BEAD_AREA: Final = 1e-6
"""m²: a bead that a look shows with less has no centre."""

ARC_STEP: Final = 0.5e-3
"""Between two places at which the speed of an arc is set, metres: ignition and crater are short."""


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
    open_root : bool
        Whether the first bead is laid over an open root, whose windows then hold.
    too_wide : float
        By how much the widest bead is wider than `BeadModel.widest_on_slope`, on average, metres.
    """

    counts: tuple[int, ...]
    feeds: tuple[float, ...]
    weaves: tuple[float, ...]
    cap_height: float
    open_root: bool = False
    too_wide: float = 0.0

    def layer_of(self, bead: int) -> tuple[int, int]:
        """Layer of a bead (from 0) and how many of the layer's beads come before it."""
        layer = 0
        while bead >= self.counts[layer]:
            bead -= self.counts[layer]
            layer += 1
        return layer, bead


@dataclass(frozen=True, slots=True, eq=False)
class GroovePart:
    """Some of a weld's n stations, one after the other along the groove.

    Parameters
    ----------
    rows : ndarray of int, shape (k,)
        Which.
    s : ndarray, shape (k,)
        Their lengths along the groove, growing, metres: in a groove that closes they go on beyond
        its length.
    """

    rows: NDArray[np.intp]
    s: Array

    @classmethod
    def all_of(cls, s: Array) -> GroovePart:
        """All stations, at their lengths along the groove, shape (n,)."""
        return cls(np.arange(len(s)), s)


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
    aim: PlanarPoints
    tip: PlanarPoints
    wanted: Array
    area: Array
    speed: Array
    feed: Array
    weave: Array
    heat_input: Array
    carried: Array

    def at(self, s: Array) -> NextBead:
        """The same bead at other lengths along the groove; beyond its stations as at the last."""

        def interpolated(values: Array) -> Array:
            rows = [np.interp(s, self.s, row) for row in np.atleast_2d(values.T)]
            return np.stack(rows, axis=-1).reshape(len(s), *values.shape[1:])

        return replace(self._with_arrays(interpolated), s=s)

    def part(self, rows: Rows) -> NextBead:
        """The same bead at some of its stations."""
        return self._with_arrays(lambda values: values[rows])

    def _with_arrays(self, change: Callable[[Array], Array]) -> NextBead:
        """The same bead, each of its arrays changed."""
        names = [one.name for one in fields(NextBead) if one.name not in ("number", "layer")]
        along = {name: change(getattr(self, name)) for name in names}
        return NextBead(self.number, self.layer, **along)

    @property
    def is_at_limit(self) -> Mask:
        """Stations at which a limit of the WPS leaves more than a little to later beads."""
        return np.asarray(np.abs(self.carried) > LEAST_CARRIED_SHARE * np.abs(self.wanted))


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

    Attributes
    ----------
    total : ndarray, shape (n,)
        Area of the whole weld as first planned, m².
    done : int
        Beads that were laid where the next one is planned.
    power_ratio : float
        Of the arc's power to that of the WPS at its wire feed, as the last arc showed it.
    deviation : ScalarFilter or None
        Of the wire from the last bead's aim, to the leg, as the last look shows it, metres.
    """

    belief: WeldState
    order: BeadOrder
    wps: WeldingProcedure
    model: BeadModel = field(default_factory=BeadModel)
    shrinkage: ShrinkageModel = field(default_factory=ShrinkageModel)
    learner: WeldLearner = field(default_factory=WeldLearner)
    total: Array = field(init=False)
    done: int = 0
    power_ratio: float = 1.0
    deviation: ScalarFilter | None = None
    _closing_variance: Array = field(init=False)
    _aims: dict[tuple[int, int], Array] = field(default_factory=dict)
    _laid: tuple[WeldState, NextBead, GroovePart] | None = None
    _seen: WeldState = field(init=False)

    def __post_init__(self) -> None:
        self._seen = self.belief
        self._closing_variance = np.zeros_like(self.belief.s)
        self.total = self.missing_area(self.belief) + self.belief.metal_area

    def begin_at(self, rows: Mask, bare: WeldState) -> None:
        """Take what a first look shows of some of the stations, shape (n,), for the bare groove."""
        bare = bare.part(rows)
        self.belief = self.belief.replaced(rows, bare)
        self._seen = self._seen.replaced(rows, bare)
        self.total = np.where(rows, self.missing_area(self.belief), self.total)

    def missing_area(self, state: WeldState) -> Array:
        """Area that is still to be filled at stations when all has shrunk, shape (k,), m²."""
        cap = self.order.cap_height
        open_area = remaining_area(state, WeldTarget.over(state, cap))
        metal = state.metal_area
        first = np.where(state.first_area > 0, state.first_area, open_area / sum(self.order.counts))
        final = self.learner.shrinkage.value * self.shrinkage.transverse(metal + open_area, first)
        by = np.maximum(final - state.closed, 0.0)
        depth = state.toe_points[:, 0, 1] - state.base.min(axis=1)
        return open_area - area_lost_by_closing(depth, by, self.shrinkage.turn_per_metre, cap)

    def next_bead(self, part: GroovePart | None = None) -> NextBead:
        """Plan the next bead from the belief, on a part of the groove or on all of it."""
        part = part or GroovePart.all_of(self.belief.s)
        state = replace(self.belief.part(part.rows), s=part.s)
        layer, before = self.order.layer_of(self.done)
        share = float(np.cumsum(self.order.counts)[layer] / sum(self.order.counts))
        left = self.order.counts[layer] - before
        total = self.total[part.rows]
        layer_area = self.missing_area(state) - (1 - share) * total
        layer_area = np.maximum(layer_area, LEAST_LAYER_SHARE * total)
        aims, shares = self._seek_aims(
            state, layer_area, share, left, key=(layer, int(part.rows[0]))
        )
        s = state.s
        coarse = s[_planning_rows(s)]
        step = float(np.median(np.diff(s)))
        smooth = [
            gaussian_filter1d(np.interp(s, coarse, row), SMOOTHING_LENGTH / step, mode="nearest")
            for row in (aims[0], shares[0])
        ]
        area = gaussian_filter1d(layer_area * smooth[1], SMOOTHING_LENGTH / step, mode="nearest")
        return self._set_bead(layer, state, smooth[0], area)

    def for_arc(self, bead: NextBead, begin: float, end: float) -> NextBead:
        """The bead as one arc of it is led, which starts and ends at lengths along the groove.

        Ignition adds metal, and in the crater some is missing: speed and feed make up for both as
        far as the WPS lets them.
        """
        s = np.linspace(begin, end, 2 + round((end - begin) / ARC_STEP))
        fine = bead.at(s)
        shape = self.model.area_along_bead(s - begin, end - s)
        limits = self._limits(bead.number)
        speed = np.clip(fine.speed * shape, *self._speed_limits(fine.feed, limits))
        feed = np.clip(fine.feed * speed / (fine.speed * shape), *limits.wire_feed)
        return replace(fine, speed=np.clip(speed, *self._speed_limits(feed, limits)), feed=feed)

    def area_of_arc(self, s: Array, ends: tuple[float, float], feed: Array, speed: Array) -> Array:
        """Area that wire and speed give along an arc, with its ignition and its crater, m².

        Parameters
        ----------
        s, feed, speed : ndarray, shape (k,)
            Along it: metres, m/s and m/s.
        ends : tuple of float
            Where it begins and ends, metres.
        """
        way = np.maximum((s - ends[0], ends[1] - s), 0.0)
        shape = self.model.area_along_bead(*way)
        return np.asarray(shape * self.wps.deposition_rate(feed) / speed)

    def _set_bead(self, layer: int, state: WeldState, aim_u: Array, wanted: Array) -> NextBead:
        """Speed and wire feed of a bead within the WPS."""
        wps, gain = self.wps, self.learner.gain.value
        feed = np.full_like(wanted, self.order.feeds[self.done])
        limits = self._limits(self.done)
        for _ in range(2):  # the feed makes up for what a limit of the speed leaves
            rate = gain * wps.deposition_rate(feed)
            speed = np.clip(rate / wanted, *self._speed_limits(feed, limits))
            feed = np.clip(feed * wanted * speed / rate, *limits.wire_feed)
        speed = np.clip(speed, *self._speed_limits(feed, limits))
        area = gain * wps.deposition_rate(feed) / speed
        (aim_w,) = interpolate_rows(aim_u, state.u, state.w)
        aim = np.column_stack((aim_u, aim_w))
        heat_input = self._heat_input(feed, speed)
        weave = self._held_weave(self.done, heat_input, state.tilt)
        tip = aim.copy()
        tip[:, 0] -= self._lead(state, aim_u, self.model.bead_width(heat_input, weave), area)
        return NextBead(
            self.done,
            layer,
            state.s,
            aim,
            tip,
            wanted,
            area,
            speed,
            feed,
            weave,
            heat_input,
            wanted - area,
        )

    def _lead(self, state: WeldState, aim: Array, width: Array, area: Array) -> Array:
        """How far beside a bead's aim its wire points if it is not led otherwise, (n,), metres."""
        lead = self.learner.lead(*self._pools_aside(state, aim, width, area))
        most = self.learner.offset.value + LARGEST_AIM_CHANGE * np.array((-1.0, 1.0))
        step = float(np.median(np.diff(state.s)))
        smooth = gaussian_filter1d(np.clip(lead, *most), SMOOTHING_LENGTH / step, mode="nearest")
        return np.asarray(smooth)

    def _limits(self, bead: int) -> ArcSettings | RootSettings:
        """Windows of a bead's feed, speed and heat input."""
        return self.wps.limits_of_bead(open_root=self.order.open_root and bead == 0)[1]

    def _speed_limits(self, feed: Array, limits: ArcSettings | RootSettings) -> tuple[Array, Array]:
        """Least and largest travel speed by the windows of speed and heat input, m/s."""
        power = self._heat_input(feed, np.ones_like(feed))
        low = np.maximum(limits.travel_speed[0], power / limits.heat_input[1])
        high = np.minimum(limits.travel_speed[1], power / limits.heat_input[0])
        return low, np.maximum(high, low)

    def _seek_aims(
        self, state: WeldState, layer_area: Array, share: float, left: int, key: tuple[int, int]
    ) -> tuple[Array, Array]:
        """Aims and parts of the layer's area for its remaining beads, each (left, k)."""
        rows = _planning_rows(state.s)
        state, area = planning_columns(state.part(rows)), layer_area[rows]
        target, last = WeldTarget.over(state, self.order.cap_height), share >= 1
        top = layer_top(state, target, share, area)
        chord, widths = target.chord if last else None, self._widths(area, left, state.tilt)
        search = AimSearch(self.model, state, top, chord, area, widths)
        known = self._aims.get(key)
        if known is None:
            begin = even_aims(state, top, target, left, CAP_SPREAD if last else 1.0)
            aims, shares = search.descend(begin, FIRST_STEPS)
            self._aims[key] = aims
            return search.keep_from_edges(begin, aims, shares), shares
        known = known[-left:]  # a weld that was resumed has no aims of the beads before
        aims, shares = search.descend(known, LATER_STEPS)
        aims = np.clip(aims, known - LARGEST_AIM_CHANGE, known + LARGEST_AIM_CHANGE)
        return search.keep_from_edges(known, aims, shares), shares

    def _widths(self, area: Array, left: int, tilt: Array) -> Array:
        """Width of each remaining bead of the layer, shape (left, k), metres."""
        found = []
        for bead in range(self.done, self.done + left):
            feed = np.full_like(area, self.order.feeds[bead])
            speed = np.clip(
                left * self.wps.deposition_rate(feed) / area,
                *self._speed_limits(feed, self._limits(bead)),
            )
            heat = self._heat_input(feed, speed)
            found.append(self.model.bead_width(heat, self._held_weave(bead, heat, tilt)))
        return np.array(found)

    def _held_weave(self, bead: int, heat_input: Array, tilt: Array) -> Array:
        """As wide as its order has it, and less where gravity would not hold the pool, metres."""
        spare = self.model.widest_on_slope(tilt) - self.model.bead_width(heat_input)
        return np.clip(spare, 0.0, self.order.weaves[bead])

    def _heat_input(self, feed: Array, speed: Array) -> Array:
        """Heat input at wire feeds and speeds, J/m: of the WPS's power, and as arcs showed it."""
        return self.power_ratio * self.wps.heat_input(feed, speed)

    def after_bead(
        self,
        bead: NextBead,
        set_area: Array | None = None,
        heat_input: Array | None = None,
        part: GroovePart | None = None,
    ) -> None:
        """Carry the belief on by the bead model.

        Parameters
        ----------
        bead : NextBead
            As it was laid, at k stations.
        set_area : ndarray, shape (k,), optional
            Area that wire and speed of its arcs gave, m², zero where none burned; as planned if
            left out.
        heat_input : ndarray, shape (k,), optional
            As its arcs showed it, J/m; as planned if left out.
        part : GroovePart, optional
            The stations of the bead; all if left out.
        """
        before, part = self.belief, part or GroovePart.all_of(bead.s)
        if set_area is None:
            ends = float(bead.s[0]), float(bead.s[-1])
            set_area = self.area_of_arc(bead.s, ends, bead.feed, bead.speed)
        laid = set_area > 0
        if heat_input is not None and laid.any():
            self.power_ratio *= float(np.median((heat_input / bead.heat_input)[laid]))
            bead = replace(bead, heat_input=heat_input)
        everywhere = np.zeros(len(before.s))
        everywhere[part.rows] = set_area
        self.learner.add_set_area(everywhere)
        rows = part.rows[laid]
        width = self.model.bead_width(bead.heat_input, bead.weave)[laid]
        area = self.learner.gain.value * set_area[laid]
        after = replace(before.part(rows), s=part.s[laid]).lay(
            self.model,
            self.shrinkage,
            centre=bead.aim[laid, 0],
            width=width,
            area=area,
            factor=self.learner.shrinkage.value,
        )
        self.belief = before.replaced(rows, replace(after, s=before.s[rows]))
        step = self.belief.closed - before.closed
        self._closing_variance = self._closing_variance + (self.learner.shrinkage.sigma * step) ** 2
        self._laid = before, bead, part
        self.done += 1

    def take_look(self, u: Array, w: Array, sigma: Array, read: Mask) -> None:
        """Put what a look shows in the belief's place.

        Parameters
        ----------
        u, w : ndarray, shape (n, k)
            Surface seen at the stations, registered to the first scan, u growing; metres.
        sigma : ndarray, shape (n,) or (n, k)
            Standard deviation of its heights, metres; columns that were not seen stay as believed.
        read : ndarray of bool, shape (n,)
            Stations at which it was read; the belief stays elsewhere.

        Raises
        ------
        LookRefused
            If it is of another weld, older than the last bead, or nothing was read.
        """
        predicted = self.belief
        check_look(predicted, self._seen, u, w, read)
        seen_shift, variance = see_closing(predicted, u, w, read)
        gain = self._closing_variance / (self._closing_variance + variance)
        shift = gain * seen_shift
        self._closing_variance = (1 - gain) * self._closing_variance
        turn = self.shrinkage.turn_per_metre * shift
        at, base, before = close_groove(predicted.u, predicted.base, predicted.w, shift, turn)
        seen_w = resample_rows(at, u, w)
        column_sigma = resample_rows(at, u, np.broadcast_to(sigma.T, w.T.shape).T)
        shown = column_sigma < UNSEEN_SIGMA / 2
        row_sigma = np.sqrt(
            np.sum(column_sigma**2, axis=1, where=shown) / np.maximum(shown.sum(axis=1), 1)
        )
        seen_w = np.where(shown, seen_w, before)
        # Bare faces are known from the first scan, better than from this look.
        bare = (before - base <= LEAST_COVER) & (np.abs(seen_w - base) < LARGEST_BARE_CHANGE)
        surface = np.where(read[:, None], np.where(bare, base, seen_w), before)
        seen = replace(predicted, u=at, base=base, w=surface, closed=predicted.closed + shift)
        if self._laid is not None:
            # Of a first bead the look shows the area.
            first = read & (self._laid[0].first_area == 0) & (seen.first_area > 0)
            seen = replace(seen, first_area=np.where(first, seen.metal_area, seen.first_area))
        self.belief, self._seen = seen, self._seen.replaced(read, seen.part(read))
        metal = seen.metal_area
        if metal.any():
            width = float(np.median(np.diff(seen.toe_points[:, :, 0], axis=1)))
            mean_sigma = float(np.sqrt(np.mean(row_sigma[read] ** 2) / max(int(read.sum()), 1)))
            self.learner.learn_gain(metal, read, width * mean_sigma)
            expected = self.shrinkage.transverse(metal, seen.first_area)
            closed = predicted.closed + seen_shift
            self.learner.learn_shrinkage(closed, expected, np.where(read, variance, np.inf))
        self.deviation = None
        if self._laid is not None:
            self._learn_offset(*self._laid, predicted, read)
            self._laid = None

    def _learn_offset(
        self,
        before: WeldState,
        bead: NextBead,
        part: GroovePart,
        predicted: WeldState,
        read: Mask,
    ) -> None:
        """Learn the torch's offset from where the last bead's centre lies."""
        of_bead = np.flatnonzero(read[part.rows])[_planning_rows(bead.s)]
        rows = part.rows[of_bead]
        old, new = before.part(rows), self.belief.part(rows)
        aim = bead.aim[of_bead, 0]
        width = self.model.bead_width(bead.heat_input, bead.weave)[of_bead]

        seen = _bead_centres(old, _added(new, old), aim, width)
        expected = _bead_centres(old, _added(predicted.part(rows), old), aim, width)
        led = aim - bead.tip[of_bead, 0]
        shown = self._pools_aside(old, aim, width, bead.area[of_bead])
        self.deviation = self.learner.learn_offset(seen - expected, led, *shown)

    def _pools_aside(
        self, old: WeldState, aim: Array, width: Array, area: Array
    ) -> tuple[Array, Array]:
        """How the model's beads lie aside of their aims, at k stations.

        Returns
        -------
        sensitivity : ndarray, shape (k,)
            Of a bead's centre to the wire's place.
        runs : ndarray, shape (2, k)
            How far it runs aside for what it lies on, and for gravity, metres.
        """
        level = np.zeros_like(old.tilt)
        tried = (aim, old.tilt), (aim + SENSITIVITY_STEP, old.tilt), (aim, level)
        laid = partial(lay_beads, self.model, old.u, old.w, width=width, area=area)
        beads = [laid(centre=at, tilt=tilt).w - old.w for at, tilt in tried]
        found, moved, upright = (_bead_centres(old, one, aim, width) for one in beads)
        return (moved - found) / SENSITIVITY_STEP, np.stack((upright - aim, found - upright))


def _planning_rows(s: Array) -> slice:
    """Those of evenly spaced stations that lie `PLANNING_STEP` apart, as nearly as can be."""
    return slice(None, None, max(1, round(PLANNING_STEP / float(np.median(np.diff(s))))))


def _bead_centres(old: WeldState, added: Array, aim: Array, width: Array) -> Array:
    """Centres of what a bead added to sections, of height (n, m), metres; NaN where it is none."""
    weights = np.where(np.abs(old.u - aim[:, None]) < width[:, None], added, 0.0)
    weights = weights * column_widths(old.u)
    area, moment = np.sum(weights, axis=1), np.sum(weights * old.u, axis=1)
    seen: Array = np.full_like(area, np.nan)
    np.divide(moment, area, out=seen, where=area > LEAST_BEAD_AREA)
    return seen


def _added(new: WeldState, old: WeldState) -> Array:
    """Height of metal that a state has more than another one, column by column, shape (n, m)."""
    return np.asarray((new.w - new.base) - (old.w - old.base))
