"""Which beads a weld has: as many as its position asks for, none wider than its pool can be."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.plan import plan_weld
from tjscan.planning.template import SectionTemplate
from tjscan.planning.wps import WeldingProcedure
from tjscan.welding.bead import BeadModel
from tjscan.welding.replan import BeadOrder

WEAVE_WIDTHS: Final = (3e-3, 4e-3)
"""Of the weave of beads below the last layer, and of the last layer, metres (assumption)."""

LEAST_AREA_WINDOW: Final = 1.3
"""Largest over least area of a bead that is always left: sections of a groove differ."""


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
    widest = float(model.widest_on_slope(tilt).min())
    wps = with_narrower_beads(wps, model, widest)
    plan = plan_weld(edges, wps, gravity)
    arrangement = max(plan.zones, key=lambda one: one.end - one.begin).arrangement
    counts, feeds = arrangement.counts, arrangement.feeds
    area = arrangement.shares * SectionTemplate(corners, wps.bead.cap_height).area.mean()
    width = model.bead_width(wps.heat_input(feeds, wps.deposition_rate(feeds) / area))
    wanted = np.repeat(WEAVE_WIDTHS, (sum(counts[:-1]), counts[-1]))
    spare = widest - width
    weaves = np.clip(spare, 0.0, wanted)
    return BeadOrder(
        counts=tuple(counts),
        feeds=tuple(feeds.tolist()),
        weaves=tuple(weaves.tolist()),
        cap_height=wps.bead.cap_height,
        too_wide=float(max(-spare.min(), 0.0)),
    )


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
