"""A plan of a butt joint as passes of a crawl job: one offset, height and speed each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.planning.lay import PlannedBead
from tjscan.planning.plan import WeldPlan


@dataclass(frozen=True, slots=True, eq=False)
class CrawlPass:
    """A bead as a crawler can weld it: with one path and one speed for a whole pass.

    Parameters
    ----------
    bead : PlannedBead
        As it is planned.
    speed : float
        Along the joint, m/s.
    offset, height : float
        Of the wire's tip, to the right of the joint's centre and over the hull, metres.
    strays : float
        How far the bead's own path is from that, at most, metres.
    misfills : float
        Largest deviation of the area deposited at this speed from the area of the bead, as a
        share of it.
    """

    bead: PlannedBead
    speed: float
    offset: float
    height: float
    strays: float
    misfills: float


def crawl_passes_of_plan(plan: WeldPlan) -> tuple[CrawlPass, ...]:
    """Passes for a crawler, one for each bead; they deposit the same volume.

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
        sides = bead.points[:, 1:] * (1, -1)
        middle = np.trapezoid(sides, bead.s, axis=0) / (bead.s[-1] - bead.s[0])
        area = bead.volume / bead.length
        rate = float(plan.wps.deposition_rate(np.array(bead.feed)))
        offset, height = middle.tolist()
        strays = float(np.linalg.norm(sides - middle, axis=1).max())
        misfills = float(np.abs(area / bead.area - 1).max())
        found.append(CrawlPass(bead, rate / area, offset, height, strays, misfills))
    return tuple(found)
