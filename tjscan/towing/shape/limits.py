"""Hard limits at a shape: how much of each is left, and its derivative by the angles.

Every limit but the joints' own is a distance between a point of the cable and an obstacle, or
another point of the cable. Its derivative follows from where those points are on the chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from math import cos, degrees, hypot, inf, pi, sin
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.towing.shape.area import Obstacles
from tjscan.towing.shape.cable import TowingTeam
from tjscan.towing.shape.chain import place_links
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.distance import distance_to_obstacle
from tjscan.towing.shape.problem import ShapeProblem
from tjscan.towing.tables import LimitSettings


class LimitKind(IntEnum):
    """What a limit holds apart, or slow."""

    LINK_TO_OBSTACLE = 0
    BODY_TO_OBSTACLE = 1
    BODY_TO_BODY = 2
    LINK_TO_BODY = 3
    LINK_TO_LINK = 4
    SPEED = 5
    JOINT = 6
    TAUT = 7
    TURN = 8


LIMIT_NAMES: Final = (
    "link {link} to obstacle",
    "{holder} to obstacle",
    "{holder} to {other_holder}",
    "link {link} to {other_holder}",
    "link {link} to link {other}",
    "speed of {holder}",
    "bend of joint {link}",
    "pull of the cable before {holder}",
    "turn of {holder}",
)
"""In the order of `LimitKind`."""

BROKEN_LIMIT_TEXTS: Final = (
    "link {link} would be {mm} mm too near to {obstacle}: it must keep {link_clearance:.0f} mm "
    "from obstacles",
    "{holder} would be {mm} mm too near to {obstacle}: its body must keep {body_clearance:.0f} mm "
    "from obstacles",
    "{holder} and {other_holder} would be {mm} mm too near: {vehicle_gap:.0f} mm must stay between "
    "their bodies",
    "link {link} would be {mm} mm too near to {other_holder}: {body_clearance:.0f} mm must stay "
    "between them",
    "links {link} and {other} would be {mm} mm too near: the cable must keep {cable_gap:.0f} mm "
    "from itself",
    "{holder} would have to drive {mm} mm further than it can at {top_speed:.3g} m/min",
    "joint {link} would be bent {bend}° past its limit of {joint_limit:.1f}°",
    "the cable before {holder} would be drawn {mm} mm too straight: dragged sideways it would pull "
    "too hard for the vehicles",
    "{holder} would have to turn {bend}° further than it can",
)
"""How a shape breaks a limit, in the same order."""

ROW_TYPE: Final = np.dtype(
    [
        *((name, "f8") for name in ("margin", "grows_x", "grows_y")),
        *(("link", "i8"), ("x", "f8"), ("y", "f8")),
        *(("other", "i8"), ("other_x", "f8"), ("other_y", "f8"), ("kind", "i8"), ("disc", "i8")),
    ]
)
"""A row: margin; direction in which it grows; the link and its point (x, y) that feel it; the same
of the point that feels the opposite, link -1 if none; kind; and which disc is too near, or a
negative number, another for every wall and pillar. Of a joint: its number for the link, and the
sign of its angle's growth for `grows_x`."""

LimitRows = NDArray[np.void]
"""Rows of `ROW_TYPE`, shape (R,)."""

DRAGGED_PULL_SHARE: Final = 0.4
"""Share of a vehicle's force with which the cable on either side of it may pull: both together
leave it a fifth."""

SPARE_MARGIN: Final = 1e-6
"""Metres and radians added to every limit: what a solver may miss it by (`LEAST_KEPT_MARGIN`)."""

LEAST_KEPT_MARGIN: Final = -1e-6
"""A margin above is a limit that is kept."""

JOINT_RADIANS_COUNTED_AS_METRE: Final = 5.0
"""Radians of a joint's margin that count as a metre of distance: a step changes them so."""


SPEED_DIRECTIONS: Final = tuple((cos(k * pi / 4), sin(k * pi / 4)) for k in range(8))
"""In which a vehicle's way from one plan to the next is limited, unit vectors."""

SPEED_POLYGON_SHARE: Final = cos(pi / 8)
"""Distance of the sides of a regular octagon from its middle, over that of its corners."""


