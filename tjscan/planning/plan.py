"""The plan: zones of constant bead count, their beads in order, and what is out of the WPS."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.bead import PlannedBead
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.findings import WpsFinding, findings_of_bead
from tjscan.planning.lay import lay_layer, sampling_step
from tjscan.planning.path import LONGEST, stations_at, template_at
from tjscan.planning.template import SectionTemplate
from tjscan.planning.topology import Arrangement, arrange_beads
from tjscan.planning.wire_feed import DoesNotFit
from tjscan.planning.wps import WeldingProcedure


@dataclass(frozen=True, slots=True)
class PlannedZone:
    """A length of groove with one arrangement of beads.

    Parameters
    ----------
    begin, end : float
        Lengths along the groove, metres.
    arrangement : Arrangement
        Its layers and beads.
    """

    begin: float
    end: float
    arrangement: Arrangement


@dataclass(frozen=True, slots=True, eq=False)
class WeldPlan:
    """Beads of a groove in the order of welding.

    Parameters
    ----------
    edges : GrooveEdges
        The smoothed groove.
    wps : WeldingProcedure
        What it was planned after.
    gravity : ndarray, shape (3,)
        Unit vector downwards in the frame of the sections.
    zones : tuple of PlannedZone
        One, where one number of beads fits everywhere.
    beads : tuple of PlannedBead
        In the order of welding.
    findings : tuple of WpsFinding
        What is out of the WPS, and where.
    """

    edges: GrooveEdges
    wps: WeldingProcedure
    gravity: Array
    zones: tuple[PlannedZone, ...]
    beads: tuple[PlannedBead, ...]
    findings: tuple[WpsFinding, ...]

    @property
    def arc_time(self) -> float:
        """Seconds with the arc on."""
        return sum(bead.arc_time for bead in self.beads)

    @property
    def volume(self) -> float:
        """Laid down, m³."""
        return sum(bead.volume for bead in self.beads)

    @property
    def wire_mass(self) -> float:
        """Wire that is molten, kg."""
        wire = self.wps.wire
        return self.volume / wire.deposition_efficiency * wire.density

    @property
    def wire_length(self) -> float:
        """Wire that is fed, metres."""
        return sum(bead.arc_time * bead.feed for bead in self.beads)

    @property
    def gas_volume(self) -> float:
        """Shielding gas while the arc is on, m³."""
        return self.arc_time * self.wps.arc.gas_flow


def plan_weld(edges: GrooveEdges, wps: WeldingProcedure, gravity: Array) -> WeldPlan:
    """Plan the beads of a groove.

    Parameters
    ----------
    edges : GrooveEdges
        The smoothed groove.
    wps : WeldingProcedure
        Windows and values.
    gravity : ndarray, shape (3,)
        Downwards in the frame of the sections, of any length above zero.

    Raises
    ------
    ConfigurationError
        If nothing fits at some place, or the groove is too short for its starts.
    """
    size = float(np.linalg.norm(gravity))
    if not np.isfinite(size) or size == 0:
        raise ConfigurationError("must be a direction, not zero", key="--gravity")
    gravity = gravity / size
    zones = _zones(edges, wps)
    beads: list[PlannedBead] = []
    for number, zone in enumerate(zones, start=1):
        step = sampling_step(edges, zone.begin, zone.end, zone.arrangement, wps)
        for layer in range(len(zone.arrangement.counts)):
            span = _span(edges, zones, number - 1, layer, wps)
            laid = lay_layer(edges, zone.arrangement, layer, span, step, wps, gravity)
            first = len(beads) + 1
            beads.extend(bead.numbered(first + i, number) for i, bead in enumerate(laid))
    found = tuple(finding for bead in beads for finding in findings_of_bead(bead, wps))
    return WeldPlan(edges, wps, gravity, zones, tuple(beads), found)


def _zones(edges: GrooveEdges, wps: WeldingProcedure) -> tuple[PlannedZone, ...]:
    """One zone where one arrangement fits all of the groove; else the longest that fit, in turn."""
    s = np.linspace(0.0, edges.length, ceil(edges.length / LONGEST) + 1)
    template = template_at(stations_at(edges, s), wps.bead.cap_height)

    def fit(first: int, last: int) -> Arrangement:
        part = SectionTemplate(template.corners[first : last + 1], template.cap_height)
        return arrange_beads(part, wps)

    found: list[PlannedZone] = []
    first, end = 0, len(s) - 1
    while first < end:
        fits, fails = first, end + 1
        arrangement: Arrangement | None = None
        last = end
        while fails - fits > 1 or arrangement is None:
            try:
                arrangement, fits = fit(first, last), last
            except DoesNotFit as problem:
                if last - first <= 1:
                    where = f"at s = {1e3 * s[first]:.0f} mm"
                    raise problem.as_error(where) from None
                fails = last
            last = max(first + 1, (fits + fails) // 2)
        found.append(PlannedZone(float(s[first]), float(s[fits]), arrangement))
        first = fits
    return tuple(found)


def _span(
    edges: GrooveEdges,
    zones: tuple[PlannedZone, ...],
    number: int,
    layer: int,
    wps: WeldingProcedure,
) -> tuple[float, float]:
    """From where to where along the groove a layer's beads go, metres."""
    zone, spread = zones[number], layer * wps.sequence.start_spread
    if edges.closed and len(zones) == 1:
        return spread % edges.length, spread % edges.length + edges.length + wps.sequence.overlap
    begin, end = zone.begin, zone.end
    cascade = wps.sequence.ends == "cascade"
    if number == 0 and not edges.closed:
        begin += spread * cascade
    if number < len(zones) - 1 or edges.closed:
        end += wps.sequence.overlap
    else:
        end -= spread * cascade
    if end - begin < LONGEST:
        raise ConfigurationError(
            f"layer {layer + 1} would have no length: the groove is too short for it",
            key="sequence.start_spread_mm",
        )
    return begin, min(end, edges.length + wps.sequence.overlap)
