"""What became of each pass: how far off, how fast, how long, where it stopped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from math import nan
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.crawler.journal import CrawlCycle, SimulatedPlace
from tjscan.crawler.torch_trace import TorchTrace
from tjscan.vehicle.vehicle import AT_REST

PASS_END: Final = 0.1
"""Seconds before a pass ends, from which one that was cut off is whole."""


@dataclass(frozen=True, slots=True, eq=False)
class PassRecord:
    """A pass as it was welded: where the arc burned, and how far off the torch was there.

    Parameters
    ----------
    number : int
        From 1.
    arcs : tuple of (float, float)
        From where to where the arc burned, along the weld, metres; several after a stop.
    seconds : float
        For which it burned and the torch moved: at rest gas flows, it ignites, fills the crater.
    travel, offset, sigma : ndarray, shape (n,)
        While the arc burned: place along the weld, offset of the vehicle from the joint as
        estimated then, and its standard deviation; metres.
    torch_travel, torch_off, torch_sigma : ndarray, shape (k,)
        Places along the weld, how far the torch was to the right of its path there, by a smoother
        over all that was measured until the way back was done, and its standard deviation, metres;
        none if the method can't state it.
    jog : float
        The farthest that a person had the torch beside its path, metres to the right.
    read_share : float
        Share of the profiles, while it burned, in which the joint was read.
    true_travel, true_offset, true_deviation, offset_error : ndarray, shape (m,)
        If a simulation knows the truth, metres: place along the weld, offset of the vehicle
        from the joint, deviation of the torch from its path, and how far the estimated offset
        is to the right of the true one.
    """

    number: int
    arcs: tuple[tuple[float, float], ...]
    seconds: float
    travel: Array
    offset: Array
    sigma: Array
    torch_travel: Array
    torch_off: Array
    torch_sigma: Array
    jog: float
    read_share: float
    true_travel: Array
    true_offset: Array
    true_deviation: Array
    offset_error: Array

    @property
    def length(self) -> float:
        """Metres of weld, an overlap counted once."""
        end, total = -np.inf, 0.0
        for start, stop in sorted(self.arcs):
            total += max(stop - max(start, end), 0.0)
            end = max(end, stop)
        return total

    def is_whole(self, length: float) -> bool:
        """Whether it is as long as asked, metres, but for what is welded in its last `PASS_END`."""
        return self.length >= length - PASS_END * self.speed

    @property
    def speed(self) -> float:
        """Mean speed while the arc burned, m/s."""
        burned = sum(stop - start for start, stop in self.arcs)
        return burned / self.seconds if self.seconds > 0 else 0.0

    @property
    def torch_off_max(self) -> float:
        """Largest distance of the torch from its path, metres; NaN if it is not known."""
        return float(np.abs(self.torch_off).max()) if len(self.torch_off) else nan

    @property
    def stops(self) -> int:
        """How often the arc was cut short and struck again."""
        return len(self.arcs) - 1


def root_mean_square(values: Array) -> float:
    """Root mean square of values, shape (n,); NaN of none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else nan


def pass_records(
    cycles: Iterable[CrawlCycle],
    places: Iterable[tuple[CrawlCycle, SimulatedPlace]] = (),
    traces: Sequence[TorchTrace] = (),
) -> tuple[PassRecord, ...]:
    """Records of every pass in which the arc burned, in the order of their numbers.

    Parameters
    ----------
    cycles : iterable of CrawlCycle
        Of the whole crawl, over all its parts.
    places : iterable of (CrawlCycle, SimulatedPlace), optional
        Where a simulated torch truly was, each with the cycle it belongs to.
    traces : sequence of TorchTrace, optional
        Where the torch was as measured; several of a pass that was cut short.
    """
    burning: dict[int, list[list[CrawlCycle]]] = {}
    before: list[CrawlCycle] = []
    for (arc, number), group in groupby(cycles, key=lambda c: (c.arc, c.number)):
        one = list(group)
        if arc:  # struck where the cycle before ended
            burning.setdefault(number, []).append([before[-1] if before else one[0], *one])
        before = one
    truth: dict[int, list[tuple[float, ...]]] = {}
    for cycle, place in places:
        if cycle.arc:
            along, right = place.torch
            off = right + cycle.torch_y - (cycle.path - cycle.jog)  # what is jogged was wrong
            row = along, right, off, cycle.torch.offset - right
            truth.setdefault(cycle.number, []).append(row)
    traced = {n: [one for one in traces if one.number == n] for n in burning}
    return tuple(_record_pass(n, burning[n], traced[n], truth.get(n, [])) for n in sorted(burning))


def _record_pass(
    number: int,
    arcs: Sequence[Sequence[CrawlCycle]],
    traces: Sequence[TorchTrace],
    truth: Sequence[tuple[float, ...]],
) -> PassRecord:
    """Record of a pass, each of its arcs after the cycle before it was struck."""
    rows = [
        (cycle.travel, cycle.torch.offset, cycle.torch.sigma, cycle.was_read, cycle.jog)
        for arc in arcs
        for cycle in arc[1:]
    ]
    travel, offset, sigma, was_read, jog = np.array(rows, dtype=float).T
    arc_spans = tuple((arc[0].travel, arc[-1].travel) for arc in arcs)
    seconds = sum(
        after.state.time - before.state.time
        for arc in arcs
        for before, after in pairwise(arc)
        if after.commanded != AT_REST
    )
    read_share, known = float(was_read.mean()), np.reshape(truth, (-1, 4)).T
    farthest = float(jog[np.abs(jog).argmax()])
    torch = [
        np.concatenate([np.empty(0), *(getattr(one, name) for one in traces)])
        for name in ("travel", "off", "sigma")
    ]
    estimated = number, arc_spans, seconds, travel, offset, sigma
    return PassRecord(*estimated, torch[0], torch[1], torch[2], farthest, read_share, *known)
