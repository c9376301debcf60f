"""A plan of a butt joint as passes of a crawl job."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import Final

import numpy as np

from tjscan.core.bead_segments import BeadSegments
from tjscan.core.errors import ConfigurationError
from tjscan.planning.lay import PlannedBead
from tjscan.planning.plan import WeldPlan

SEGMENT_LENGTH: Final = 20e-3
"""Metres along the joint from row to row of a pass, at most: no section is seen more finely."""


@dataclass(frozen=True, slots=True, eq=False)
class CrawlPass:
    """A bead as a crawler welds it.

    Parameters
    ----------
    bead : PlannedBead
        As it is planned.
    table : BeadSegments
        Rows along the joint; offset to the right of its centre, and height over the hull.
    strays : float
        How far the bead's own path is from that, at most, metres.
    misfills : float
        Largest deviation of the area deposited from the area of the bead, as a share of it.
    """

    bead: PlannedBead
    table: BeadSegments
    strays: float
    misfills: float


def crawl_passes_of_plan(plan: WeldPlan) -> tuple[CrawlPass, ...]:
    """Passes for a crawler, one for each bead.

    Parameters
    ----------
    plan : WeldPlan
        Of a butt joint in frame c: x along it, y to the right, z into the hull.

    Raises
    ------
    ConfigurationError
        If the plan asks for what a pass can't do: stops at tacks, zones, or the way back.
    """
    sequence = plan.wps.sequence
    if len({bead.number for bead in plan.beads}) < len(plan.beads):
        raise ConfigurationError(
            'a pass of a crawler does not stop at tack welds: "fuse" them', key="root.tacks"
        )
    if len(plan.zones) > 1:
        raise ConfigurationError(
            f"no number of beads fits all along, and a crawler's passes go from end to end: it "
            f"takes {len(plan.zones)} zones",
            key="bead.fill_area_mm2",
        )
    if sequence.reverse or sequence.ends != "square":
        key = "sequence.reverse" if sequence.reverse else "sequence.ends"
        reason = "a crawler welds every pass from the start of the weld to its end"
        raise ConfigurationError(reason, key=key)
    found = []
    for bead in plan.beads:
        rows = ceil(bead.length / SEGMENT_LENGTH) + 1
        s, (offset, height) = bead.s, bead.points[:, 1:].T * np.array([[1.0], [-1.0]])
        full = replace(bead.at_points, offset=offset, height=height)
        table = full.at(np.linspace(s[0], s[-1], rows))
        now = table.at(s)
        strays = np.hypot(now.offset - offset, now.height - height)
        misfills = np.abs(plan.wps.deposition_rate(now.feed) / now.speed / bead.area - 1)
        found.append(CrawlPass(bead, table, float(strays.max()), float(misfills.max())))
    return tuple(found)