class LimitArrays(NamedTuple):
    """All limits of a plan, as compiled functions take them; lengths in metres.

    Parameters
    ----------
    root : ndarray, shape (3,)
    length : float
        Of a link.
    held : ndarray of int, shape (M,)
        Links that vehicles hold; the last is the welder's.
    link_clearance : float
        Of links to obstacles.
    first_link, last_link : int
        Those that it applies to, the last not included.
    first_covered_link : int
        From which on links are below the welder's body; those before keep clear of discs, also
        where they need no clearance from walls and pillars.
    body_clearance : float
        Of vehicles' centres to obstacles and links.
    body_gap : float
        Between vehicles' centres.
    cable_gap : float
        Between links.
    joint_limit : float
        Radians.
    paced : ndarray of int, shape (P,)
        Links with a top speed, which began at `pace_from` and may go `pace` and turn `turn`.
    pace_from : ndarray, shape (P, 3)
        Poses.
    pace, turn : float
        Metres and radians.
    longest : ndarray, shape (M,)
        Distances of vehicles from those before them, and of the first from the root, at most.
    """

    root: Array
    length: float
    held: Indices
    link_clearance: float
    first_link: int
    last_link: int
    first_covered_link: int
    body_clearance: float
    body_gap: float
    cable_gap: float
    joint_limit: float
    paced: Indices
    pace_from: Array
    pace: float
    turn: float
    longest: Array


class RowBuffer(NamedTuple):
    """Room for the rows of limits with a margin below a band.

    Parameters
    ----------
    rows : ndarray of `ROW_TYPE`, shape (R,)
        Filled with as many as fit.
    total : ndarray of int, shape (1,)
        How many there are.
    band : float
        Metres.
    """

    rows: LimitRows
    total: Indices
    band: float


class ChainPoint(NamedTuple):
    """A point that moves with a link; link -1 and no matter where if nothing moves it."""

    link: int
    x: float
    y: float


NO_CHAIN_POINT: Final = ChainPoint(-1, 0.0, 0.0)


@compiled
def link_end(i: int, root: Array, links: Array) -> ChainPoint:
    """Far end of link i; of -1 the root."""
    x, y = (root[0], root[1]) if i < 0 else (links[i, 0], links[i, 1])
    return ChainPoint(i, x, y)


