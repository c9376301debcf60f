"""Views of the groove unrolled about the brace: ten numbers of each, each at its azimuth.

Corners are given by their distance from the brace's axis and their height over the leg, walls by
how far they lie off their tubes and how they tilt. In these coordinates a groove changes slowly
with the azimuth: between views 40 mm apart it can be interpolated to a micrometre, where nearest
points of such lines would be tenths of a millimetre wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core import pose_vector
from tjscan.core.errors import StitchingRefused
from tjscan.core.frames import Array, pose, readonly_copy, transform_points
from tjscan.joint.geometry import LegSurface
from tjscan.joint.tubes.frame import TubeDimensions
from tjscan.joint.tubes.walls import ArmRepeatability
from tjscan.scanning.section import ScannedSection
from tjscan.stitching.sides import side_nodes

VALUES: Final = 10
LEVER: Final = 0.02
"""Metres along a wall over which its tilt is given as an offset."""

CORNER_VALUES: Final = 6
"""The first values are those of p2, p3 and p4."""

WIDEST: Final = 0.999
"""Share of the leg's radius beyond which nothing lies over the leg."""


@dataclass(frozen=True, slots=True, eq=False)
class UnrolledViews:
    """Views of a station unrolled about the brace in its own frame j.

    Parameters
    ----------
    azimuth, value : ndarray, shape (n, 10)
        Radians, and metres: distance from the brace's axis and height over the leg of p2, p3 and
        p4; offset and tilt of the brace's wall, and of the leg's.
    by_pose : ndarray, shape (n, 10, 6)
        How each value changes, at its azimuth, with a motion of all points: translation and
        rotation vector in j.
    azimuth_by_pose : ndarray, shape (n, 10, 6)
        How its azimuth does.
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
    by_pose: Array
    azimuth_by_pose: Array
    covariance: Array
    place: Array
    middle: Array
    number: Array

    def __post_init__(self) -> None:
        for name in self.__slots__:
            object.__setattr__(self, name, readonly_copy(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.place)

    def select_views(self, which: NDArray[np.bool_]) -> UnrolledViews:
        """Select the views for which `which`, shape (n,), is true."""
        return UnrolledViews(*(getattr(self, name)[which] for name in self.__slots__))

    def joined_with(self, other: UnrolledViews) -> UnrolledViews:
        """These views together with those of another station."""
        names = self.__slots__
        return UnrolledViews(
            *(np.concatenate((getattr(self, n), getattr(other, n))) for n in names)
        )


def unroll_views(
    sections: Sequence[ScannedSection],
    T_j_b: Array,
    shape: TubeDimensions,
    repeatability: ArmRepeatability,
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
    unrolled = [_unroll(section, T_j_b, shape, repeatability) for section in sections]
    rows = [(*row, float(k)) for k, row in enumerate(unrolled) if row is not None]
    if not rows:
        raise StitchingRefused("too little seen", "no view of a station shows both walls")
    return UnrolledViews(*(np.array(column) for column in zip(*rows, strict=True)))


def _unroll(
    section: ScannedSection, T_j_b: Array, shape: TubeDimensions, repeatability: ArmRepeatability
) -> tuple[Array, Array, Array, Array, Array, float, Array] | None:
    """The attributes of `UnrolledViews` but the number; None where a wall shows too little."""
    sides = side_nodes(section)
    if min(len(sigma) for _, sigma in sides) < 2:
        return None
    (brace, brace_sigma), (leg, leg_sigma) = sides
    T_j_s = T_j_b @ section.view.T_b_s
    points = transform_points(T_j_s, np.concatenate((section.groove.points_s[1:4], brace, leg)))
    split = (3, 3 + len(brace))
    step = 1e-6  # deep in the linear range
    moves = np.array(
        [np.eye(4)]
        + [
            pose_vector.pose_from_vector(sign * step * np.eye(6)[k])
            for sign in (1, -1)
            for k in range(6)
        ]
    )
    moved = points @ np.swapaxes(moves[:, :3, :3], 1, 2) + moves[:, None, :3, 3]
    azimuth, value, walls = _unrolled(moved, split, shape)
    by_pose = (value[1:7] - value[7:]).T / (2 * step)
    slope = (azimuth[1:7] - azimuth[7:]).T / (2 * step)

    # The arm's error turns the view about its flange.
    lever = transform_points(T_j_b, section.view.T_b_f[:3, 3])
    arm = by_pose @ pose_vector.adjoint(pose(p=lever))
    covariance = arm @ repeatability.covariance @ arm.T
    covariance[:6, :6] += _corner_covariance(section, T_j_s, points[:3], shape)
    for at, response, sigma in ((6, walls[0], brace_sigma), (8, walls[1], leg_sigma)):
        covariance[at : at + 2, at : at + 2] += (response * sigma**2) @ response.T
    place = float(azimuth[0, 2])
    middle = points[1:3].mean(axis=0)
    return azimuth[0], value[0], by_pose, slope, covariance, place, middle


def _unrolled(
    points: Array, split: tuple[int, int], shape: TubeDimensions
) -> tuple[Array, Array, tuple[Array, Array]]:
    """Azimuths and values, each (k, 10), of k poses of a view's points (k, m, 3).

    Also how offset and tilt of each wall answer to its nodes, (2, nodes) each.
    """
    surface = LegSurface(shape.leg_radius, shape.angle)
    x, y = points[..., 0], points[..., 1]
    phi, rho = np.arctan2(y, x), np.hypot(x, y)
    phi = phi[0, 2] + np.angle(np.exp(1j * (phi - phi[0, 2])))  # no jump within a view
    reach = WIDEST * shape.leg_radius
    height = points[..., 2] - surface.height(phi, np.minimum(rho, reach))
    k = len(points)
    value, azimuth = np.empty((k, VALUES)), np.empty((k, VALUES))
    value[:, :CORNER_VALUES] = np.stack((rho[:, :3], height[:, :3]), axis=2).reshape(k, -1)
    azimuth[:, :CORNER_VALUES] = np.repeat(phi[:, :3], 2, axis=1)
    on_brace, on_leg = slice(split[0], split[1]), slice(split[1], None)
    walls = []
    for column, (chosen, off, along) in (
        (6, (on_brace, rho[:, on_brace] - shape.brace_radius, height[0, on_brace])),
        (8, (on_leg, surface.signed_distances(points[:, on_leg]), rho[0, on_leg])),
    ):
        centred = along - along.mean()
        response = np.stack(
            (np.full(len(centred), 1 / len(centred)), LEVER * centred / (centred @ centred))
        )
        value[:, column : column + 2] = off @ response.T
        azimuth[:, column : column + 2] = phi[:, chosen].mean(axis=1)[:, None]
        walls.append(response)
    return azimuth, value, (walls[0], walls[1])


def _corner_covariance(
    section: ScannedSection, T_j_s: Array, corners: Array, shape: TubeDimensions
) -> Array:
    """Covariance of the corners' six values that the laser's noise makes, shape (6, 6)."""
    surface = LegSurface(shape.leg_radius, shape.angle)
    phi, rho = np.arctan2(corners[:, 1], corners[:, 0]), np.hypot(corners[:, 0], corners[:, 1])
    rho = np.minimum(rho, WIDEST * shape.leg_radius)
    out = np.column_stack((np.cos(phi), np.sin(phi), np.zeros(3)))
    side = np.column_stack((-np.sin(phi), np.cos(phi), np.zeros(3)))
    climb = surface.azimuth_derivative(phi, rho)[:, 2] / rho
    up = np.array((0.0, 0.0, 1.0)) - surface.slope(phi, rho)[:, None] * out - climb[:, None] * side
    gradient = np.stack((out, up), axis=1) @ T_j_s[:3, [0, 2]]  # (3, 2, 2)
    spread = np.zeros((6, 6))
    for i in range(3):
        spread[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = gradient[i]
    return spread @ section.groove.covariance_s @ spread.T
