"""Corners of grooves in a plane: p3, p4, g, p2; x from bevel to leg, y out of the root."""

from __future__ import annotations

from math import cos, radians, sin, tan

import numpy as np

from tjscan.core.frames import Array


def half_v(thickness: float = 25.4e-3, angle: float = 50.0, gap: float = 6e-3) -> Array:
    """A half-V groove, shape (4, 2), metres: the bevel leans, the other side is upright."""
    lean = thickness * tan(radians(angle))
    return np.array([(0.0, 0.0), (gap, 0.0), (gap, thickness), (-lean, thickness)])


def sheared_groove(root: float, depth: float, opening: float, slope: float, tilt: float) -> Array:
    """A groove such as a tube's, shape (4, 2): sides of an angle, root and opening aslant."""
    half = 0.5 * opening
    p3, p4 = np.array((0.0, 0.0)), root * np.array((cos(tilt), sin(tilt)))
    p2 = p3 + depth / cos(half + 0.3 * slope) * np.array((-sin(half), cos(half)))
    g = p4 + depth * (1 + 0.5 * slope) * np.array((sin(half), cos(half)))
    return np.array([p3, p4, g, p2])
