"""Views of the groove unrolled about the brace: ten numbers of each, each at its azimuth.

Corners are given by their distance from the brace's axis and their height over the leg, walls by
how far they are off their tubes and how they tilt. In these coordinates a groove changes slowly
with the azimuth: between views 40 mm apart it can be interpolated to a micrometre, where nearest
points of such lines would be tenths of a millimetre wrong.

The walls are represented by a few points of each profile that lie on the brace and on the leg.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Final

import numpy as np
from numpy.polynomial import Polynomial

from tjscan.core import pose_vector
from tjscan.core.errors import StitchingRefused
from tjscan.core.frames import Array, Mask, array_dataclass, pose, transform_points
from tjscan.joint.geometry import LegSurface
from tjscan.joint.tubes.fit import ArmRepeatability, TubeDimensions, WallPoints
from tjscan.scanning.section import ScannedSection, Sections
from tjscan.uncertainty.budget import points_moved_by_twist
from tjscan.uncertainty.causes import ViewCause

NODES_PER_SIDE: Final = 4
"""Per side: enough for its place and its tilt, which is all that a view's side shows."""

SIDE_TO_CORNER_GAP: Final = 1e-3
"""Metres that a side's points keep from its corner, where edges are never quite sharp."""

LARGEST_DISTANCE_OFF_SIDE: Final = 0.2e-3
"""Metres off the fitted side beyond which a point is a reflection or flies."""

LARGEST_DISTANCE_OFF_PARABOLA: Final = 1e-3
"""The same off a parabola from the corner to the side's end, which a side follows roughly."""

SIDE_POLYNOMIAL_DEGREE: Final = 4
"""Of the polynomial that a side is: a cut through a tube, a few centimetres long."""

BINS_PER_SIDE: Final = 8
FEWEST_POINTS: Final = 5
"""Points that a bin or a node needs."""

LEAST_POINT_SIGMA: Final = 1e-6
"""Metres that no point is taken for more certain than."""

CORRELATED_POINTS: Final = 8
"""Neighbouring points whose noise is alike: an assumption about speckle on ground steel."""


def wall_points_of_views(sections: Sections) -> WallPoints:
    """Points on the walls of brace and leg as all views of a station saw them.

    Parameters
    ----------
    sections : sequence of ScannedSection
        One for each view of the station.

    Returns
    -------
    WallPoints
        In the station's base frame.
    """
    sides = []
    for number, section in enumerate(sections):
        for is_brace, (nodes_s, sigma) in zip((True, False), side_nodes(section), strict=True):
            nodes_b, n = transform_points(section.view.T_b_s, nodes_s), len(sigma)
            sides.append((nodes_b, np.full(n, is_brace), sigma, np.full(n, number)))
    pivots = np.array([section.view.T_b_f[:3, 3] for section in sections])
    points, on_brace, sigma, view = (np.concatenate(column) for column in zip(*sides, strict=True))
    return WallPoints(points, on_brace, sigma, view, pivots)


def moves_of_wall_points(walls: WallPoints, sections: Sections, cause: ViewCause) -> Array:
    """How wall points move with a cause of error, in the station's base frame.

    Parameters
    ----------
    walls : WallPoints
        As `wall_points_of_views` gives them.
    sections : sequence of ScannedSection
        That they were seen in.
    cause : ViewCause
        Of these views.

    Returns
    -------
    ndarray, shape (n, 3, m)
        Metres, by each draw of the cause.
    """
    T_b_s = np.array([section.view.T_b_s for section in sections])[walls.view]
    in_s = np.einsum("kji,kj->ki", T_b_s[:, :3, :3], walls.points - T_b_s[:, :3, 3])
    along = np.gradient(in_s.reshape(-1, NODES_PER_SIDE, 3), axis=1, edge_order=2).reshape(-1, 3)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return cause.moves_of_points(walls.view, T_b_s, in_s, along)


