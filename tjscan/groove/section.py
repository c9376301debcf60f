"""The groove's section: five points, frame g, angles, width, depth and area, with their errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, copysign, hypot, nan
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, ArrayForm, FloatOrNan, PoseMatrix, frozen_arrays, unit_vector
from tjscan.groove.prior import SectionEvidence

PARALLEL_SINE: Final = 1e-3
"""Sine of the angle between wall and leg below which they span no frame."""

TACK_WELD: Final = "tack"
"""Condition of a section whose root is buried under a tack weld."""

FROM_NEIGHBOURS: Final = "corner by neighbours"
"""Condition of a section with a corner that contradicted its neighbours, and is given by them."""

NARROWEST_ROOT_WIDTH: Final = 1e-12
"""Metres: a narrower root has no direction."""

Pair = tuple[float, float] | list[float]
"""x and z in frame s, metres or of unit length."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class GrooveSection:
    """One section of a tubular T-joint's groove in the sensor frame s.

    The points run from the wall to the leg, whichever way the columns ran (paper, section 3.1):
    p1 end on the brace's wall, p2 top of the bevel, p3 root corner on the bevel, p4 root corner
    on the leg, p5 end on the leg; v1 = p2 - p1 … v4 = p5 - p4. Where wall or leg is curved, the
    lines along v1 and v4 are the tangents at p2 and at p4.

    Parameters
    ----------
    points_s : ndarray, shape (5, 3)
        p1 to p5 in metres, y = 0.
    wall_s, leg_s : ndarray, shape (3,)
        Unit vectors along v1 (tangent at p2) and v4 (tangent at p4).
    T_s_g : ndarray, shape (4, 4)
        Frame g: origin where the lines along v1 and v4 meet; x along v4 x v1, y along -v1.
    groove_angle : float
        Between -v2 and v4, in radians.
    gamma_1, gamma_2 : float
        Elevation of -v2 over z_g towards y_g, and depression of v4 below z_g, in radians.
    root_width : float
        Between p3 and p4, in metres.
    depth : float
        Distance of the middle of p3 and p4 behind the line along v1, in metres.
    area : float
        Between the origin of g, p2, p3 and p4, in square metres; over the root's face or a weld's
        surface, as far as these leave the line from p3 to p4.
    rms : float
        Of the distances between the points and the fitted sides, in metres.
    covariance_s : ndarray, shape (6, 6)
        Covariance of x and z of p2, p3 and p4, in m²; zero if nothing is known of it.
    tangent_covariance : ndarray, shape (2, 2)
        Covariance of the angles of `wall_s` and `leg_s` in the laser plane, in rad².
    measure_covariance : ndarray, shape (4, 4)
        Covariance of groove angle, root width, depth and area.
    model : str
        The form that explains the points best, such as ``tee`` or ``tee with two facets``.
    model_probability : float
        That the groove has this form, not another one of the same joint; NaN if it is not known.
    conditions : tuple of str
        What was found about the groove, such as ``tack``, ``open root`` or ``seam weld beside``.
    absent : tuple of str
        Corners, of ``p2``, ``p3`` and ``p4``, that are buried, not there or not seen. What is
        given for one is where it may be; its covariance states how far it may be from there.
    root_opening : float
        Distance of an open root's edge from the leg, in metres; NaN if the root is not open.
    evidence : SectionEvidence, optional
        What its profile shows, by itself, of what persists along the groove.
    """

    points_s: Annotated[Array, ArrayForm((5, 3))]
    wall_s: Array
    leg_s: Array
    T_s_g: PoseMatrix
    groove_angle: float
    gamma_1: float
    gamma_2: float
    root_width: float
    depth: float
    area: float
    rms: float
    covariance_s: Annotated[Array, ArrayForm((6, 6), may_be_unknown=True)]
    tangent_covariance: Annotated[Array, ArrayForm((2, 2), may_be_unknown=True)]
    measure_covariance: Annotated[Array, ArrayForm((4, 4), may_be_unknown=True)]
    model: str = "tee"
    model_probability: FloatOrNan = nan
    conditions: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    root_opening: FloatOrNan = nan
    evidence: SectionEvidence | None = None

    @property
    def work_angle(self) -> float:
        """Angle beta from z_g to the middle of the opening, in radians (paper, eq. 16)."""
        return 0.5 * (self.gamma_1 - self.gamma_2)  # (16)

    @property
    def on_tack(self) -> bool:
        """Whether a tack weld is over the root."""
        return TACK_WELD in self.conditions

    @property
    def corner_covariances_s(self) -> Array:
        """Covariances of p2, p3 and p4 in the x-z plane of s, shape (3, 2, 2), in m²."""
        return np.array([self.covariance_s[k : k + 2, k : k + 2] for k in (0, 2, 4)])

    @property
    def area_sigma(self) -> float:
        """Standard deviation of the area, in square metres."""
        return float(np.sqrt(self.measure_covariance[3, 3]))


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


