"""Paths of a given length between two poses: arcs and straight pieces, through poses between.

From one pose to the next leads the shortest path of arc, straight piece and arc: Dubins (1957), On
curves of minimal length with a constraint on average curvature. The poses between are moved until
the whole has the length.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array

TURN_SIDES: Final = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""To which the two arcs turn: 1 is left."""

LEAD_DIRECTIONS: Final = 12
"""Directions in which a bend is led away, and its headings there."""

BASE_SHARES: Final = (0.25, 0.5, 0.75)
"""Of the line between the ends, from where a single bend is led away."""

RADIUS_STEPS: Final = 4
"""Of arcs, each twice the one before."""

LANE_WIDTHS: Final = (2.2, 4.4)
"""Radii from one lane of a meander to the next: two would make half circles of its bends."""

LEAST_RADII: Final = 1.05
"""Times the least radius is the smallest: links are chords, and are yet to be fitted."""

LENGTH_STEPS: Final = 48
"""Places along a direction between which a length may be met."""

LENGTH_HALVINGS: Final = 24
"""Of the way between two of them."""

LENGTH_TOLERANCE: Final = 1e-3
"""Share of the length within which it is met: nearer is a matter for the chain's own solver."""


def bent_once(start: Array, end: Array, length: float, least_radius: float) -> Array:
    """Headings along paths from pose to pose through one pose between, off to any side.

    Parameters
    ----------
    start, end : ndarray, shape (3,)
        x, y, metres, and heading, radians.
    length : float
        Of every path, metres.
    least_radius : float
        Of the arcs, metres.

    Returns
    -------
    ndarray, shape (M, 7, 2)
        Of each path its corners: how far along, metres, and the heading there, radians, not
        wrapped. In between it changes evenly.
    """
    turns = 2 * np.pi * np.arange(LEAD_DIRECTIONS) / LEAD_DIRECTIONS
    share, way, heading, radius = (
        each.reshape(-1, 1)
        for each in np.meshgrid(BASE_SHARES, turns, turns, _radii(least_radius), indexing="ij")
    )
    bases = start[:2] + share[..., None] * (end - start)[:2]
    off = np.stack((np.cos(way), np.sin(way)), axis=-1)
    return _of_length(start, end, length, bases, off, heading, radius[:, 0])


def meanders(
    start: Array, end: Array, length: float, least_radius: float, bends: int, centres: Array
) -> Array:
    """Headings along paths from pose to pose that go to and fro in lanes.

    Parameters
    ----------
    start, end, length, least_radius
        See `bent_once`.
    bends : int
        From lane to lane, two or more.
    centres : ndarray, shape (C, 2)
        Of meanders, metres.

    Returns
    -------
    ndarray, shape (M, 3 + 3 bends + 1, 2)
        See `bent_once`.
    """
    turns = 2 * np.pi * np.arange(LEAD_DIRECTIONS) / LEAD_DIRECTIONS
    which, axis, first, radius, lane = (
        each.reshape(-1, 1)
        for each in np.meshgrid(
            np.arange(len(centres)),
            turns,
            (-1, 1),
            _radii(least_radius),
            LANE_WIDTHS,
            indexing="ij",
        )
    )
    along = np.stack((np.cos(axis), np.sin(axis)), axis=-1)
    across = np.stack((-np.sin(axis), np.cos(axis)), axis=-1)
    place = (np.arange(bends) - (bends - 1) / 2) * lane * radius
    bases = centres[which] + place[..., None] * along
    off = (first * (-1) ** np.arange(bends))[..., None] * across
    heading = np.broadcast_to(axis, place.shape)
    return _of_length(start, end, length, bases, off, heading, radius[:, 0])


def _radii(least: float) -> Array:
    return np.asarray(LEAST_RADII * least * 2.0 ** np.arange(RADIUS_STEPS))


def _of_length(
    start: Array, end: Array, length: float, bases: Array, off: Array, heading: Array, radius: Array
) -> Array:
    """Paths through poses led from `bases` along `off` so far that they have the length.

    Parameters
    ----------
    start, end, length
        See `bent_once`.
    bases, off : ndarray, shape (M, K, 2)
    heading : ndarray, shape (M, K)
    radius : ndarray, shape (M,)
    """

    def paths(which: NDArray[np.intp], far: Array) -> Array:
        places = bases[which] + far[:, None, None] * off[which]
        between = np.concatenate((places, heading[which, :, None]), axis=-1)
        return _through(start, between, end, radius[which])

    everyone = np.arange(len(bases))
    fars = np.linspace(0.0, 0.5 * length, LENGTH_STEPS)
    longer = np.stack(
        [paths(everyone, np.full(len(bases), far))[:, -1, 0] > length for far in fars]
    )
    step, which = np.nonzero(longer[1:] != longer[:-1])
    low, high, rises = fars[step], fars[step + 1], longer[step + 1, which]
    for _ in range(LENGTH_HALVINGS):
        middle = 0.5 * (low + high)
        above = (paths(which, middle)[:, -1, 0] > length) == rises
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    made = paths(which, low)
    # Where shortest paths change sides their length jumps: past it, nothing was met.
    return made[np.abs(made[:, -1, 0] - length) < LENGTH_TOLERANCE * length]


def _through(start: Array, between: Array, end: Array, radius: Array) -> Array:
    """Corners of paths through poses between, shape (M, K, 3), with arcs of radii, shape (M,)."""
    last = np.broadcast_to(start, (len(between), 3))
    whole = np.zeros((len(between), 1, 2))
    whole[:, 0, 1] = start[2]
    for pose in (*between.swapaxes(0, 1), np.broadcast_to(end, last.shape)):
        piece = _shortest(last, pose, radius)
        piece = piece[:, 1:] - piece[:, :1] + whole[:, -1:]
        whole, last = np.concatenate((whole, piece), axis=1), pose
    return whole


def _shortest(start: Array, end: Array, radius: Array) -> Array:
    """Corners of shortest paths of arc, straight piece, arc, shape (M, 4, 2)."""
    begin = start[:, 2]
    best = np.full((len(radius), 4, 2), np.inf)
    for first, last in TURN_SIDES:
        a = _centre(start, first * radius)
        b = _centre(end, last * radius)
        dx, dy = (b - a).T
        apart, ahead = np.hypot(dx, dy), np.arctan2(dy, dx)
        # Straight pieces between circles turned in opposite ways cross the line of their centres.
        share = np.divide(
            (first - last) * radius, apart, out=np.full(len(apart), 2.0), where=apart > 1e-12
        )
        possible = np.abs(share) <= 1.0 if first != last else np.ones(len(apart), bool)
        share = np.where(possible, share, 0.0) if first != last else np.zeros(len(apart))
        heading = ahead + np.arcsin(share)
        turn = (first * (heading - begin)) % (2 * np.pi)
        back = (last * (end[:, 2] - heading)) % (2 * np.pi)
        straight = apart * np.sqrt(1 - share**2)
        along = np.cumsum((np.zeros(len(apart)), radius * turn, straight, radius * back), axis=0)
        on = begin + first * turn
        headings = np.stack((begin, on, on, on + last * back))
        shorter = possible & (along[-1] < best[:, -1, 0])
        best[shorter] = np.stack((along, headings), axis=-1).swapaxes(0, 1)[shorter]
    return best


def _centre(pose: Array, radius: Array) -> Array:
    """Of a circle to the left, for a radius above 0, of a pose."""
    x, y, heading = pose.T
    return np.stack((x - radius * np.sin(heading), y + radius * np.cos(heading)), axis=-1)