def side_nodes(section: ScannedSection) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Mean points (nodes) along the brace's and the leg's side of a profile.

    A node is the average of the points about it, taken along the curve that the side follows.

    Parameters
    ----------
    section : ScannedSection
        A view, and the groove that was read in it: its sides begin at p2 and p4 and end at p1
        and p5.

    Returns
    -------
    brace, leg : tuple of ndarray, shapes (n, 3) and (n,)
        Nodes in frame s (metres) and the standard deviation of each across its side (metres).
        Both are empty if a side has too few points; else n is `NODES_PER_SIDE`.
    """
    groove = section.groove
    p1, p2, _, p4, p5 = groove.points_s[:, [0, 2]]
    points = section.view.profile.points_s[:, [0, 2]]
    return (
        _nodes_of_side(points, p2, -groove.wall_s[[0, 2]], p1),
        _nodes_of_side(points, p4, groove.leg_s[[0, 2]], p5),
    )


def _nodes_of_side(points: Array, corner: Array, tangent: Array, end: Array) -> tuple[Array, Array]:
    """Nodes along a side that leaves its corner along a tangent and bends to its end."""
    normal = np.array((-tangent[1], tangent[0]))
    length, off = (end - corner) @ tangent, (end - corner) @ normal
    s, d = (points - corner) @ tangent, (points - corner) @ normal
    on = (
        (s > SIDE_TO_CORNER_GAP)
        & (s <= length)
        & (np.abs(d - off * (s / length) ** 2) < LARGEST_DISTANCE_OFF_PARABOLA)
    )
    s, d = s[on], d[on]
    bins = (BINS_PER_SIDE * (s - SIDE_TO_CORNER_GAP) / (length - SIDE_TO_CORNER_GAP)).astype(int)
    share = np.minimum(bins, BINS_PER_SIDE - 1)
    filled = [chosen for k in range(BINS_PER_SIDE) if (chosen := share == k).sum() >= FEWEST_POINTS]
    if len(filled) <= SIDE_POLYNOMIAL_DEGREE + 1:
        return np.empty((0, 3)), np.empty(0)
    # Medians first: they take no notice of reflections. Then all points beside their curve.
    medians = np.array([(np.median(s[k]), np.median(d[k])) for k in filled])
    rough = _side_curve(medians[:, 0], medians[:, 1], float(length))
    on = np.abs(d - rough(s)) < LARGEST_DISTANCE_OFF_SIDE
    s, d, share = s[on], d[on], share[on] * NODES_PER_SIDE // BINS_PER_SIDE
    count = np.bincount(share, minlength=NODES_PER_SIDE)
    if (count < FEWEST_POINTS).any():
        return np.empty((0, 3)), np.empty(0)
    curve = _side_curve(s, d, float(length))
    # Averaged along the curve, not across it: the mean of a bent line is beside it.
    at = np.bincount(share, s, NODES_PER_SIDE) / count
    height = curve(at) + np.bincount(share, d - curve(s), NODES_PER_SIDE) / count
    noise = max(float(np.std(d - curve(s))), LEAST_POINT_SIGMA)
    nodes = corner + at[:, None] * tangent + height[:, None] * normal
    in_s = np.column_stack((nodes[:, 0], np.zeros(NODES_PER_SIDE), nodes[:, 1]))
    return in_s, noise * np.sqrt(np.minimum(CORRELATED_POINTS / count, 1.0))


def _side_curve(s: Array, d: Array, length: float) -> Polynomial:
    """Least-squares polynomial of heights along a side."""
    return Polynomial.fit(s, d, SIDE_POLYNOMIAL_DEGREE, domain=(0.0, length))


VALUES_PER_VIEW: Final = 10
TILT_LEVER: Final = 0.02
"""Metres along a wall over which its tilt is given as an offset."""

CORNER_VALUES_PER_VIEW: Final = 6
"""The first values are of p2, p3 and p4."""

WIDEST_LEG_SHARE: Final = 0.999
"""Share of the leg's radius beyond which nothing is over the leg."""


