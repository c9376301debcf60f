"""A bead of the plan, and how the beads of a layer are laid: path, torch, speed and heat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import ceil
from typing import Any, Final

import numpy as np

from tjscan.core.bead_segments import BeadSegments
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, array_dataclass, cross, unit_vectors
from tjscan.planning import path
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.stops import StationStretch
from tjscan.planning.template import BeadCells
from tjscan.planning.topology import Arrangement
from tjscan.planning.wps import WeldingProcedure

BEAD_STEP_SHRINKAGE: Final = 0.8
"""Factor by which a step that is too long is reduced."""

SHORTEST_BEAD_STEP: Final = 0.2e-3
"""Metres: no groove bends so sharply that beads need a shorter step."""

POSITION_NAMES: Final = np.array(("PA", "PB", "PC", "PD", "PE"))
"""Principal positions, 45° of rotation from one to the next."""


@array_dataclass
class PlannedBead:
    """A bead, sampled at q points in the order in which it is welded.

    Parameters
    ----------
    layer, place : int
        Layer from the root, and place in it from the bevel; from 1.
    kind : str
        root, fill or cap.
    segments : BeadSegments
        How it is welded along the groove: speed, wire feed, weave, and how far it is from the path
        that was planned first.
    s : ndarray, shape (q,)
        Length along the groove, metres; beyond the groove's own if a bead overlaps its start.
    T_r_torch : ndarray, shape (q, 4, 4)
        Tip of the wire in the frame of the sections: z into the work, x the way it travels.
    area : ndarray, shape (q,)
        Laid down a metre of the tip's path, m².
    heat : ndarray, shape (q,)
        Heat input, J/m.
    slope, rotation : ndarray, shape (q,)
        Radians, see `tjscan.planning.lay.slope_and_rotation`.
    positions : tuple of str
        Welding position at each point.
    width : ndarray, shape (q,)
        In the middle of its height, metres.
    relative_sigma : ndarray, shape (q,)
        Standard deviation of the section's area, and so of speed and fill, as a share of it.
    station : str
        That welds it, or this part of it; empty if no stations are named.
    open_root : bool
        Whether it is the root bead over an opening.
    number, zone : int
        In the order of welding, and of the length of groove with one arrangement, from 1; 0 as
        long as it is in no plan.
    part : int
        Of the bead, from 1: tacks or stations interrupt it, and the arc is off between two parts.
    """

    layer: int
    place: int
    kind: str
    segments: BeadSegments
    s: Array
    T_r_torch: Array
    area: Array
    heat: Array
    slope: Array
    rotation: Array
    positions: tuple[str, ...]
    width: Array
    relative_sigma: Array
    station: str = ""
    open_root: bool = False
    number: int = 0
    zone: int = 0
    part: int = 1

    def cut(self, spans: Sequence[tuple[int, int]]) -> tuple[PlannedBead, ...]:
        """The parts of it from one point to another, both included, in the order of welding."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        sampled: dict[str, Any] = {
            name: value for name, value in values.items() if isinstance(value, np.ndarray | tuple)
        }
        return tuple(
            replace(self, **{name: value[a : b + 1] for name, value in sampled.items()})
            for a, b in spans
        )

    def with_segments(self, segments: BeadSegments, wps: WeldingProcedure) -> PlannedBead:
        """The bead moved, and welded, as another table has it; its area and heat follow from that.

        Parameters
        ----------
        segments : BeadSegments
            With places in the groove's own lengths and stated wire feeds.
        wps : WeldingProcedure
            What wire and arc bring.
        """
        now, before, T = segments.at(self.s), self.at_points, self.T_r_torch.copy()
        T[:, :3, 3] += (now.offset - before.offset)[:, None] * T[:, :3, 1]
        T[:, :3, 3] -= (now.height - before.height)[:, None] * T[:, :3, 2]
        area = wps.deposition_rate(now.feed) / now.speed
        heat = wps.heat_input(now.feed, now.speed)
        return replace(self, segments=segments, T_r_torch=T, area=area, heat=heat)

    def with_start_and_stop(self, wps: WeldingProcedure) -> PlannedBead:
        """The bead with the run-in and the crater of a WPS, if that has any."""
        if wps.start_stop is None:
            return self
        now, along = self.at_points, np.append(0.0, np.cumsum(self.path_steps))
        speed, feed = wps.start_stop.speed_and_feed_shares(along)
        changed = replace(now, speed=now.speed * speed, feed=now.feed * feed)
        return self.with_segments(changed, wps)

    @property
    def at_points(self) -> BeadSegments:
        """Its segments at its points."""
        return self.segments.at(self.s)

    @property
    def speed(self) -> Array:
        """Travel speed of the tip, shape (q,), m/s."""
        return self.at_points.speed

    @property
    def feed(self) -> Array:
        """Wire feed, shape (q,), m/s."""
        return self.at_points.feed

    @property
    def weave(self) -> Array:
        """How far it swings to either side, shape (q,), metres."""
        return self.at_points.weave

    @property
    def begin(self) -> float:
        """Length along the groove at which it starts, metres."""
        return float(self.s[0])

    @property
    def end(self) -> float:
        """Length along the groove at which it ends, metres."""
        return float(self.s[-1])

    @property
    def points(self) -> Array:
        """Where the wire's tip goes, shape (q, 3), metres."""
        return np.asarray(self.T_r_torch[:, :3, 3])

    @property
    def path_steps(self) -> Array:
        """Lengths from point to point, shape (q - 1,), metres."""
        return np.asarray(np.linalg.norm(np.diff(self.points, axis=0), axis=1))

    @property
    def length(self) -> float:
        """Of its path, metres."""
        return float(self.path_steps.sum())

    @property
    def times(self) -> Array:
        """When the tip is at each point, shape (q,), seconds since the bead's start."""
        pace = 1 / self.speed
        return np.append(0.0, np.cumsum(self.path_steps * 0.5 * (pace[1:] + pace[:-1])))

    @property
    def arc_time(self) -> float:
        """Seconds with the arc on."""
        return float(self.times[-1])

    @property
    def wire_length(self) -> float:
        """Wire that is fed, metres."""
        feed = self.feed
        return float(np.sum(np.diff(self.times) * 0.5 * (feed[1:] + feed[:-1])))

    @property
    def volume(self) -> float:
        """Laid down, m³."""
        return float(np.sum(self.path_steps * 0.5 * (self.area[1:] + self.area[:-1])))

    @property
    def fill_sigma(self) -> float:
        """Standard deviation of what it should have laid down, as a share of that.

        Sections are taken to err alike, which is the worst they can do.
        """
        weights = self.area * np.abs(np.gradient(self.s))
        return float(np.sum(weights * self.relative_sigma) / np.sum(weights))


