"""Opening, width, depth and area of a groove from its corners, and how they change with them."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, copysign, hypot
from typing import Final

import numpy as np

from tjscan.core.frames import Array

LEAST_ROOT: Final = 1e-12
"""Metres: a narrower root has no direction."""

Pair = tuple[float, float] | list[float]
"""x and z in frame s, metres or of unit length."""


@dataclass(frozen=True, slots=True, eq=False)
class GrooveMeasures:
    """Measures of a groove's section: angles, root width, depth, area and their derivatives.

    Parameters
    ----------
    gamma_1, gamma_2 : float
        As `GrooveSection` has them; the groove angle is their sum.
    width, depth : float
        In metres.
    area : float
        In square metres.
    origin : tuple of float
        Of frame g: x and z in frame s, metres.
    sign : float
        1 or -1: y component of v4 x v1.
    jacobian : ndarray, shape (4, 8)
        Derivatives of opening, width, depth and area by x and z of p2, p3, p4 and by the angles
        of wall and leg in the x-z plane.
    """

    gamma_1: float
    gamma_2: float
    width: float
    depth: float
    area: float
    origin: tuple[float, float]
    sign: float
    jacobian: Array


def measure_groove(p2: Pair, p3: Pair, p4: Pair, wall: Pair, leg: Pair) -> GrooveMeasures:
    """Measure a groove's section from its corners and the tangents of wall and leg.

    Parameters
    ----------
    p2, p3, p4 : pair of float
        Corners, metres.
    wall, leg : pair of float
        Unit tangents of the wall (down) and of the leg (out), not parallel.
    """
    (wx, wz), (lx, lz) = wall, leg
    qx, qz = p2[0] - p3[0], p2[1] - p3[1]  # up the bevel
    bx, bz = p4[0] - p2[0], p4[1] - p2[1]  # across the opening
    rx, rz = p4[0] - p3[0], p4[1] - p3[1]  # along the root
    sine = wx * lz - wz * lx
    sign = copysign(1.0, sine)
    zx, zz = -sign * wz, sign * wx  # z_g, square to the wall, on the side that v4 points to

    up, out = -(qx * wx + qz * wz), qx * zx + qz * zz
    square = qx * qx + qz * qz
    gamma_1 = atan2(up, out)
    gamma_2 = atan2(lx * wx + lz * wz, lx * zx + lz * zz)
    width = hypot(rx, rz)
    mx, mz = 0.5 * (qx - bx), 0.5 * (qz - bz)  # from the middle of the root to p2

    # The origin, where the lines along wall and leg meet, is p2 + along wall; the quadrilateral's
    # diagonals run from it to p3 and from p2 to p4.
    reach, lever = bx * lz - bz * lx, wx * bz - wz * bx
    along = reach / sine
    double = qz * bx - qx * bz - along * lever

    # Derivatives, of the area twice over and without its sign.
    gx, gz = (-wx * out - zx * up) / square, (-wz * out - zz * up) / square
    ux, uz = rx / max(width, LEAST_ROOT), rz / max(width, LEAST_ROOT)
    ax, az = qz - (lz * lever - wz * reach) / sine, -qx + (lx * lever - wx * reach) / sine
    by_wall = along * ((wz * bz + wx * bx) - lever * (wz * lz + wx * lx) / sine)
    by_leg = (lever / sine) * (along * (wx * lx + wz * lz) - (bx * lx + bz * lz))
    half = copysign(0.5, double)
    jacobian = np.array(
        [
            (gx, gz, -gx, -gz, 0.0, 0.0, 0.0, -sign),
            (0.0, 0.0, -ux, -uz, ux, uz, 0.0, 0.0),
            (zx, zz, -0.5 * zx, -0.5 * zz, -0.5 * zx, -0.5 * zz, -sign * (mx * wx + mz * wz), 0.0),
            (-bz - ax, bx - az, bz, -bx, ax, az, by_wall, by_leg),
        ]
    )
    jacobian[3] *= half
    origin = (p2[0] + along * wx, p2[1] + along * wz)
    depth = mx * zx + mz * zz
    return GrooveMeasures(gamma_1, gamma_2, width, depth, half * double, origin, sign, jacobian)
