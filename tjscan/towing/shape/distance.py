"""Signed distances of points to walls, polygons and discs, with gradient and Hessian.

Positive on the free floor, negative in what is not: a link that is outside gains by coming back.
"""

from __future__ import annotations

from math import hypot

from tjscan.core.frames import Array
from tjscan.towing.shape.compiled import Indices, compiled

SignedDistance = tuple[float, float, float, float, float, float]
"""Distance, its gradient (x, y) and its Hessian (xx, xy, yy)."""


@compiled
def distance_from_point(x: float, y: float, sign: float, radius: float) -> SignedDistance:
    """Signed length of (x, y) less a radius, with gradient and Hessian (xx, xy, yy)."""
    length = max(hypot(x, y), 1e-9)
    nx, ny = x / length, y / length
    curved = sign / length
    xx, xy, yy = curved * ny * ny, -curved * nx * ny, curved * nx * nx
    return sign * length - radius, sign * nx, sign * ny, xx, xy, yy


@compiled
def distance_to_polygon(x: float, y: float, corners: Array) -> SignedDistance:
    """Signed distance of a point to a counter-clockwise polygon, gradient and Hessian.

    The nearest feature gives the sign: an edge by its outward normal, a corner by whether it is
    convex.
    """
    n = len(corners)
    nearest, which, at_corner = 1e300, 0, False
    for i in range(n):
        ax, ay = corners[i, 0], corners[i, 1]
        j = i + 1 if i + 1 < n else 0
        ex, ey = corners[j, 0] - ax, corners[j, 1] - ay
        t = ((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey)
        if t >= 1.0:
            continue  # the next edge begins there
        corner = t <= 0.0
        t = max(t, 0.0)
        d = (x - ax - t * ex) ** 2 + (y - ay - t * ey) ** 2
        if d < nearest:
            nearest, which, at_corner = d, i, corner
    ax, ay = corners[which, 0], corners[which, 1]
    after = which + 1 if which + 1 < n else 0
    ex, ey = corners[after, 0] - ax, corners[after, 1] - ay
    if at_corner and nearest > 1e-18:
        bx, by = ax - corners[which - 1, 0], ay - corners[which - 1, 1]
        return distance_from_point(x - ax, y - ay, 1.0 if bx * ey - by * ex > 0 else -1.0, 0.0)
    length = hypot(ex, ey)
    nx, ny = ey / length, -ex / length
    return nx * (x - ax) + ny * (y - ay), nx, ny, 0.0, 0.0, 0.0


@compiled
def distance_to_swept_disc(x: float, y: float, disc: Array) -> SignedDistance:
    """Signed distance to a disc (x0, y0, x1, y1, radius) swept along a line, and derivatives."""
    ex, ey = disc[2] - disc[0], disc[3] - disc[1]
    along = ex * ex + ey * ey
    t = 0.0
    if along > 0.0:
        t = min(max(((x - disc[0]) * ex + (y - disc[1]) * ey) / along, 0.0), 1.0)
    rx, ry = x - disc[0] - t * ex, y - disc[1] - t * ey
    d, gx, gy, hxx, hxy, hyy = distance_from_point(rx, ry, 1.0, disc[4])
    if 0.0 < t < 1.0:
        return d, gx, gy, 0.0, 0.0, 0.0
    return d, gx, gy, hxx, hxy, hyy


@compiled
def distance_to_obstacle(
    k: int, x: float, y: float, walls: Array, corners: Array, starts: Indices, discs: Array
) -> SignedDistance:
    """Signed distance to the k-th of walls, polygons and discs; gradient, Hessian (xx, xy, yy).

    It takes what `area.Obstacles` holds one by one: taking it apart here would cost a tenth.
    """
    if k < len(walls):
        nx, ny = walls[k, 0], walls[k, 1]
        return nx * x + ny * y - walls[k, 2], nx, ny, 0.0, 0.0, 0.0
    k -= len(walls)
    if k < len(starts) - 1:
        return distance_to_polygon(x, y, corners[starts[k] : starts[k + 1]])
    return distance_to_swept_disc(x, y, discs[k - len(starts) + 1])
