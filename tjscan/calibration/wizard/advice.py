"""The pose for the next line: chosen one after the other, for all lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from tjscan.calibration.measuring_range import MeasuringRange
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeUncertainty
from tjscan.calibration.solve.design import (
    ReachabilityCheck,
    choose_most_informative,
    information_of_lines,
    predict_lines,
    uncertainty_of,
)
from tjscan.calibration.targets.plane import PlaneTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays, inverse_pose, unit_vector

EDGE_MARGIN: Final = 5e-3
"""Metres that a line keeps from the board's edges: the mount is not known exactly yet."""
MIN_LINE_LENGTH: Final = 0.04
"""Metres; a planned line is at least this long."""


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class BoardRectangle:
    """The rectangle of the plane that lines may be on, frame b.

    Parameters
    ----------
    centre_b : ndarray, shape (3,)
        Its middle, in metres.
    axes_b : ndarray, shape (2, 3)
        Unit vectors along its sides.
    half_sizes : ndarray, shape (2,)
        Half the lengths of its sides, in metres.
    """

    centre_b: Array
    axes_b: Array
    half_sizes: Array

    @classmethod
    def through_touched_points(cls, points_b: ArrayLike, target: PlaneTarget) -> BoardRectangle:
        """Smallest rectangle along the plane's axes that holds all touched points.

        Parameters
        ----------
        points_b : array_like, shape (n, 3)
            Touched points, frame b, metres.
        target : PlaneTarget
            The plane fitted through them.
        """
        across = (np.asarray(points_b, dtype=float) - target.centre_b) @ target.axes_b.T
        low, high = across.min(axis=0), across.max(axis=0)
        centre = target.centre_b + 0.5 * (low + high) @ target.axes_b
        return cls(centre, target.axes_b, 0.5 * (high - low))

    def contains_points(self, points_b: Array, margin: float = 0.0) -> Array:
        """Whether points, shape (..., 3), lie over the board and off its edges; NaN does not.

        Parameters
        ----------
        points_b : ndarray, shape (..., 3)
            Frame b, metres.
        margin : float
            Metres to keep from the edges.

        Returns
        -------
        ndarray of bool, shape (...)
        """
        across = np.abs((points_b - self.centre_b) @ self.axes_b.T)
        return np.asarray((across <= self.half_sizes - margin).all(axis=-1))


@dataclass(frozen=True, slots=True)
class CandidatePoseGrid:
    """Grid of sensor poses over the board from which the next one is chosen. Angles in radians.

    Parameters
    ----------
    tilts : tuple of float
        Between central ray and the board's normal. Wide tilts give most information;
        beyond some 60° of incidence shiny steel shows no line.
    azimuths : int
        Directions to tilt towards, evenly spaced.
    yaws : tuple of float
        Turns about the board's normal; 0 is the sensor's present turn.
    depths : tuple of float
        Distances of the board in the measuring range, 0 nearest, 1 farthest.
    places : tuple of float
        Points of the board that the central ray meets, as shares of its half sizes.
    """

    tilts: tuple[float, ...] = tuple(np.radians((0.0, 20.0, 40.0)))
    azimuths: int = 12
    yaws: tuple[float, ...] = tuple(np.radians((-90.0, -45.0, 0.0, 45.0, 90.0)))
    depths: tuple[float, ...] = (0.15, 0.5, 0.85)
    places: tuple[float, ...] = (-0.4, 0.0, 0.4)


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
class SuggestedPose:
    """The flange pose to take the next line from, and the uncertainty expected with and without it.

    Parameters
    ----------
    T_b_f : ndarray, shape (4, 4)
        Flange pose.
    before, after : HandEyeUncertainty
        Expected without and with that line.
    """

    T_b_f: Array
    before: HandEyeUncertainty
    after: HandEyeUncertainty