@array_dataclass
class UnrolledViews:
    """Views of a station unrolled about the brace in its own frame j.

    Parameters
    ----------
    azimuth, value : ndarray, shape (n, 10)
        Radians, and metres: distance from the brace's axis and height over the leg of p2, p3 and
        p4; offset and tilt of the brace's wall, and of the leg's.
    points : ndarray, shape (n, k, 3)
        What values are made of: p2, p3 and p4, then the nodes of the brace's wall and of the
        leg's, in j, metres.
    by_points, azimuth_by_points : ndarray, shape (n, 10, k, 3)
        How each value, at its azimuth, and this azimuth change as each of these points moves.
    covariance : ndarray, shape (n, 10, 10)
        Of the values: the arm's error, common to all of a view, and the laser's.
    place : ndarray, shape (n,)
        Azimuth of the view as a whole.
    middle : ndarray, shape (n, 3)
        Its root, in j.
    number : ndarray, shape (n,)
        Which of the station's views it is.
    """

    azimuth: Array
    value: Array
    points: Array
    by_points: Array
    azimuth_by_points: Array
    covariance: Array
    place: Array
    middle: Array
    number: Array

    @property
    def by_pose(self) -> Array:
        """How each value changes with a motion of all points, shape (n, 10, 6).

        Translation and rotation vector in j.
        """
        return _change_with_motion(self.by_points, self.points)

    @property
    def azimuth_by_pose(self) -> Array:
        """How its azimuth does, shape (n, 10, 6)."""
        return _change_with_motion(self.azimuth_by_points, self.points)

    def __len__(self) -> int:
        return len(self.place)

    def select_views(self, which: Mask) -> UnrolledViews:
        """Select the views for which `which`, shape (n,), is true."""
        return UnrolledViews(*(getattr(self, field.name)[which] for field in fields(self)))

    def joined_with(self, other: UnrolledViews) -> UnrolledViews:
        """These views together with another station's."""
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return UnrolledViews(*(np.concatenate(pair) for pair in pairs))


def unroll_views(
    sections: Sections, T_j_b: Array, shape: TubeDimensions, repeatability: ArmRepeatability
) -> UnrolledViews:
    """Unroll the sections read in views; those with too little of a wall are left out.

    Parameters
    ----------
    sections : sequence of ScannedSection
        Of all views of one station.
    T_j_b : ndarray, shape (4, 4)
        Its base in frame j.
    shape : TubeDimensions
        The tubes to unroll about.
    repeatability : ArmRepeatability
        Of its arm.

    Raises
    ------
    StitchingRefused
        If no view shows both walls.
    """
    unrolled = [_unroll_view(section, T_j_b, shape, repeatability) for section in sections]
    rows = [(*row, float(k)) for k, row in enumerate(unrolled) if row is not None]
    if not rows:
        raise StitchingRefused("too little seen", "no view of a station shows both walls")
    return UnrolledViews(*(np.array(column) for column in zip(*rows, strict=True)))


def _unroll_view(
    section: ScannedSection, T_j_b: Array, shape: TubeDimensions, repeatability: ArmRepeatability
) -> tuple[Array, Array, Array, Array, Array, Array, float, Array] | None:
    """The attributes of `UnrolledViews` but the number; None if a wall shows too little."""
    sides = side_nodes(section)
    if min(len(sigma) for _, sigma in sides) < 2:
        return None
    (brace, brace_sigma), (leg, leg_sigma) = sides
    T_j_s = T_j_b @ section.view.T_b_s
    points = transform_points(T_j_s, np.concatenate((section.groove.points_s[1:4], brace, leg)))
    azimuth, value, azimuth_by_points, by_points, walls = _unroll_points(points, len(brace), shape)

    # The arm's error turns the view about its flange.
    lever = transform_points(T_j_b, section.view.T_b_f[:3, 3])
    arm = _change_with_motion(by_points, points) @ pose_vector.adjoint(pose(p=lever))
    covariance = arm @ repeatability.covariance @ arm.T
    covariance[:6, :6] += _corner_covariance(section, T_j_s, points[:3], shape)
    for at, response, sigma in ((6, walls[0], brace_sigma), (8, walls[1], leg_sigma)):
        covariance[at : at + 2, at : at + 2] += (response * sigma**2) @ response.T
    place = float(azimuth[2])
    middle = points[1:3].mean(axis=0)
    return azimuth, value, points, by_points, azimuth_by_points, covariance, place, middle