@dataclass(frozen=True, slots=True)
class ArrangedGroove:
    """A groove whose sections are cut into beads by one arrangement.

    Parameters
    ----------
    edges : GrooveEdges
    arrangement : Arrangement
    wps : WeldingProcedure
        Windows and values.
    """

    edges: GrooveEdges
    arrangement: Arrangement
    wps: WeldingProcedure

    def cut(self, s: Array) -> tuple[path.GrooveStations, BeadCells]:
        """Cut the groove at lengths, shape (m,) in metres, and its sections into beads."""
        stations = path.cut_groove_stations(self.edges, s)
        root_area = self.wps.root.penetration * self.edges.root_opening(s)
        template = path.map_template_onto(stations, self.wps.bead.cap_height, root_area)
        areas = template.area[:, None] * self.arrangement.shares
        return stations, template.cut_into_beads(self.arrangement.counts, areas)

    def sampling_step(self, begin: float, end: float) -> float:
        """Find the step at which all beads keep within the chord error and the kink allowed.

        Parameters
        ----------
        begin, end : float
            Where the beads go, metres.

        Returns
        -------
        float
            Metres along the groove.

        Raises
        ------
        ConfigurationError
            If the beads bend too sharply for any.
        """
        step = path.LONGEST_STATION_STEP
        while step >= SHORTEST_BEAD_STEP:
            count = ceil((end - begin) / step)
            stations, cells = self.cut(np.linspace(begin, end, 2 * count + 1))
            points = stations.points_to_space(path.aim_points(cells))
            error, kink = path.chord_error_and_kink(points[::2], points[1::2])
            if error <= path.LARGEST_CHORD_ERROR and kink <= path.LARGEST_KINK:
                return step
            step *= BEAD_STEP_SHRINKAGE
        way = f"between s = {1e3 * begin:.0f} and {1e3 * end:.0f} mm"
        raise ConfigurationError(
            f"{way} the beads would bend by more than {np.degrees(path.LARGEST_KINK):g}° within "
            f"{1e3 * SHORTEST_BEAD_STEP:g} mm: corners of the sections jump there",
            key="sections",
        )

    def lay_layer(
        self, layer: int, span: StationStretch, step: float, gravity: Array, at: Sequence[float]
    ) -> tuple[PlannedBead, ...]:
        """Lay the beads of one layer, in the order of welding.

        The speed is the deposition rate divided by what is laid down a metre of the tip's way.

        Parameters
        ----------
        layer : int
            Number of the layer, from 0.
        span : StationStretch
            Which length of groove, and which station welds it.
        step : float
            Between two points along the groove, at most; metres.
        gravity : ndarray, shape (3,)
            Unit vector downwards.
        at : sequence of float
            Lengths within the span that get a point of their own, metres.
        """
        arrangement, wps = self.arrangement, self.wps
        begin, end = span.begin, span.end
        s = np.linspace(begin, end, max(2, ceil((end - begin) / step)) + 1)
        s = np.union1d(s, at)
        stations, cells = self.cut(s)
        lines = path.BeadLines(stations, cells)
        middles = free_angle_middles(cells, layer)
        face, outward = (
            stations.vectors_to_space(np.stack((np.sin(angle), np.cos(angle)), axis=2))
            for angle in (middles, middles - wps.torch.work_angle)
        )
        quads = cells.quadrilaterals(layer)
        sides = 0.5 * (quads[:, :, :2] + quads[:, :, :1:-1])
        widths = np.linalg.norm(sides[:, :, 1] - sides[:, :, 0], axis=2)
        sigma = self.edges.relative_area_sigma(s)
        first = sum(arrangement.counts[:layer])
        found = []
        for place in laying_order(arrangement.counts[layer], layer):
            j = first + place
            kind, name = arrangement.kinds[j], arrangement.kind_names[j]
            area, travel = lines.areas[:, j], unit_vectors(lines.along[:, j])
            if wps.sequence.reverse:
                travel = -travel
            slope, rotation = slope_and_rotation(face[:, place], travel, gravity)
            positions = position_names(slope, rotation, wps.sequence.slope_limit)
            feed = wps.feed_in_positions(kind.feed, positions)
            speed, off = wps.deposition_rate(feed) / area, np.zeros_like(area)
            weave = off if wps.weave is None else wps.weave.amplitude(widths[:, place])
            T = np.tile(np.eye(4), (len(s), 1, 1))
            T[:, :3, :3] = torch_rotations(outward[:, place], travel, wps.torch.travel_angle)
            T[:, :3, 3] = lines.aims[:, j]
            way = slice(None, None, -1 if wps.sequence.reverse else 1)
            found.append(
                PlannedBead(
                    layer=layer + 1,
                    place=place + 1,
                    kind=name,
                    segments=BeadSegments(s, speed, off, off, weave, feed),
                    s=s[way],
                    T_r_torch=T[way],
                    area=area[way],
                    heat=wps.heat_input(feed, speed)[way],
                    slope=slope[way],
                    rotation=rotation[way],
                    positions=positions[way],
                    width=widths[way, place],
                    relative_sigma=sigma[way],
                    station=span.station,
                    open_root=arrangement.root_kind == "open" and name == "root",
                )
            )
        return tuple(found)


