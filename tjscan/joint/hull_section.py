"""The cross-section of a hull joint at one place, with the passes that are welded there.

Coordinates across the joint: to the right of a traveller along it, from the middle between the top
edges, and height over the middle of both plates' outsides, out of the hull. Metres.
"""

from __future__ import annotations

from functools import lru_cache
from math import pi, sin, sqrt
from typing import Final

import numpy as np

from tjscan.core.frames import Array, readonly_copy
from tjscan.joint.hull import HullJoint, HullTack, WeldBead

HALF_EXTENT: Final = 0.25
"""How far each plate is drawn from the joint, in metres: no laser line is longer."""

OPEN_DEPTH: Final = 0.5
"""How deep a root gap without backing is drawn, in metres: out of any laser's range."""

BEAD_NODES: Final = 25
"""Points on the face of a bead; the chords between them miss it by a micrometre or two."""

FACE_LEAN: Final = 1e-9
"""By how much upright faces lean, in metres, so that a section has one height everywhere."""

MILLIMETRE_DIGITS: Final = 3
"""Decimals of a place along the joint: a section is taken at the nearest millimetre."""

RIPPLE_WAVELENGTHS: Final = (0.006, 0.017, 0.052)
"""Wavelengths of a bead's ripple along the joint, in metres (assumption)."""


def hull_section(joint: HullJoint, along: float, passes: int = 0) -> Array:
    """Outline of the steel across a hull joint at one place.

    Parameters
    ----------
    joint : HullJoint
    along : float
        Distance along the joint, in metres.
    passes : int
        How many passes are welded there.

    Returns
    -------
    ndarray, shape (n, 2)
        Across and height, in metres, from left to right; not to be written to.
    """
    along = round(along, MILLIMETRE_DIGITS)
    tack = max((_tack_height(tack, along) for tack in joint.tacks), default=0.0)
    ripples = tuple(joint.ripple * _ripple(along, k) for k in range(len(joint.beads[:passes])))
    return _welded(joint, max(tack, 0.0), ripples)


def top_edges(joint: HullJoint) -> Array:
    """Left and right top edge of the groove, (across, height) in metres, shape (2, 2)."""
    half, step = joint.width / 2, joint.high_low / 2
    return np.array([(-half, -step), (half, step)])


def area_left_to_fill(joint: HullJoint, section: Array) -> float:
    """Area between a section and the line between the groove's top edges, in m².

    Parameters
    ----------
    joint : HullJoint
    section : ndarray, shape (n, 2)
        As `hull_section` gives it.
    """
    (left, low), (right, high) = top_edges(joint).tolist()
    inside = (section[:, 0] > left) & (section[:, 0] < right)
    x = np.concatenate(([left], section[inside, 0], [right]))
    below = low + (high - low) * (x - left) / (right - left) - np.interp(x, *section.T)
    return float(np.trapezoid(np.maximum(below, 0.0), x))


@lru_cache(maxsize=256)
def _welded(joint: HullJoint, tack: float, ripples: tuple[float, ...]) -> Array:
    """Section with a tack and with beads whose crowns rise higher by their ripples."""
    section = _prepared(joint)
    if tack > 0:
        section = _with_bead(joint, section, WeldBead(level=tack), 0.0)
    for bead, ripple in zip(joint.beads, ripples, strict=False):
        section = _with_bead(joint, section, bead, ripple)
    return readonly_copy(section)


def _prepared(joint: HullJoint) -> Array:
    """Section before any welding; each plate is moved by half the high-low."""
    flank = _flank(joint)
    step = np.array((0.0, joint.high_low / 2))
    left, right = flank[::-1] * (-1, 1) - step, flank + step
    if joint.backing or joint.root_gap < 4 * FACE_LEAN:
        return np.vstack((left, right))
    inward = np.array((FACE_LEAN, -OPEN_DEPTH))
    return np.vstack((left, left[-1] + inward, right[0] + inward * (-1, 1), right))


def _flank(joint: HullJoint) -> Array:
    """The right plate from the bottom of its root face outward, without high-low, (n, 2)."""
    gap = max(joint.root_gap / 2, FACE_LEAN)
    nodes = [(gap, -joint.depth), (joint.width / 2, 0.0), (HALF_EXTENT, 0.0)]
    if joint.root_face > 0:
        nodes.insert(1, (gap + FACE_LEAN, joint.root_face - joint.depth))
    return np.array(nodes)


def _with_bead(joint: HullJoint, section: Array, bead: WeldBead, ripple: float) -> Array:
    """Lay a bead on a section: its toes lie on what is there, and it hides what it covers."""
    flank = _flank(joint)[:-1]
    half = np.interp(bead.level - joint.depth, flank[:, 1], flank[:, 0])
    share = np.linspace(-1.0, 1.0, BEAD_NODES)
    x = half * (bead.left + (bead.right - bead.left) * (share + 1) / 2)
    low, high = np.interp(x[[0, -1]], *section.T)
    face = low + (high - low) * (share + 1) / 2 + (bead.crown + ripple) * (1 - share**2)

    outside = (section[:, 0] < x[0]) | (section[:, 0] > x[-1])
    before = section[~outside]
    every = np.union1d(x, before[:, 0])
    above = np.interp(every, x, face) - np.interp(every, *section.T)
    cross = np.flatnonzero(above[:-1] * above[1:] < 0)
    share = above[cross] / (above[cross] - above[cross + 1])
    covers = face > np.interp(x, *section.T)
    covers[[0, -1]] = True
    seen = before[:, 1] > np.interp(before[:, 0], x, face)
    nodes = np.concatenate(
        (x[covers], before[seen, 0], every[cross] + share * (every[cross + 1] - every[cross]))
    )
    nodes = np.unique(nodes)
    height = np.maximum(np.interp(nodes, x, face), np.interp(nodes, *section.T))
    k = int(np.count_nonzero(section[:, 0] < x[0]))
    rest = section[outside]
    return np.vstack((rest[:k], np.column_stack((nodes, height)), rest[k:]))


def _tack_height(tack: HullTack, along: float) -> float:
    """Height of a tack at a place; its ends slope down at 45 degrees."""
    return min(tack.height, tack.length / 2 - abs(along - tack.at))


def _ripple(along: float, k: int) -> float:
    """Ripple along bead k at a place, of standard deviation one."""
    waves = (
        sin(2 * pi * along / length + 2.4 * k + i) for i, length in enumerate(RIPPLE_WAVELENGTHS)
    )
    return sum(waves) * sqrt(2 / len(RIPPLE_WAVELENGTHS))