def measure_groove(
    p2: Pair, p3: Pair, p4: Pair, wall: Pair, leg: Pair, surface: Array | None = None
) -> GrooveMeasures:
    """Measure a groove's section from its corners and the tangents of wall and leg.

    Parameters
    ----------
    p2, p3, p4 : pair of float
        Corners, metres.
    wall, leg : pair of float
        Unit tangents of the wall (down) and of the leg (out), not parallel.
    surface : ndarray, shape (m, 2), optional
        Points from p3 to p4 that bound the area there, instead of the line between these two.
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
    ux, uz = rx / max(width, NARROWEST_ROOT_WIDTH), rz / max(width, NARROWEST_ROOT_WIDTH)
    ax, az = qz - (lz * lever - wz * reach) / sine, -qx + (lx * lever - wx * reach) / sine
    by_wall = along * ((wz * bz + wx * bx) - lever * (wz * lz + wx * lx) / sine)
    by_leg = (lever / sine) * (along * (wx * lx + wz * lz) - (bx * lx + bz * lz))
    half = 0.5 * sign
    fx, fz, ex, ez = rx, rz, rx, rz  # from p3 to the surface's first point, from its last to p4
    if surface is not None and len(surface):
        x, z = (surface - p3).T
        double += float(x[:-1] @ z[1:] - z[:-1] @ x[1:]) + float(x[-1] * rz - z[-1] * rx)
        fx, fz, ex, ez = float(x[0]), float(z[0]), rx - float(x[-1]), rz - float(z[-1])
    jacobian = np.array(
        [
            (gx, gz, -gx, -gz, 0.0, 0.0, 0.0, -sign),
            (0.0, 0.0, -ux, -uz, ux, uz, 0.0, 0.0),
            (zx, zz, -0.5 * zx, -0.5 * zz, -0.5 * zx, -0.5 * zz, -sign * (mx * wx + mz * wz), 0.0),
            (
                *(-bz - ax, bx - az, bz + fz - rz, -bx - fx + rx),
                *(ax + ez - rz, az - ex + rx, by_wall, by_leg),
            ),
        ]
    )
    jacobian[3] *= half
    origin = (p2[0] + along * wx, p2[1] + along * wz)
    depth = mx * zx + mz * zz
    return GrooveMeasures(gamma_1, gamma_2, width, depth, half * double, origin, sign, jacobian)


def section_from_points(
    points_s: ArrayLike,
    *,
    wall_s: ArrayLike | None = None,
    leg_s: ArrayLike | None = None,
    rms: float = 0.0,
    covariance: ArrayLike | None = None,
    surface: Array | None = None,
) -> GrooveSection:
    """Build frame g and the measures of a groove from its five points.

    Parameters
    ----------
    points_s : array_like, shape (5, 3)
        p1 to p5 in frame s, in metres, y = 0.
    wall_s, leg_s : array_like, shape (3,), optional
        Tangents of the wall at p2 (downwards) and of the leg at p4 (outwards), where these
        sides are curved; v1 and v4 are used without them.
    rms : float
        Of the fit, in metres.
    covariance : array_like, shape (8, 8), optional
        Of x and z of p2, p3, p4 and of the angles of both tangents in the x-z plane.
    surface : ndarray, shape (m, 2), optional
        Points from p3 to p4, x and z, over which the area is measured.

    Raises
    ------
    ValueError
        If the points have another shape, lie off the plane y = 0 or are not finite.
    GrooveNotFound
        If the lines along v1 and v4 do not meet.
    """
    points = np.array(points_s, dtype=float)
    if points.shape != (5, 3) or not np.isfinite(points).all() or np.abs(points[:, 1]).max() > 1e-9:
        raise ValueError("a section needs five finite points, shape (5, 3), in the plane y = 0")
    v1 = points[1] - points[0] if wall_s is None else np.asarray(wall_s, dtype=float)
    v4 = points[4] - points[3] if leg_s is None else np.asarray(leg_s, dtype=float)
    wall, leg = unit_vector(v1[[0, 2]]), unit_vector(v4[[0, 2]])
    if abs(wall[0] * leg[1] - wall[1] * leg[0]) < PARALLEL_SINE:
        raise GrooveNotFound(
            "no bevel", "wall and leg are parallel, so they span no frame", points[:, [0, 2]]
        )
    p2, p3, p4 = points[1:4, [0, 2]].tolist()
    found = measure_groove(p2, p3, p4, wall.tolist(), leg.tolist(), surface)
    covariance = np.zeros((8, 8)) if covariance is None else np.asarray(covariance, dtype=float)
    (wx, wz), sign, (x, z) = wall.tolist(), found.sign, found.origin
    T = np.array(((0, -wx, -sign * wz, x), (sign, 0, 0, 0), (0, -wz, sign * wx, z), (0, 0, 0, 1.0)))
    return GrooveSection(
        *(points, np.array([wx, 0.0, wz]), np.array([leg[0], 0.0, leg[1]]), T),
        *(found.gamma_1 + found.gamma_2, found.gamma_1, found.gamma_2),
        *(found.width, found.depth, found.area, float(rms)),
        *(covariance[:6, :6], covariance[6:, 6:], found.jacobian @ covariance @ found.jacobian.T),
    )


def section_in_plane(
    points: Array,
    tangents: tuple[Pair, Pair],
    *,
    rms: float,
    covariance: Array,
    surface: Array | None = None,
    area_variance: float = 0.0,
    hollow: float = 0.0,
    **found: Any,
) -> GrooveSection:
    """Section of p1 to p5, x and z, shape (5, 2), and the tangents of wall and leg.

    Parameters
    ----------
    points, tangents
        Metres, and of unit length.
    rms, covariance, surface
        As `section_from_points` takes them.
    area_variance : float
        Of the area beyond what its corners explain, m⁴.
    hollow : float
        Area between the line from p3 to p4 and what bounds it, in m².
    **found
        What else the section holds.
    """
    in_space = np.zeros((5, 3))
    in_space[:, [0, 2]] = points
    wall, leg = ((x, 0.0, z) for x, z in tangents)
    section = section_from_points(
        in_space, wall_s=wall, leg_s=leg, rms=rms, covariance=covariance, surface=surface
    )
    of_measures = section.measure_covariance.copy()
    of_measures[3, 3] += area_variance
    area = section.area + hollow
    return replace(section, measure_covariance=of_measures, area=area, **found)