def laying_order(count: int, layer: int) -> tuple[int, ...]:
    """Order in which the beads of a layer are laid, by their places from the bevel.

    From both sides in turn, every other layer from the leg first: the last bead of three or more
    has room on both sides.

    Parameters
    ----------
    count : int
        Beads of the layer.
    layer : int
        Its number, from 0.
    """
    order = [i // 2 if i % 2 == 0 else count - 1 - i // 2 for i in range(count)]
    return tuple(order if layer % 2 == 0 else [count - 1 - j for j in order])


def free_angle_middles(cells: BeadCells, layer: int) -> Array:
    """Directions out of the groove in the middle of each bead's free angle.

    The free angle of a bead opens at the middle of its lower side. Towards the bevel it ends at the
    bevel's top, the brace's wall or the bead beside it that is laid already, towards the leg at the
    leg or such a bead, whichever leaves less.

    Parameters
    ----------
    cells : BeadCells
        Of m sections.
    layer : int
        Its number, from 0.

    Returns
    -------
    ndarray, shape (m, count)
        Angle from the sections' second axis towards their first, radians.
    """
    quads = cells.quadrilaterals(layer)
    order = laying_order(cells.counts[layer], layer)
    _, p4, g, p2 = np.moveaxis(cells.template.corners, 1, 0)
    found = []
    for j in range(cells.counts[layer]):
        aim = 0.5 * (quads[:, j, 0] + quads[:, j, 1])
        bevel = [p2 - aim, p2 - g]
        leg = [g - aim, g - p4]
        if j > 0 and order.index(j - 1) < order.index(j):
            bevel.append(quads[:, j, 3] - aim)
        if j + 1 < cells.counts[layer] and order.index(j + 1) < order.index(j):
            leg.append(quads[:, j, 2] - aim)
        low = np.max([_angle_from_second_axis(v) for v in bevel], axis=0)
        high = np.min([_angle_from_second_axis(v) for v in leg], axis=0)
        found.append(0.5 * (low + high))
    return np.stack(found, axis=1)


def torch_rotations(outward: Array, travel: Array, travel_angle: float) -> Array:
    """Rotations of the torch: z along the wire into the work, x the way it travels.

    Parameters
    ----------
    outward : ndarray, shape (m, 3)
        Unit vectors out of the work; what of them is along the travel does not count.
    travel : ndarray, shape (m, 3)
        Unit vectors along the bead.
    travel_angle : float
        Lean about y, radians; positive: the wire points forward.

    Returns
    -------
    ndarray, shape (m, 3, 3)
    """
    x = travel
    z = unit_vectors(np.sum(outward * travel, axis=1, keepdims=True) * travel - outward)
    c, s = np.cos(travel_angle), np.sin(travel_angle)
    return np.stack((c * x - s * z, cross(z, x), c * z + s * x), axis=2)


def slope_and_rotation(outward: Array, travel: Array, gravity: Array) -> tuple[Array, Array]:
    """Slope and rotation of a weld, as ISO 6947 counts them.

    Parameters
    ----------
    outward, travel : ndarray, shape (m, 3)
        Unit vectors out of the weld's face, and along the weld.
    gravity : ndarray, shape (3,)
        Unit vector downwards.

    Returns
    -------
    tuple of ndarray, shape (m,)
        Slope: of the travel above the horizontal, negative downhill. Rotation: of the face above
        the horizontal, seen along the weld: 90° is a face that looks up, -90° one that looks down.
        Radians.
    """
    slope = np.arcsin(np.clip(-travel @ gravity, -1, 1))
    upright = -gravity + np.sin(slope)[:, None] * -travel
    face = outward - np.sum(outward * travel, axis=1, keepdims=True) * travel
    sines = np.sum(face * upright, axis=1)
    rest = np.linalg.norm(cross(face, upright), axis=1)
    return slope, np.arctan2(sines, rest)


def position_names(slope: Array, rotation: Array, slope_limit: float) -> tuple[str, ...]:
    """Principal position of ISO 6947 for each slope and rotation, shape (m,), radians.

    PF upwards and PG downwards beyond a limit of the slope, which the WPS states; else the nearest
    one by rotation from PA, the face up, by PC, the face sideways, to PE, overhead.
    """
    turned = np.rint((0.5 * np.pi - rotation) / np.radians(45)).astype(int)
    names = POSITION_NAMES[np.clip(turned, 0, len(POSITION_NAMES) - 1)]
    steep = np.where(slope > 0, "PF", "PG")
    return tuple(np.where(np.abs(slope) > slope_limit, steep, names).tolist())


def _angle_from_second_axis(v: Array) -> Array:
    return np.asarray(np.arctan2(v[:, 0], v[:, 1]))
