"""How the torch is held at a bead, and in which position that is welding."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.frames import Array, cross
from tjscan.planning.template import BeadCells

POSITION_NAMES: Final = np.array(("PA", "PB", "PC", "PD", "PE"))
"""Principal positions, 45° of rotation from one to the next."""

STEEP_SLOPE: Final = np.radians(45.0)
"""Slope from which a bead counts as welded upwards (PF) or downwards (PG)."""


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
        low = np.max([_angle(v) for v in bevel], axis=0)
        high = np.min([_angle(v) for v in leg], axis=0)
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
    x, z = travel, np.sum(outward * travel, axis=1, keepdims=True) * travel - outward
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
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


def position_names(slope: Array, rotation: Array) -> tuple[str, ...]:
    """Nearest principal position of ISO 6947 for each slope and rotation, shape (m,), radians.

    PF upwards and PG downwards from 45° of slope on; else by rotation from PA, the face up, by PC,
    the face sideways, to PE, overhead. The standard's own limits about each position were not at
    hand.
    """
    turned = np.rint((0.5 * np.pi - rotation) / np.radians(45)).astype(int)
    names = POSITION_NAMES[np.clip(turned, 0, len(POSITION_NAMES) - 1)]
    steep = np.where(slope > 0, "PF", "PG")
    return tuple(np.where(np.abs(slope) > STEEP_SLOPE, steep, names).tolist())


def _angle(v: Array) -> Array:
    return np.asarray(np.arctan2(v[:, 0], v[:, 1]))