def candidate_poses(
    T_f_s: Array,
    target: PlaneTarget,
    board: BoardRectangle,
    window: MeasuringRange,
    grid: CandidatePoseGrid,
    x_b: ArrayLike | None = None,
) -> Array:
    """Flange poses, shape (n, 4, 4), whose whole laser line should fall on the board.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange, as far as it is known.
    target : PlaneTarget
        The plane; its normal points to the sensor's side.
    board : BoardRectangle
        Part of the plane that lines may be on.
    window : MeasuringRange
        The sensor's range.
    grid : CandidatePoseGrid
        What to try.
    x_b : array_like, shape (3,), optional
        Direction of x_s at yaw zero, best that of now; along the board's first side if left out.
    """
    u = target.plane.u
    x = board.axes_b[0] if x_b is None else np.asarray(x_b, dtype=float)
    x = unit_vector(x - (x @ u) * u)
    upright = np.column_stack((x, np.cross(-u, x), -u))  # z_s into the board
    turns = [
        Rotation.from_rotvec(yaw * u) * Rotation.from_rotvec(tilt * axis)
        for yaw, (tilt, axis) in product(grid.yaws, _tilt_axes(grid, x, np.cross(u, x)))
    ]
    R_b_s = np.stack([turn.as_matrix() for turn in turns]) @ upright
    foot = np.array(
        [
            board.centre_b + (np.array(place) * board.half_sizes) @ board.axes_b
            for place in product(grid.places, repeat=2)
        ]
    )
    depth = window.near + np.array(grid.depths) * (window.far - window.near)
    origin = foot[None, :, None] - depth[None, None, :, None] * R_b_s[:, None, None, :, 2]
    T_b_s = np.tile(np.eye(4), (*origin.shape[:3], 1, 1))
    T_b_s[..., :3, :3], T_b_s[..., :3, 3] = R_b_s[:, None, None], origin
    T_b_f = T_b_s.reshape(-1, 4, 4) @ inverse_pose(T_f_s)
    seen = predict_lines(T_b_f, T_f_s, target, window, NoiseModel())
    good = (seen.line_length >= MIN_LINE_LENGTH) & board.contains_points(
        seen.ends_b, EDGE_MARGIN
    ).all(axis=1)
    return np.asarray(T_b_f[good])


def _tilt_axes(grid: CandidatePoseGrid, x: Array, y: Array) -> list[tuple[float, Array]]:
    """Tilts and the axes in the board to tilt about; no tilt counts once."""
    azimuths = np.arange(grid.azimuths) * 2 * np.pi / grid.azimuths
    axes = [np.cos(a) * x + np.sin(a) * y for a in azimuths]
    return [(tilt, axis) for tilt in grid.tilts for axis in (axes if tilt else axes[:1])]


def suggest_pose(
    candidates: Sequence[Array],
    taken: Sequence[Array],
    T_f_s: Array,
    target: PlaneTarget,
    window: MeasuringRange,
    noise: NoiseModel,
    *,
    reachable: ReachabilityCheck | None = None,
) -> SuggestedPose:
    """Suggest the candidate pose whose line shrinks the uncertainty most.

    Parameters
    ----------
    candidates : sequence of ndarray, shape (4, 4)
        Flange poses to choose from, such as `candidate_poses` gives.
    taken : sequence of ndarray, shape (4, 4)
        Flange poses of the lines there are.
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange, as far as it is known.
    target : PlaneTarget
        The plane, touched or unknown.
    window : MeasuringRange
        The sensor's range.
    noise : NoiseModel
        Errors of lines and poses.
    reachable : callable, optional
        Whether the arm can take its flange to T_b_f without touching anything. It is called
        for the poses with most information, not for all.

    Raises
    ------
    CalibrationRefused
        If no candidate sees the plane within reach.
    """
    poses = np.reshape(np.array(candidates, dtype=float), (-1, 4, 4))
    so_far = np.reshape(np.array(taken, dtype=float), (-1, 4, 4))
    known = information_of_lines(so_far, T_f_s, target, window, noise)
    seen = predict_lines(poses, T_f_s, target, window, noise).information
    chosen = choose_most_informative(poses, seen, known, reachable)
    if chosen is None:
        raise CalibrationRefused(
            "no pose to suggest",
            f"none of {len(poses)} candidates sees the plane within reach; offer others",
        )
    return SuggestedPose(poses[chosen], uncertainty_of(known), uncertainty_of(known + seen[chosen]))
