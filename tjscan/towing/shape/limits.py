"""Hard limits at a shape: how much of each is left, and its derivative by the angles.

Every limit but the joints' own is a distance between a point of the cable and something that
stands, or another point of the cable. Its derivative follows from where those points are on the
chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import degrees, hypot, pi
from typing import Any

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.area import Obstacles
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import place_links
from tjscan.towing.shape.compiled import Indices, compiled
from tjscan.towing.shape.distance import distance_to_obstacle
from tjscan.towing.shape.team import TowingLimits, TowingTeam


class LimitKind(IntEnum):
    """What a limit holds apart, or slow."""

    LINK_TO_OBSTACLE = 0
    BODY_TO_OBSTACLE = 1
    BODY_TO_BODY = 2
    LINK_TO_BODY = 3
    LINK_TO_LINK = 4
    SPEED = 5
    JOINT = 6


COLUMNS = 10
"""Of a row: margin; direction x, y in which it grows; link and point (x, y) that feel it; the same
of the point that feels the opposite, link -1 if none; kind."""

SPARE = 1e-6
"""Metres and radians added to every limit: what a solver may miss it by (`KEPT`)."""

KEPT = -1e-6
"""A margin above is a limit that is kept."""

JOINT_BAND = 5.0
"""Radians of a joint's margin that count as a metre of distance: a step changes them so."""


