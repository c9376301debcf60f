"""The beads of a layer along the groove: path, torch, speed and heat."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.bead import PlannedBead
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.path import (
    CHORD_ERROR,
    LARGEST_KINK,
    LONGEST_STEP,
    GrooveStations,
    aim_points,
    bead_lines,
    chord_error_and_kink,
    stations_at,
    template_at,
    unit_vectors,
)
from tjscan.planning.template import BeadCells
from tjscan.planning.topology import Arrangement
from tjscan.planning.torch import (
    free_angle_middles,
    laying_order,
    position_names,
    slope_and_rotation,
    torch_rotations,
)
from tjscan.planning.wps import WeldingProcedure

STEP_SHRINKAGE: Final = 0.8
"""Factor by which a step that is too long is reduced."""

SHORTEST_STEP: Final = 0.2e-3
"""Metres: no groove bends so sharply that beads need a shorter step."""


def sampling_step(
    edges: GrooveEdges,
    begin: float,
    end: float,
    arrangement: Arrangement,
    wps: WeldingProcedure,
) -> float:
    """Find the step at which all beads keep within the chord error and the kink allowed.

    Parameters
    ----------
    edges : GrooveEdges
        The groove.
    begin, end : float
        Where the beads go, metres.
    arrangement : Arrangement
        Of the beads.
    wps : WeldingProcedure
        For the height of the cap.

    Returns
    -------
    float
        Metres along the groove.

    Raises
    ------
    ConfigurationError
        If the beads bend too sharply for any.
    """
    step = LONGEST_STEP
    while step >= SHORTEST_STEP:
        count = ceil((end - begin) / step)
        stations, cells = cut_groove(
            edges, np.linspace(begin, end, 2 * count + 1), arrangement, wps
        )
        points = stations.to_space(aim_points(cells))
        error, kink = chord_error_and_kink(points[::2], points[1::2])
        if error <= CHORD_ERROR and kink <= LARGEST_KINK:
            return step
        step *= STEP_SHRINKAGE
    raise ConfigurationError(
        f"between s = {1e3 * begin:.0f} and {1e3 * end:.0f} mm the beads would bend by more than "
        f"{np.degrees(LARGEST_KINK):g}° within {1e3 * SHORTEST_STEP:g} mm: corners of the sections "
        "jump there",
        key="sections",
    )


def lay_layer(
    edges: GrooveEdges,
    arrangement: Arrangement,
    layer: int,
    span: tuple[float, float],
    step: float,
    wps: WeldingProcedure,
    gravity: Array,
    stops: Sequence[float] = (),
) -> tuple[PlannedBead, ...]:
    """Lay the beads of one layer, in the order of welding.

    The speed is the deposition rate divided by what is laid down a metre of the tip's way.

    Parameters
    ----------
    edges : GrooveEdges
        The groove.
    arrangement : Arrangement
        Of its beads.
    layer : int
        Number of the layer, from 0.
    span : tuple of float
        From where to where along the groove, metres.
    step : float
        Between two points along the groove, at most; metres.
    wps : WeldingProcedure
        Windows and values.
    gravity : ndarray, shape (3,)
        Unit vector downwards.
    stops : sequence of float
        Lengths within the span that get a point of their own, metres.
    """
    s = np.linspace(*span, max(2, ceil((span[1] - span[0]) / step)) + 1)
    s = np.union1d(s, stops)
    stations, cells = cut_groove(edges, s, arrangement, wps)
    lines = bead_lines(stations, cells)
    middles = free_angle_middles(cells, layer)
    face, outward = (
        stations.vectors_to_space(np.stack((np.sin(angle), np.cos(angle)), axis=2))
        for angle in (middles, middles - wps.torch.work_angle)
    )
    quads = cells.quadrilaterals(layer)
    sides = 0.5 * (quads[:, :, :2] + quads[:, :, :1:-1])
    widths = np.linalg.norm(sides[:, :, 1] - sides[:, :, 0], axis=2)
    sigma = edges.relative_area_sigma(s)
    first = sum(arrangement.counts[:layer])
    found = []
    for place in laying_order(arrangement.counts[layer], layer):
        j = first + place
        kind = arrangement.kinds[j]
        area, travel = lines.areas[:, j], unit_vectors(lines.along[:, j])
        if wps.sequence.reverse:
            travel = -travel
        slope, rotation = slope_and_rotation(face[:, place], travel, gravity)
        speed = wps.deposition_rate(np.array(kind.feed)) / area
        T = np.tile(np.eye(4), (len(s), 1, 1))
        T[:, :3, :3] = torch_rotations(outward[:, place], travel, wps.torch.travel_angle)
        T[:, :3, 3] = lines.aims[:, j]
        way = slice(None, None, -1 if wps.sequence.reverse else 1)
        found.append(
            PlannedBead(
                number=0,
                zone=0,
                layer=layer + 1,
                place=place + 1,
                kind=arrangement.kind_names[j],
                feed=kind.feed,
                power=float(wps.arc.power_at(np.array(kind.feed))),
                s=s[way],
                T_r_torch=T[way],
                speed=speed[way],
                area=area[way],
                heat=wps.heat_input(np.array(kind.feed), speed)[way],
                slope=slope[way],
                rotation=rotation[way],
                positions=position_names(slope, rotation)[way],
                width=widths[way, place],
                relative_sigma=sigma[way],
                open_root=arrangement.root_kind == "open" and arrangement.kind_names[j] == "root",
            )
        )
    return tuple(found)


def cut_groove(
    edges: GrooveEdges, s: Array, arrangement: Arrangement, wps: WeldingProcedure
) -> tuple[GrooveStations, BeadCells]:
    """Cut the groove at lengths, shape (m,) in metres, and its sections into beads."""
    stations = stations_at(edges, s)
    root_area = wps.root.penetration * edges.root_opening(s)
    template = template_at(stations, wps.bead.cap_height, root_area)
    areas = template.area[:, None] * arrangement.shares
    return stations, template.cut_into_beads(arrangement.counts, areas)
