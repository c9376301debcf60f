"""From what each joint and each link contributes to derivatives by the angles.

Every term of the problems is a function of one joint's angle, one link's position or one link's
heading. Positions follow from all headings before, so that sums over the links beyond are all that
gradient and Hessian need.
"""

from __future__ import annotations

from math import cos, floor, pi, sin
from typing import Final, NamedTuple

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.compiled import Indices, compiled


@compiled
def place_links(angles: Array, root: Array, length: float, links: Array) -> None:
    """Fill `links`, shape (N, 5), with x, y, heading, its cosine and its sine."""
    x, y, phi = root[0], root[1], root[2]
    for i in range(len(angles)):
        phi += angles[i]
        c, s = cos(phi), sin(phi)
        x += length * c
        y += length * s
        links[i, 0], links[i, 1], links[i, 2], links[i, 3], links[i, 4] = x, y, phi, c, s


class ChainDerivatives(NamedTuple):
    """What single joints and links contribute to derivatives of a function of the chain.

    Parameters
    ----------
    joint : ndarray, shape (N, 2)
        First and second derivative by each joint's angle.
    point : ndarray, shape (N, 5)
        Gradient (x, y) and Hessian (xx, xy, yy) by the position of each link's far end.
    turn : ndarray, shape (N, 2)
        First and second derivative by each link's heading.
    """

    joint: Array
    point: Array
    turn: Array


@compiled
def new_chain_derivatives(n: int) -> ChainDerivatives:
    """Parts of a chain of n links; those by heading are 0."""
    return ChainDerivatives(np.empty((n, 2)), np.empty((n, 5)), np.zeros((n, 2)))


@compiled
def chain_gradient(parts: ChainDerivatives, links: Array, length: float, gradient: Array) -> None:
    """Gradient by the angles, shape (N,), filled."""
    joint, point, turn = parts
    sx, sy, by_heading = 0.0, 0.0, 0.0
    for i in range(len(gradient) - 1, -1, -1):
        sx += point[i, 0]
        sy += point[i, 1]
        by_heading += length * (links[i, 3] * sy - links[i, 4] * sx) + turn[i, 0]
        gradient[i] = joint[i, 0] + by_heading


def chain_hessian(parts: ChainDerivatives, links: Array, length: float, hessian: Array) -> None:
    """Hessian by the angles, shape (N, N); both triangles are filled.

    With n_j = (-sin φ_j, cos φ_j) and u_j = (cos φ_j, sin φ_j), headings j ≤ k give
    l² n_j' T_k n_k, and j = k loses l u_j' S_j too, S and T being sums over the links from k on of
    gradients and Hessians by position. Sums over rows and columns turn headings into angles.
    """
    sx, sy, xx, xy, yy = np.cumsum(parts.point[::-1], axis=0)[::-1].T
    c, s = links[:, 3], links[:, 4]
    by_heading = np.tril(np.outer(xy * c - xx * s, -s) + np.outer(yy * c - xy * s, c))
    by_heading = length**2 * (by_heading + np.tril(by_heading, -1).T)
    by_heading += np.diag(parts.turn[:, 1] - length * (c * sx + s * sy))
    by_angle = by_heading[::-1, ::-1].cumsum(axis=0).cumsum(axis=1)[::-1, ::-1]
    hessian[:] = by_angle + np.diag(parts.joint[:, 1])


HessianSums = tuple[float, float, float, float, float, float, float, float]
"""What a joint needs of the links from its own on: gradient (x, y) and Hessian (xx, xy, yy) by
position, and the Hessian by x and heading, y and heading, and heading."""

NO_HESSIAN_SUMS: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@compiled
def add_link_to_hessian(
    i: int, parts: ChainDerivatives, links: Array, length: float, sums: HessianSums
) -> HessianSums:
    """Sums with those of link i, which turns about its near end."""
    _, point, turn = parts
    sx, sy, xx, xy, yy, xt, yt, tt = sums
    ax, ay = -length * links[i, 4], length * links[i, 3]
    sx += point[i, 0]
    sy += point[i, 1]
    xx += point[i, 2]
    xy += point[i, 3]
    yy += point[i, 4]
    by_x, by_y = xx * ax + xy * ay, xy * ax + yy * ay
    tt += turn[i, 1] - ay * sx + ax * sy
    tt += ax * by_x + ay * by_y + 2.0 * (ax * xt + ay * yt)
    return sx, sy, xx, xy, yy, xt + by_x, yt + by_y, tt


@compiled
def chain_hessian_diagonal(
    parts: ChainDerivatives, links: Array, length: float, diagonal: Array
) -> None:
    """Diagonal of the Hessian by the angles, shape (N,), filled in O(N)."""
    sums = NO_HESSIAN_SUMS
    for i in range(len(diagonal) - 1, -1, -1):
        sums = add_link_to_hessian(i, parts, links, length, sums)
        diagonal[i] = parts.joint[i, 1] + sums[7]


@compiled
def link_motion_by_joint(i: int, k: int, links: Array, root: Array) -> tuple[float, float]:
    """How the end of link k goes as joint i turns, which is not beyond it."""
    x, y = (root[0], root[1]) if i == 0 else (links[i - 1, 0], links[i - 1, 1])
    return y - links[k, 1], links[k, 0] - x


@compiled
def angle_within_pi(angle: float) -> float:
    """Angle between -π and π."""
    return angle - 2.0 * pi * floor(angle / (2.0 * pi) + 0.5)


@compiled
def pose_constraints(
    links: Array, root: Array, fixed: Indices, poses: Array, c: Array, rows: Array
) -> None:
    """(10)-(12) for links that must have a pose: how far off, and the derivative by the angles."""
    rows[:] = 0.0
    for e in range(len(fixed)):
        k = fixed[e]
        c[3 * e] = links[k, 0] - poses[e, 0]
        c[3 * e + 1] = links[k, 1] - poses[e, 1]
        c[3 * e + 2] = angle_within_pi(links[k, 2] - poses[e, 2])
        for i in range(k + 1):
            way = link_motion_by_joint(i, k, links, root)
            rows[3 * e, i], rows[3 * e + 1, i], rows[3 * e + 2, i] = way[0], way[1], 1.0