@compiled
def nearest_on_link(i: int, x: float, y: float, root: Array, links: Array) -> tuple[float, float]:
    """Point of link i nearest to (x, y)."""
    ax, ay = (root[0], root[1]) if i == 0 else (links[i - 1, 0], links[i - 1, 1])
    ex, ey = links[i, 0] - ax, links[i, 1] - ay
    t = min(max(((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    return ax + t * ex, ay + t * ey


@compiled
def add_row(
    rows: Array, used: int, margin: float, x: float, y: float, i: int, px: float, py: float,
    j: int, qx: float, qy: float, kind: int,
) -> int:  # fmt: skip
    """Write a row if there is room; the number of rows that there would be is returned."""
    if used < len(rows):
        row = rows[used]
        row[0], row[1], row[2], row[3], row[4], row[5] = margin, x, y, i, px, py
        row[6], row[7], row[8], row[9] = j, qx, qy, kind
    return used + 1


@compiled
def add_apart(
    rows: Array, used: int, apart: float, band: float, i: int, px: float, py: float,
    j: int, qx: float, qy: float, kind: int,
) -> int:  # fmt: skip
    """A row for two points that must be `apart`, if the margin is less than `band`."""
    x, y = px - qx, py - qy
    d = hypot(x, y)
    if d - apart >= band:
        return used
    d = max(d, 1e-9)
    return add_row(rows, used, d - apart, x / d, y / d, i, px, py, j, qx, qy, kind)


@compiled
def do_cross(a: Array, b: Array, c: Array, d: Array) -> bool:
    """Whether the lines from a to b and from c to d cross, all of shape (2,)."""
    ux, uy, vx, vy = b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]
    c_side = ux * (c[1] - a[1]) - uy * (c[0] - a[0])
    d_side = ux * (d[1] - a[1]) - uy * (d[0] - a[0])
    a_side = vx * (a[1] - c[1]) - vy * (a[0] - c[0])
    b_side = vx * (b[1] - c[1]) - vy * (b[0] - c[0])
    return bool(c_side * d_side < 0.0 and a_side * b_side < 0.0)


@compiled
def add_links_apart(
    rows: Array, used: int, apart: float, band: float, i: int, j: int, root: Array, links: Array
) -> int:
    """Rows for two links: each end of one against the other; if they cross, the way back."""
    before_i, before_j = root[:2] if i == 0 else links[i - 1, :2], links[j - 1, :2]
    crossed = do_cross(before_i, links[i, :2], before_j, links[j, :2])
    nearest, end, of, qx, qy = 1e300, 0, 0, 0.0, 0.0
    for a, b in ((i, j), (j, i)):
        for at in (a - 1, a):
            x, y = (root[0], root[1]) if at < 0 else (links[at, 0], links[at, 1])
            nx, ny = nearest_on_link(b, x, y, root, links)
            if not crossed:
                used = add_apart(rows, used, apart, band, at, x, y, b, nx, ny, 4)
            elif hypot(x - nx, y - ny) < nearest:
                nearest, end, of, qx, qy = hypot(x - nx, y - ny), at, b, nx, ny
    if crossed:
        x, y = (root[0], root[1]) if end < 0 else (links[end, 0], links[end, 1])
        d = max(nearest, 1e-9)
        used = add_row(
            rows, used, -nearest - apart, (qx - x) / d, (qy - y) / d, end, x, y, of, qx, qy, 4
        )
    return used


@compiled
def add_crossed_edges(
    rows: Array, used: int, apart: float, i: int, root: Array, links: Array, corners: Array
) -> int:
    """Rows for a link that crosses edges of a polygon thinner than the link is long."""
    before = root[:2] if i == 0 else links[i - 1, :2]
    for k in range(len(corners)):
        a, b = corners[k - 1], corners[k]
        if do_cross(before, links[i, :2], a, b):
            nx, ny = b[1] - a[1], a[0] - b[0]
            length = hypot(nx, ny)
            nx, ny = nx / length, ny / length
            here = nx * (links[i, 0] - a[0]) + ny * (links[i, 1] - a[1])
            there = nx * (before[0] - a[0]) + ny * (before[1] - a[1])
            if abs(here) < abs(there):
                at, x, y, side, deep = i, links[i, 0], links[i, 1], here, abs(here)
            else:
                at, x, y, side, deep = i - 1, before[0], before[1], there, abs(there)
            sign = -1.0 if side > 0.0 else 1.0
            used = add_row(
                rows, used, -deep - apart, sign * nx, sign * ny, at, x, y, -1, 0.0, 0.0, 0
            )
    return used


@compiled
def limit_rows(
    angles: Array,
    links: Array,
    band: float,
    rows: Array,
    root: Array,
    length: float,
    held: Indices,
    sizes: Array,
    paced: Indices,
    pace_from: Array,
    pace: float,
    walls: Array,
    corners: Array,
    starts: Indices,
    discs: Array,
) -> int:
    """Rows of all limits with a margin below `band`; returns how many, even if not all fit.

    Parameters
    ----------
    angles : ndarray, shape (N,)
    links : ndarray, shape (N, 5)
    band : float
    rows : ndarray, shape (R, 10)
        Filled, see `COLUMNS`.
    root : ndarray, shape (3,)
    length : float
        Of a link.
    held : ndarray of int, shape (M,)
        Links that vehicles hold; the last is the welder's.
    sizes : ndarray, shape (8,)
        Clearance of links; of vehicles' centres to obstacles; between vehicles' centres; of links
        to vehicles' centres; between links; the lengths at root and welder free of the
        first; and the joints' limit.
    paced : ndarray of int, shape (P,)
        Links with a top speed, which began at `pace_from` and may go `pace`.
    walls, corners, starts, discs : ndarray
        Obstacles.
    """
    n, used = len(links), 0
    obstacles = len(walls) + len(starts) - 1 + len(discs)
    first = int(np.ceil(sizes[5] / length - 1e-9))
    last = n - int(np.ceil(sizes[6] / length - 1e-9))
    for i in range(first, last):
        x, y = links[i, 0], links[i, 1]
        for k in range(obstacles):
            d, gx, gy, _, _, _ = distance_to_obstacle(k, x, y, walls, corners, starts, discs)
            if d - sizes[0] < band:
                used = add_row(rows, used, d - sizes[0], gx, gy, i, x, y, -1, 0.0, 0.0, 0)
        for k in range(len(corners)):
            cx, cy = corners[k, 0], corners[k, 1]
            if abs(x - cx) + abs(y - cy) < 3.0 * (length + sizes[0] + band):
                qx, qy = nearest_on_link(i, cx, cy, root, links)
                if 0.0 < hypot(qx - x, qy - y) < length:
                    used = add_apart(rows, used, sizes[0], band, i, qx, qy, -1, cx, cy, 0)
        for k in range(len(starts) - 1):
            polygon = corners[starts[k] : starts[k + 1]]
            used = add_crossed_edges(rows, used, sizes[0], i, root, links, polygon)
        for k in range(len(discs)):
            for at in (0, 2):
                cx, cy = discs[k, at], discs[k, at + 1]
                apart = sizes[0] + discs[k, 4]
                qx, qy = nearest_on_link(i, cx, cy, root, links)
                if 0.0 < hypot(qx - x, qy - y) < length:
                    used = add_apart(rows, used, apart, band, i, qx, qy, -1, cx, cy, 0)
    near_body = pi / 2 * sizes[3]
    for m in range(len(held)):
        i = held[m]
        x, y = links[i, 0], links[i, 1]
        if m < len(held) - 1:
            for k in range(obstacles):
                d, gx, gy, _, _, _ = distance_to_obstacle(k, x, y, walls, corners, starts, discs)
                if d - sizes[1] < band:
                    used = add_row(rows, used, d - sizes[1], gx, gy, i, x, y, -1, 0.0, 0.0, 1)
        for o in range(m):
            j = held[o]
            used = add_apart(rows, used, sizes[2], band, i, x, y, j, links[j, 0], links[j, 1], 2)
        for j in range(n):
            # Cable between may lie on a half circle of that width.
            between = (i - j) * length if j <= i else (j - 1 - i) * length
            if between < near_body:
                continue
            if abs(x - links[j, 0]) + abs(y - links[j, 1]) < 3.0 * (length + sizes[3] + band):
                qx, qy = nearest_on_link(j, x, y, root, links)
                used = add_apart(rows, used, sizes[3], band, j, qx, qy, i, x, y, 3)
    skip = 1 + int(np.ceil(pi / 2 * sizes[4] / length))
    reach = 2.0 * length + sizes[4] + band
    for i in range(n):
        j = i + skip + 1
        while j < n:
            d = hypot(links[i, 0] - links[j, 0], links[i, 1] - links[j, 1])
            if d < reach:
                used = add_links_apart(rows, used, sizes[4], band, i, j, root, links)
            # Links further on can't be nearer than what the cable between allows.
            j += max(1, int((d - reach) / length))
    for p in range(len(paced)):
        i = paced[p]
        x, y = links[i, 0] - pace_from[p, 0], links[i, 1] - pace_from[p, 1]
        d = hypot(x, y)
        if pace - d < band:
            d = max(d, 1e-9)
            used = add_row(
                rows, used, pace - d, -x / d, -y / d, i, links[i, 0], links[i, 1], -1, 0.0, 0.0, 5
            )
    for i in range(n):
        margin = sizes[7] - abs(angles[i])
        if margin < JOINT_BAND * band:
            sign = -1.0 if angles[i] > 0 else 1.0
            used = add_row(rows, used, margin, sign, 0.0, i, 0.0, 0.0, -1, 0.0, 0.0, 6)
    return used


@compiled
def limit_gradients(rows: Array, root: Array, links: Array, gradients: Array) -> None:
    """Derivatives by the angles, shape (R, N): a point turns about the joints before it."""
    for r in range(len(rows)):
        i, j = int(rows[r, 3]), int(rows[r, 6])
        gx, gy = rows[r, 1], rows[r, 2]
        if rows[r, 9] == 6.0:
            gradients[r, :] = 0.0
            gradients[r, i] = gx
            continue
        for k in range(len(links)):
            x, y = (root[0], root[1]) if k == 0 else (links[k - 1, 0], links[k - 1, 1])
            total = 0.0
            if k <= i:
                total += gy * (rows[r, 4] - x) - gx * (rows[r, 5] - y)
            if k <= j:
                total -= gy * (rows[r, 7] - x) - gx * (rows[r, 8] - y)
            gradients[r, k] = total


def rounded(figure: float) -> str:
    """A figure as a message states it: what is below ten is not rounded to nothing."""
    return f"{figure:.0f}" if figure >= 10 else f"{figure:.2g}"


@dataclass(frozen=True, slots=True, eq=False)
class HardLimits:
    """All that a plan of one period must keep.

    Parameters
    ----------
    cable : Cable
    team : TowingTeam
    limits : TowingLimits
    obstacles : Obstacles
    paced : ndarray of int, shape (P,)
        Links of vehicles that drive.
    pace_from : ndarray, shape (P, 2)
        Where they are.
    period : float
        Seconds.
    """

    cable: Cable
    team: TowingTeam
    limits: TowingLimits
    obstacles: Obstacles
    paced: Indices
    pace_from: Array
    period: float

    @property
    def sizes(self) -> Array:
        """As `limit_rows` takes them."""
        limits, body = self.limits, self.team.body_radius
        return np.array(
            (
                limits.link_clearance + SPARE,
                body + limits.body_clearance + SPARE,
                2 * body + limits.vehicle_gap + SPARE,
                body + limits.body_clearance + SPARE,
                limits.cable_gap + SPARE,
                limits.free_at_root,
                limits.free_at_welder,
                self.cable.joint_limit - SPARE,
            )
        )

    @property
    def arguments(self) -> Any:
        """What `limit_rows` takes from the root on."""
        return (
            np.array(self.cable.root, dtype=float), self.cable.link_length,
            np.array(self.team.held_links), self.sizes, self.paced, self.pace_from,
            self.team.top_speed * self.period - SPARE, *self.obstacles.arrays,
        )  # fmt: skip

    def rows(self, angles: Array, band: float = 0.0) -> Array:
        """Rows with a margin below `band`, shape (R, 10), see `COLUMNS`."""
        links, arguments, room = np.empty((len(angles), 5)), self.arguments, 64
        place_links(angles, arguments[0], arguments[1], links)
        while True:
            rows = np.empty((room, COLUMNS))
            used = limit_rows(angles, links, band, rows, *arguments)
            if used <= room:
                return rows[:used]
            room = used

    def name(self, row: Array) -> str:
        """Which limit a row is, in words."""
        kind, link, other = LimitKind(int(row[9])), int(row[3]), int(row[6])
        match kind:
            case LimitKind.LINK_TO_OBSTACLE:
                return f"link {link} to obstacle"
            case LimitKind.BODY_TO_OBSTACLE:
                return f"{self._holder(link)} to obstacle"
            case LimitKind.BODY_TO_BODY:
                return f"{self._holder(link)} to {self._holder(other)}"
            case LimitKind.LINK_TO_BODY:
                return f"link {link} to {self._holder(other)}"
            case LimitKind.LINK_TO_LINK:
                return f"link {link} to link {other}"
            case LimitKind.SPEED:
                return f"speed of {self._holder(link)}"
            case _:
                return f"bend of joint {link}"

    def words(self, row: Array) -> str:
        """What a row with a margin below zero says of the shape."""
        kind, link, mm = LimitKind(int(row[9])), int(row[3]), rounded(-1e3 * row[0])
        limits = self.limits
        match kind:
            case LimitKind.LINK_TO_OBSTACLE:
                asked = f"{1e3 * limits.link_clearance:.0f} mm from what stands there"
                return f"link {link} would be {mm} mm too near: it must keep {asked}"
            case LimitKind.BODY_TO_OBSTACLE:
                asked = f"{1e3 * limits.body_clearance:.0f} mm from what stands there"
                return f"{self._holder(link)} would be {mm} mm too near: its body must keep {asked}"
            case LimitKind.BODY_TO_BODY:
                return (
                    f"{self._holder(link)} and {self._holder(int(row[6]))} would be {mm} mm "
                    f"too near: {1e3 * limits.vehicle_gap:.0f} mm must stay between their bodies"
                )
            case LimitKind.LINK_TO_BODY:
                return (
                    f"link {link} would be {mm} mm too near to {self._holder(int(row[6]))}: "
                    f"{1e3 * limits.body_clearance:.0f} mm must stay between them"
                )
            case LimitKind.LINK_TO_LINK:
                return (
                    f"links {link} and {int(row[6])} would be {mm} mm too near: the cable "
                    f"must keep {1e3 * limits.cable_gap:.0f} mm from itself"
                )
            case LimitKind.SPEED:
                return (
                    f"{self._holder(link)} would have to drive {mm} mm further than it can at "
                    f"{60 * self.team.top_speed:.3g} m/min"
                )
            case _:
                return (
                    f"joint {link} would be bent {rounded(degrees(-row[0]))}° past its limit of "
                    f"{degrees(self.cable.joint_limit):.1f}°"
                )

    def _holder(self, link: int) -> str:
        vehicle = self.team.held_links.index(link)
        return "the welder" if vehicle == self.team.welder else f"vehicle {vehicle + 1}"

    def gradients(self, rows: Array, angles: Array) -> Array:
        """Derivatives of the margins by the angles, shape (R, N)."""
        links, gradients = np.empty((len(angles), 5)), np.empty((len(rows), len(angles)))
        root = np.array(self.cable.root, dtype=float)
        place_links(angles, root, self.cable.link_length, links)
        limit_gradients(rows, root, links, gradients)
        return gradients