def _change_with_motion(by_points: Array, points: Array) -> Array:
    """Change with a motion of all points (..., k, 3), of what changes by (..., 10, k, 3)."""
    moved = points_moved_by_twist(points, np.eye(6))
    return np.asarray(np.einsum("...vki,...kij->...vj", by_points, moved))


def _unroll_points(
    points: Array, on_brace: int, shape: TubeDimensions
) -> tuple[Array, Array, Array, Array, tuple[Array, Array]]:
    """Azimuths and values (10,) of a view's points (k, 3), and how both change with these.

    The first three are corners, then come those on the brace, then those on the leg. Changes have
    shape (10, k, 3). Also how offset and tilt of each wall answer to its nodes, (2, nodes) each.
    """
    surface = LegSurface(shape.leg_radius, shape.angle)
    step = 1e-6  # deep in the linear range
    shifts = step * np.concatenate((np.zeros((1, 3)), np.eye(3), -np.eye(3)))
    shifted = points + shifts[:, None]
    x, y, z = np.moveaxis(shifted, -1, 0)
    phi, rho = np.arctan2(y, x), np.hypot(x, y)
    phi = phi[0, 2] + np.angle(np.exp(1j * (phi - phi[0, 2])))  # no jump within a view
    height = z - surface.height(phi, np.minimum(rho, WIDEST_LEG_SHARE * shape.leg_radius))
    off_brace = rho[:, : 3 + on_brace] - shape.brace_radius
    off_leg = surface.signed_distances(shifted[:, 3 + on_brace :])
    off = np.concatenate((off_brace, off_leg), axis=1)
    # What values and azimuths add up of each point: (10, k) by distance, height and azimuth.
    k = len(points)
    by_off, by_height, by_phi = np.zeros((3, VALUES_PER_VIEW, k))
    for i in range(3):
        by_off[2 * i, i] = by_height[2 * i + 1, i] = 1.0
        by_phi[2 * i : 2 * i + 2, i] = 1.0
    walls = []
    for row, chosen, along in (
        (6, slice(3, 3 + on_brace), height[0]),
        (8, slice(3 + on_brace, k), rho[0]),
    ):
        centred = along[chosen] - along[chosen].mean()
        tilt = TILT_LEVER * centred / (centred @ centred)
        response = np.stack((np.full(len(centred), 1 / len(centred)), tilt))
        by_off[row : row + 2, chosen] = response
        by_phi[row : row + 2, chosen] = 1 / len(centred)
        walls.append(response)

    def gradient(of: Array) -> Array:
        return np.asarray((of[1:4] - of[4:]).T / (2 * step))  # (k, 3)

    value = by_off @ off[0] + by_height @ height[0]
    value[0:CORNER_VALUES_PER_VIEW:2] += shape.brace_radius  # counted from the axis
    by_points = by_off[..., None] * gradient(off) + by_height[..., None] * gradient(height)
    azimuth_by_points = by_phi[..., None] * gradient(phi)
    return by_phi @ phi[0], value, azimuth_by_points, by_points, (walls[0], walls[1])


def _corner_covariance(
    section: ScannedSection, T_j_s: Array, corners: Array, shape: TubeDimensions
) -> Array:
    """Covariance of the corners' six values that the laser's noise makes, shape (6, 6)."""
    surface = LegSurface(shape.leg_radius, shape.angle)
    phi, rho = np.arctan2(corners[:, 1], corners[:, 0]), np.hypot(corners[:, 0], corners[:, 1])
    rho = np.minimum(rho, WIDEST_LEG_SHARE * shape.leg_radius)
    out = np.column_stack((np.cos(phi), np.sin(phi), np.zeros(3)))
    side = np.column_stack((-np.sin(phi), np.cos(phi), np.zeros(3)))
    climb = surface.azimuth_derivative(phi, rho)[:, 2] / rho
    up = np.array((0.0, 0.0, 1.0)) - surface.slope(phi, rho)[:, None] * out - climb[:, None] * side
    gradient = np.stack((out, up), axis=1) @ T_j_s[:3, [0, 2]]  # (3, 2, 2)
    spread = np.zeros((6, 6))
    for i in range(3):
        spread[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = gradient[i]
    return spread @ section.groove.covariance_s @ spread.T