@compiled
def nearest_on_link(i: int, x: float, y: float, root: Array, links: Array) -> ChainPoint:
    """Point of link i nearest to (x, y)."""
    a = link_end(i - 1, root, links)
    ex, ey = links[i, 0] - a.x, links[i, 1] - a.y
    t = min(max(((x - a.x) * ex + (y - a.y) * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    return ChainPoint(i, a.x + t * ex, a.y + t * ey)


@compiled
def add_row(
    room: RowBuffer,
    kind: int,
    margin: float,
    x: float,
    y: float,
    at: ChainPoint,
    other: ChainPoint = NO_CHAIN_POINT,
    disc: int = -1,
) -> None:
    """Write a row whose margin grows along (x, y), if it fits."""
    if room.total[0] < len(room.rows):
        row = room.rows[room.total[0]]
        row.kind, row.margin, row.grows_x, row.grows_y = kind, margin, x, y
        row.link, row.x, row.y = at.link, at.x, at.y
        row.other, row.other_x, row.other_y, row.disc = other.link, other.x, other.y, disc
    room.total[0] += 1


@compiled
def add_distance_row(
    room: RowBuffer, kind: int, apart: float, at: ChainPoint, other: ChainPoint, disc: int = -1
) -> None:
    """A row for two points that must be `apart`, if the margin is less than the band."""
    x, y = at.x - other.x, at.y - other.y
    d = hypot(x, y)
    if d - apart < room.band:
        d = max(d, 1e-9)
        add_row(room, kind, d - apart, x / d, y / d, at, other, disc)


@compiled
def add_obstacle_rows(
    room: RowBuffer, kind: int, apart: float, at: ChainPoint, obstacles: Obstacles, of_all: bool
) -> None:
    """Rows for a point that must be `apart` from all obstacles, or from discs alone."""
    walls, corners, starts, discs = obstacles
    solids = len(walls) + len(starts) - 1
    for k in range(0 if of_all else solids, solids + len(discs)):
        d, gx, gy, _, _, _ = distance_to_obstacle(k, at.x, at.y, walls, corners, starts, discs)
        if d - apart < room.band:
            add_row(room, kind, d - apart, gx, gy, at, NO_CHAIN_POINT, k - solids)


@compiled
def do_segments_cross(a: Array, b: Array, c: Array, d: Array) -> bool:
    """Whether the lines from a to b and from c to d cross, all of shape (2,)."""
    ux, uy, vx, vy = b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]
    c_side = ux * (c[1] - a[1]) - uy * (c[0] - a[0])
    d_side = ux * (d[1] - a[1]) - uy * (d[0] - a[0])
    a_side = vx * (a[1] - c[1]) - vy * (a[0] - c[0])
    b_side = vx * (b[1] - c[1]) - vy * (b[0] - c[0])
    return bool(c_side * d_side < 0.0 and a_side * b_side < 0.0)


@compiled
def add_crossed_edge_rows(
    room: RowBuffer, apart: float, i: int, root: Array, links: Array, corners: Array, disc: int
) -> None:
    """Rows for a link that crosses edges of a polygon thinner than the link is long."""
    before = root[:2] if i == 0 else links[i - 1, :2]
    for k in range(len(corners)):
        a, b = corners[k - 1], corners[k]
        if do_segments_cross(before, links[i, :2], a, b):
            nx, ny = b[1] - a[1], a[0] - b[0]
            length = hypot(nx, ny)
            nx, ny = nx / length, ny / length
            ahead = nx * (links[i, 0] - a[0]) + ny * (links[i, 1] - a[1])
            behind = nx * (before[0] - a[0]) + ny * (before[1] - a[1])
            is_ahead = abs(ahead) < abs(behind)
            side = ahead if is_ahead else behind
            end = link_end(i if is_ahead else i - 1, root, links)
            sign = -1.0 if side > 0.0 else 1.0
            x, y, margin = sign * nx, sign * ny, -abs(side) - apart
            add_row(room, LimitKind.LINK_TO_OBSTACLE, margin, x, y, end, NO_CHAIN_POINT, disc)


@compiled
def add_link_obstacle_rows(
    room: RowBuffer, links: Array, limits: LimitArrays, obstacles: Obstacles
) -> None:
    """Rows of links: their ends, their nearest points to corners and discs, edges they cross."""
    kind, apart = LimitKind.LINK_TO_OBSTACLE, limits.link_clearance
    root, length = limits.root, limits.length
    _, corners, starts, discs = obstacles
    reach = 3.0 * (length + apart + room.band)
    for i in range(max(limits.last_link, limits.first_covered_link)):
        end, of_all = link_end(i, root, links), limits.first_link <= i < limits.last_link
        add_obstacle_rows(room, kind, apart, end, obstacles, of_all)
        for p in range(len(starts) - 1 if of_all else 0):
            polygon, disc = corners[starts[p] : starts[p + 1]], p + 1 - len(starts)
            for corner in polygon:
                place = ChainPoint(-1, corner[0], corner[1])
                if abs(end.x - place.x) + abs(end.y - place.y) < reach:
                    at = nearest_on_link(i, place.x, place.y, root, links)
                    if 0.0 < hypot(at.x - end.x, at.y - end.y) < length:
                        add_distance_row(room, kind, apart, at, place, disc)
            add_crossed_edge_rows(room, apart, i, root, links, polygon, disc)
        for k in range(2 * len(discs)):
            disc, column = discs[k // 2], 2 * (k % 2)
            place = ChainPoint(-1, disc[column], disc[column + 1])
            at = nearest_on_link(i, place.x, place.y, root, links)
            if 0.0 < hypot(at.x - end.x, at.y - end.y) < length:
                add_distance_row(room, kind, apart + disc[4], at, place, k // 2)


@compiled
def add_link_body_rows(room: RowBuffer, i: int, links: Array, limits: LimitArrays) -> None:
    """Rows of all links but the next ones to the vehicle that holds link i."""
    root, length, apart = limits.root, limits.length, limits.body_clearance
    centre = link_end(i, root, links)
    next_to_body, reach = pi / 2 * apart, 3.0 * (length + apart + room.band)
    for j in range(len(links)):
        # Cable between may lie on a half circle of that width.
        between = (i - j) * length if j <= i else (j - 1 - i) * length
        near = abs(centre.x - links[j, 0]) + abs(centre.y - links[j, 1]) < reach
        if near and not between < next_to_body:
            at = nearest_on_link(j, centre.x, centre.y, root, links)
            add_distance_row(room, LimitKind.LINK_TO_BODY, apart, at, centre)


@compiled
def add_link_link_rows(
    room: RowBuffer, apart: float, i: int, j: int, root: Array, links: Array
) -> None:
    """Rows for two links: each end of one against the other; if they cross, the way back."""
    kind = LimitKind.LINK_TO_LINK
    before_i, before_j = root[:2] if i == 0 else links[i - 1, :2], links[j - 1, :2]
    crossed = do_segments_cross(before_i, links[i, :2], before_j, links[j, :2])
    least, nearest, nearest_end = 1e300, NO_CHAIN_POINT, NO_CHAIN_POINT
    for a, b in ((i, j), (j, i)):
        for end in (link_end(a - 1, root, links), link_end(a, root, links)):
            at = nearest_on_link(b, end.x, end.y, root, links)
            if not crossed:
                add_distance_row(room, kind, apart, end, at)
            elif hypot(end.x - at.x, end.y - at.y) < least:
                least, nearest, nearest_end = hypot(end.x - at.x, end.y - at.y), at, end
    if crossed:
        d = max(least, 1e-9)
        x, y = (nearest.x - nearest_end.x) / d, (nearest.y - nearest_end.y) / d
        add_row(room, kind, -least - apart, x, y, nearest_end, nearest)


@compiled
def add_cable_self_rows(room: RowBuffer, links: Array, limits: LimitArrays) -> None:
    """Rows of links that are near each other, but for the next ones."""
    n, root, length, apart = len(links), limits.root, limits.length, limits.cable_gap
    skip = 1 + int(np.ceil(pi / 2 * apart / length))
    reach = 2.0 * length + apart + room.band
    for i in range(n):
        j = i + skip + 1
        while j < n:
            d = hypot(links[i, 0] - links[j, 0], links[i, 1] - links[j, 1])
            if d < reach:
                add_link_link_rows(room, apart, i, j, root, links)
            # Links further on can't be nearer than what the cable between allows.
            j += max(1, int((d - reach) / length))


@compiled
def add_speed_rows(room: RowBuffer, links: Array, limits: LimitArrays) -> None:
    """Rows of vehicles in `SPEED_DIRECTIONS`.

    The polygon is within the circle that a vehicle reaches. A single row along its way would leave
    it free across, and in any direction while it has none.
    """
    for p in range(len(limits.paced)):
        at = link_end(limits.paced[p], limits.root, links)
        x, y = at.x - limits.pace_from[p, 0], at.y - limits.pace_from[p, 1]
        for ux, uy in SPEED_DIRECTIONS:
            margin = SPEED_POLYGON_SHARE * limits.pace - ux * x - uy * y
            if margin < room.band:
                add_row(room, LimitKind.SPEED, margin, -ux, -uy, at)


@compiled
def add_turn_rows(room: RowBuffer, links: Array, limits: LimitArrays) -> None:
    """Rows of vehicles that turn nearly as far as they can; margins in radians.

    A heading is held as two points of its link, one metre apart, that move past each other.
    """
    for p in range(len(limits.paced)):
        link = limits.paced[p]
        turned = links[link, 2] - limits.pace_from[p, 2]
        turned -= 2 * pi * round(turned / (2 * pi))
        margin, sign = limits.turn - abs(turned), -1.0 if turned > 0 else 1.0
        if margin < room.band:
            ahead, behind = ChainPoint(link, 1.0, 0.0), ChainPoint(link, 0.0, 0.0)
            add_row(room, LimitKind.TURN, margin, 0.0, sign, ahead, behind)


@compiled
def add_joint_rows(room: RowBuffer, angles: Array, most: float) -> None:
    """Rows of joints that are bent nearly as far as the cable may be, `most` radians."""
    for i in range(len(angles)):
        margin = most - abs(angles[i])
        if margin < JOINT_RADIANS_COUNTED_AS_METRE * room.band:
            sign, joint = -1.0 if angles[i] > 0 else 1.0, ChainPoint(i, 0.0, 0.0)
            add_row(room, LimitKind.JOINT, margin, sign, 0.0, joint)


@compiled
def add_taut_rows(room: RowBuffer, links: Array, limits: LimitArrays) -> None:
    """Rows of vehicles that would draw the cable between them straight."""
    for m in range(len(limits.held)):
        at = link_end(limits.held[m], limits.root, links)
        other = link_end(limits.held[m - 1] if m else -1, limits.root, links)
        x, y = other.x - at.x, other.y - at.y
        d = max(hypot(x, y), 1e-9)
        if limits.longest[m] - d < room.band:
            add_row(room, LimitKind.TAUT, limits.longest[m] - d, x / d, y / d, at, other)


@compiled
def fill_limit_rows(
    room: RowBuffer, angles: Array, links: Array, limits: LimitArrays, obstacles: Obstacles
) -> None:
    """Fill the rows of all limits.

    Parameters
    ----------
    room : RowBuffer
    angles : ndarray, shape (N,)
    links : ndarray, shape (N, 5)
        As `place_links` fills it.
    limits : LimitArrays
    obstacles : Obstacles
    """
    held, root = limits.held, limits.root
    add_link_obstacle_rows(room, links, limits, obstacles)
    for m in range(len(held)):
        at = link_end(held[m], root, links)
        if m < len(held) - 1:
            kind = LimitKind.BODY_TO_OBSTACLE
            add_obstacle_rows(room, kind, limits.body_clearance, at, obstacles, True)
        for o in range(m):
            other = link_end(held[o], root, links)
            add_distance_row(room, LimitKind.BODY_TO_BODY, limits.body_gap, at, other)
        add_link_body_rows(room, held[m], links, limits)
    add_cable_self_rows(room, links, limits)
    add_speed_rows(room, links, limits)
    add_joint_rows(room, angles, limits.joint_limit)
    add_taut_rows(room, links, limits)
    add_turn_rows(room, links, limits)


@compiled
def _fill_limit_rows_of_tuples(
    rows: LimitRows, band: float, angles: Array, links: Array, limits: Any, obstacles: Any
) -> int:
    """Fill rows of the limits of plain tuples; returns how many there are, even if not all fit."""
    room = RowBuffer(rows, np.zeros(1, np.int64), band)
    fill_limit_rows(room, angles, links, LimitArrays(*limits), Obstacles(*obstacles))
    return int(room.total[0])


@compiled
def limit_gradients(rows: LimitRows, root: Array, links: Array, gradients: Array) -> None:
    """Derivatives by the angles, shape (R, N): a point turns about the joints before it."""
    for r in range(len(rows)):
        row = rows[r]
        if row.kind == LimitKind.JOINT:
            gradients[r, :] = 0.0
            gradients[r, row.link] = row.grows_x
            continue
        for k in range(len(links)):
            joint = link_end(k - 1, root, links)
            total = 0.0
            if k <= row.link:
                total += row.grows_y * (row.x - joint.x) - row.grows_x * (row.y - joint.y)
            if k <= row.other:
                total -= row.grows_y * (row.other_x - joint.x) - row.grows_x * (
                    row.other_y - joint.y
                )
            gradients[r, k] = total


@compiled
def add_margin_changes(
    rows: LimitRows, step: Array, root: Array, links: Array, margins: Array
) -> None:
    """Margins after a step of the angles, to first order, shape (R,), filled; in O(N + R)."""
    sums, turn, x, y = np.empty((len(step), 3)), 0.0, 0.0, 0.0
    for k in range(len(step)):  # of the turns, and of the turns by the places of their joints
        joint = link_end(k - 1, root, links)
        turn += step[k]
        x += step[k] * joint.x
        y += step[k] * joint.y
        sums[k, 0], sums[k, 1], sums[k, 2] = turn, x, y
    for r in range(len(rows)):
        row = rows[r]
        change = 0.0
        if row.kind == LimitKind.JOINT:
            change = row.grows_x * step[row.link]
        elif row.link >= 0:
            at = sums[row.link]
            change += row.grows_y * (at[0] * row.x - at[1]) - row.grows_x * (at[0] * row.y - at[2])
        if row.kind != LimitKind.JOINT and row.other >= 0:
            at = sums[row.other]
            change -= row.grows_y * (at[0] * row.other_x - at[1])
            change += row.grows_x * (at[0] * row.other_y - at[2])
        margins[r] = row.margin + change


def worst_margin(rows: LimitRows) -> float:
    """Of the limit that is broken worst; 0 if none is."""
    return float(rows["margin"].min(initial=0.0))


def format_figure(figure: float) -> str:
    """A figure as a message states it: what is below ten is not rounded to nothing."""
    return f"{figure:.0f}" if figure >= 10 else f"{figure:.2g}"


@dataclass(frozen=True, eq=False)
class LimitedProblem:
    """The problem of one period, and all that its plan must keep.

    Parameters
    ----------
    problem : ShapeProblem
        What is planned: the cable, the obstacles, and the vehicles that drive.
    team : TowingTeam
    limits : LimitSettings
    disc_names : tuple of str
        Of the obstacles that are discs, for messages.
    """

    problem: ShapeProblem
    team: TowingTeam
    limits: LimitSettings
    disc_names: tuple[str, ...] = ()

    @cached_property
    def arrays(self) -> LimitArrays:
        """The same, as compiled functions take it."""
        problem, limits, body = self.problem, self.limits, self.team.body_radius
        cable, body_clearance = problem.cable, body + limits.vehicle_clearance
        return LimitArrays(
            root=np.array(cable.root, dtype=float),
            length=cable.link_length,
            held=np.array(self.team.held_links),
            link_clearance=limits.link_clearance + SPARE_MARGIN,
            first_link=limits.free_links,
            last_link=cable.links - limits.free_links,
            first_covered_link=cable.links - int(body / cable.link_length),
            body_clearance=body_clearance + SPARE_MARGIN,
            body_gap=2 * body + limits.vehicle_gap + SPARE_MARGIN,
            cable_gap=limits.cable_gap + SPARE_MARGIN,
            joint_limit=cable.joint_limit - SPARE_MARGIN,
            paced=problem.paced,
            pace_from=problem.pace_from,
            pace=self.team.top_speed * problem.period - SPARE_MARGIN,
            turn=self.team.top_speed * problem.period / body - SPARE_MARGIN,
            longest=self._longest_chords() - SPARE_MARGIN,
        )

    def _longest_chords(self) -> Array:
        """Of the pieces of cable before each vehicle, metres; inf if neither of its ends drives."""
        held, pull = self.team.held_links, DRAGGED_PULL_SHARE * self.team.force
        is_drawn = np.isin(((-1, *held[:-1]), held), self.problem.paced).any(axis=0)
        return np.where(is_drawn, self.problem.cable.longest_chords(held, pull), inf)

    def rows(self, angles: Array, band: float = 0.0, links: Array | None = None) -> LimitRows:
        """Rows with a margin below `band`, shape (R,), of `ROW_TYPE`; of links as given, if so."""
        if links is None:
            links = np.empty((len(angles), 5))
            place_links(angles, self.arrays.root, self.arrays.length, links)
        count, rows = 64 + len(angles), np.empty(0, dtype=ROW_TYPE)
        limits, obstacles = tuple(self.arrays), tuple(self.problem.obstacles)
        while count > len(rows):
            rows = np.empty(count, dtype=ROW_TYPE)
            count = _fill_limit_rows_of_tuples(rows, band, angles, links, limits, obstacles)
        return rows[:count]

    def describe(self, row: np.void, texts: Sequence[str] = LIMIT_NAMES) -> str:
        """The text of a row's kind with its figures: its name, or how a shape breaks it."""
        link, other, disc = int(row["link"]), int(row["other"]), int(row["disc"])
        is_named = 0 <= disc < len(self.disc_names)
        figures = {
            "link": link,
            "other": other,
            "holder": self._vehicle_of_link(link),
            "other_holder": self._vehicle_of_link(other),
            "obstacle": self.disc_names[disc] if is_named else "a wall or a pillar",
            "mm": format_figure(-1e3 * row["margin"]),
            "bend": format_figure(degrees(-row["margin"])),
            "link_clearance": 1e3 * self.limits.link_clearance,
            "body_clearance": 1e3 * self.limits.vehicle_clearance,
            "vehicle_gap": 1e3 * self.limits.vehicle_gap,
            "cable_gap": 1e3 * self.limits.cable_gap,
            "top_speed": 60 * self.team.top_speed,
            "joint_limit": degrees(self.problem.cable.joint_limit),
        }
        return texts[int(row["kind"])].format(**figures)

    def _vehicle_of_link(self, link: int) -> str:
        """The vehicle that holds a link, if one does."""
        if link not in self.team.held_links:
            return ""
        return self.team.name_of(self.team.held_links.index(link))
