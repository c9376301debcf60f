"""Which beads a weld has, and in which passes it is laid.

No bead is wider than its pool can be. Where a weld is made from several stations, these lay a layer
one after the other, and the border between them lies elsewhere in each layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.plan import plan_weld
from tjscan.planning.stops import UNREACHED_STATION, StationStretch, StopPlacement
from tjscan.planning.template import SectionTemplate
from tjscan.planning.wps import WeldingProcedure
from tjscan.runs.weld.stations import SAME_PLACE
from tjscan.welding.bead import BeadModel
from tjscan.welding.replan import BeadOrder, GroovePart, NextBead, WeldPlanner
from tjscan.welding.shrinkage import ShrinkageModel
from tjscan.welding.target import area_lost_by_closing

WEAVE_WIDTHS: Final = (3e-3, 4e-3)
"""Of the weave of beads below the last layer, and of the last layer, metres (assumption)."""

LEAST_AREA_WINDOW: Final = 1.3
"""Largest over least area of a bead that is always left: sections of a groove differ."""

STRETCH_MARGIN: Final = 10e-3
"""At the ends of what a station looks at no border is placed, metres."""


@dataclass(frozen=True, slots=True)
class WeldPass:
    """A bead, or what one station welds of it.

    Parameters
    ----------
    bead : int
        From 0.
    station : str
        Where the arm stands; empty if there is only one place.
    begin, end : float
        Metres along the groove; beyond its length if it closes and the pass crosses its start.
    """

    bead: int
    station: str
    begin: float
    end: float

    def part_of(self, part: GroovePart, beyond: float) -> GroovePart:
        """The stations of a part that the pass goes over, and those as far beyond, metres."""
        on = (part.s > self.begin - beyond) & (part.s < self.end + beyond)
        return GroovePart(part.rows[on], part.s[on])


def plan_pass(planner: WeldPlanner, one: WeldPass, part: GroovePart) -> NextBead:
    """Plan a pass at the stations that it goes over, of those at which its station looks.

    Beyond its ends the layer is laid by others: what is missing there is not missing here.
    """
    planner.done = one.bead
    return planner.next_bead(one.part_of(part, SAME_PLACE))


def passes_of_weld(
    order: BeadOrder,
    edges: GrooveEdges,
    wps: WeldingProcedure,
    stretches: Sequence[StationStretch],
) -> tuple[WeldPass, ...]:
    """Passes in their order: each station lays all beads of a layer, every second layer in reverse.

    Parameters
    ----------
    order : BeadOrder
    edges : GrooveEdges
    wps : WeldingProcedure
    stretches : sequence of StationStretch
        What each station looks at.

    Raises
    ------
    ConfigurationError
        If a part of the groove is in no station's reach.
    """
    if len(stretches) == 1:
        beads = range(sum(order.counts))
        return tuple(WeldPass(k, stretches[0].station, 0.0, edges.length) for k in beads)
    inner = [
        StationStretch(
            one.station,
            one.begin + STRETCH_MARGIN * (edges.closed or one.begin > 0),
            one.end - STRETCH_MARGIN * (edges.closed or one.end < edges.length),
        )
        for one in stretches
    ]
    sequence = replace(wps.sequence, overlap=0.0, ends="square")
    stops = StopPlacement(edges.length, edges.closed, sequence, np.empty(0), tuple(inner))
    layers = stops.spans([(0.0, edges.length)], 0, len(order.counts))
    found, first = list[WeldPass](), 0
    for layer, (count, spans) in enumerate(zip(order.counts, layers, strict=True)):
        for span in spans[:: -1 if layer % 2 else 1]:
            if span.station == UNREACHED_STATION:
                raise ConfigurationError(
                    f"no station scanned the groove from {1e3 * span.begin:.0f} to "
                    f"{1e3 * span.end:.0f} mm along it, or their scans overlap there by less than "
                    f"{2e3 * STRETCH_MARGIN:.0f} mm: make scan.length_mm longer",
                    key="scan.length_mm",
                )
            beads = range(first, first + count)
            found += (WeldPass(bead, span.station, span.begin, span.end) for bead in beads)
        first += count
    return tuple(found)


def order_beads(
    edges: GrooveEdges,
    corners: Array,
    wps: WeldingProcedure,
    model: BeadModel,
    gravity: Array,
    tilt: Array,
) -> BeadOrder:
    """Beads of the longest zone of a plan; they weave as far as their pools stay narrow enough.

    Parameters
    ----------
    edges : GrooveEdges
    corners : ndarray, shape (n, 4, 2)
        Of its stations, metres.
    wps : WeldingProcedure
    model : BeadModel
    gravity : ndarray, shape (3,)
    tilt : ndarray, shape (n,)
        Of gravity in the stations, as `lay_beads` takes it, radians.

    Raises
    ------
    ConfigurationError
        If nothing that the WPS allows fits.
    """
    widest = model.widest_on_slope(tilt)
    metal = area_that_closing_leaves(corners, wps)
    wps = with_narrower_beads(wps, model, float(widest.min()))
    plan = plan_weld(edges, wps, gravity)
    arrangement = max(plan.zones, key=lambda one: one.end - one.begin).arrangement
    counts, feeds = arrangement.counts, arrangement.feeds
    area = metal[:, None] * arrangement.shares
    width = model.bead_width(wps.heat_input(feeds, wps.deposition_rate(feeds) / area))
    wanted = np.repeat(WEAVE_WIDTHS, (sum(counts[:-1]), counts[-1]))
    spare = np.min(widest[:, None] - width, axis=0)
    weaves = np.clip(spare, 0.0, wanted)
    return BeadOrder(
        counts=tuple(counts),
        feeds=tuple(feeds.tolist()),
        weaves=tuple(weaves.tolist()),
        cap_height=wps.bead.cap_height,
        too_wide=float(max(-spare.min(), 0.0)),
    )


def area_that_closing_leaves(corners: Array, wps: WeldingProcedure) -> Array:
    """Area that is filled at n stations as the groove closes meanwhile, shape (n,), m².

    Parameters
    ----------
    corners : ndarray, shape (n, 4, 2)
        Metres.
    wps : WeldingProcedure
    """
    cap, shrinkage = wps.bead.cap_height, ShrinkageModel()
    area = SectionTemplate(corners, cap).area
    depth = corners[:, 3, 1] - corners[:, :2, 1].min(axis=1)
    by = shrinkage.transverse(area, np.full_like(area, wps.bead.fill_area[0]))
    return area - area_lost_by_closing(depth, by, shrinkage.turn_per_metre, cap)


def with_narrower_beads(wps: WeldingProcedure, model: BeadModel, widest: float) -> WeldingProcedure:
    """The procedure with such areas of fill and cap that pools without weave stay narrow enough.

    Parameters
    ----------
    wps : WeldingProcedure
    model : BeadModel
    widest : float
        Of a pool, metres.
    """
    feed, speed = np.array(wps.arc.wire_feed[1]), np.array(wps.arc.travel_speed[1])
    width = model.bead_width(wps.heat_input(feed, speed))
    # Area and heat input grow alike, and with the square of the width.
    most = float(wps.deposition_rate(feed) / speed * (widest / width) ** 2)
    (fill, high), (cap, cap_high) = wps.bead.fill_area, wps.bead.cap_area
    narrowed = replace(
        wps.bead,
        fill_area=(fill, min(high, max(most, LEAST_AREA_WINDOW * fill))),
        cap_area=(cap, min(cap_high, max(most, LEAST_AREA_WINDOW * cap))),
    )
    return wps.model_copy(update={"bead": narrowed})
