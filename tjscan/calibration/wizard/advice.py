"""The pose for the next line: the one that reduces the sensor's uncertainty most (D-optimal)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from tjscan.calibration.measuring_range import MeasuringRange, visible_lines_on_plane
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeUncertainty
from tjscan.calibration.solve.refine import covariance_from_information
from tjscan.calibration.targets.line import LineBundle
from tjscan.calibration.targets.plane import PlaneModel, PlaneTarget
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, frozen_arrays, inverse_pose, unit_vector

EDGE_MARGIN: Final = 5e-3
"""Metres that a line keeps from the board's edges: the mount is not known exactly yet."""
MIN_LINE_LENGTH: Final = 0.04
"""Metres; a planned line is at least this long."""
ReachabilityCheck = Callable[[Array], bool]
"""Whether the flange can be taken to T_b_f, shape (4, 4), without touching anything."""

PRIOR_SIGMA_POSITION: Final = 0.05
PRIOR_SIGMA_ROTATION: Final = float(np.radians(10.0))
"""How well the sensor's place is known before any line: metres and radians, as for a drawing of
the bracket. An assumption; it only keeps the first choices finite."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictedLines:
    """Lines expected from n poses, and their information, before they are taken.

    Parameters
    ----------
    information : ndarray, shape (n, 9, 9)
        About T_f_s (translation, rotation in the axes of f) and the plane (tilt, tilt, height).
        Zero if the board is out of the window.
    ends_b : ndarray, shape (n, 2, 3)
        Ends of the line on the plane, frame b; NaN if the board is out of the window.
    line_length : ndarray, shape (n,)
        Its length, in metres.
    """

    information: Array
    ends_b: Array
    line_length: Array


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

    def tilt_axes(self, x: Array, y: Array) -> list[tuple[float, Array]]:
        """Tilts and the axes to tilt about, in the plane of x and y; no tilt counts once."""
        azimuths = np.arange(self.azimuths) * 2 * np.pi / self.azimuths
        axes = [np.cos(a) * x + np.sin(a) * y for a in azimuths]
        return [(tilt, axis) for tilt in self.tilts for axis in (axes if tilt else axes[:1])]


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


@dataclass(frozen=True, slots=True, eq=False)
class LinePrediction:
    """Predicts the lines that a sensor would take of a plane, and their information about it.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        The sensor on the flange, as far as it is known.
    target : PlaneTarget
        The plane, touched or unknown; its normal points to the sensor's side.
    window : MeasuringRange
        The laser's measuring range.
    noise : NoiseModel
        Errors of points and poses.
    """

    T_f_s: Array
    target: PlaneTarget
    window: MeasuringRange
    noise: NoiseModel

    def lines(self, T_b_f: Array) -> PredictedLines:
        """Lines from flange poses, shape (n, 4, 4), and their information."""
        target, noise, T_b_s = self.target, self.noise, T_b_f @ self.T_f_s
        u_s = target.plane.u @ T_b_s[:, :3, :3]
        u0_s = T_b_s[:, :3, 3] @ target.plane.u + target.plane.u0
        seen = visible_lines_on_plane(self.window, u_s, u0_s)
        there = seen.span > 0
        ends_s = np.where(there[:, None, None], seen.ends_s, np.array(((-1.0, 0, 0), (1.0, 0, 0))))
        along = ends_s[:, 1] - ends_s[:, 0]
        direction = along / np.linalg.norm(along, axis=1, keepdims=True)
        count = np.maximum(seen.columns, 2)
        # Points evenly spread over a length have a variance of a twelfth of its square.
        sigma = (
            np.sqrt(noise.mean_variance_inflation / count) * noise.range * np.abs(direction[:, 0])
        )
        sigma_angle = sigma * np.sqrt(12) / np.where(there, seen.span, 1.0)
        lines = LineBundle(
            T_b_f[:, :3, :3], T_b_f[:, :3, 3], ends_s.mean(axis=1), direction, sigma, sigma_angle
        )
        found = PlaneModel(lines, target, noise).linearise(self.T_f_s, np.zeros(3))
        J = np.concatenate((found.by_pose, found.by_target), axis=2)
        information = J.transpose(0, 2, 1) @ np.linalg.solve(found.covariance, J)
        ends_b = np.einsum("nij,nkj->nki", T_b_s[:, :3, :3], seen.ends_s) + T_b_s[:, None, :3, 3]
        return PredictedLines(np.where(there[:, None, None], information, 0.0), ends_b, seen.span)

    def uncertainty(self, T_b_f: Array) -> HandEyeUncertainty:
        """Predict how far a calibration with lines from these poses would be off.

        It falls with every pose, also before there are enough of them to solve.

        Parameters
        ----------
        T_b_f : ndarray, shape (n, 4, 4)
            Flange poses, n ≥ 0.
        """
        return _uncertainty_left(self._information(T_b_f))

    def candidate_poses(
        self, board: BoardRectangle, grid: CandidatePoseGrid, x_b: ArrayLike | None = None
    ) -> Array:
        """Flange poses, shape (n, 4, 4), whose whole laser line should fall on the board.

        Parameters
        ----------
        board : BoardRectangle
            Part of the plane that lines may be on.
        grid : CandidatePoseGrid
            What to try.
        x_b : array_like, shape (3,), optional
            Direction of x_s at yaw zero, best the present one; along the board's first side if left
            out.
        """
        u = self.target.plane.u
        x = board.axes_b[0] if x_b is None else np.asarray(x_b, dtype=float)
        x = unit_vector(x - (x @ u) * u)
        upright = np.column_stack((x, np.cross(-u, x), -u))  # z_s into the board
        turns = [
            Rotation.from_rotvec(yaw * u) * Rotation.from_rotvec(tilt * axis)
            for yaw, (tilt, axis) in product(grid.yaws, grid.tilt_axes(x, np.cross(u, x)))
        ]
        R_b_s = np.stack([turn.as_matrix() for turn in turns]) @ upright
        foot = np.array(
            [
                board.centre_b + (np.array(place) * board.half_sizes) @ board.axes_b
                for place in product(grid.places, repeat=2)
            ]
        )
        depth = self.window.near + np.array(grid.depths) * (self.window.far - self.window.near)
        origin = foot[None, :, None] - depth[None, None, :, None] * R_b_s[:, None, None, :, 2]
        T_b_s = np.tile(np.eye(4), (*origin.shape[:3], 1, 1))
        T_b_s[..., :3, :3], T_b_s[..., :3, 3] = R_b_s[:, None, None], origin
        T_b_f = T_b_s.reshape(-1, 4, 4) @ inverse_pose(self.T_f_s)
        seen = self.lines(T_b_f)
        on_board = board.contains_points(seen.ends_b, EDGE_MARGIN).all(axis=1)
        return np.asarray(T_b_f[(seen.line_length >= MIN_LINE_LENGTH) & on_board])

    def suggest_pose(
        self,
        candidates: ArrayLike,
        taken: ArrayLike,
        reachable: ReachabilityCheck = lambda T_b_f: True,
    ) -> SuggestedPose:
        """Suggest the candidate pose whose line shrinks the uncertainty most.

        Parameters
        ----------
        candidates : array_like, shape (n, 4, 4)
            Flange poses to choose from, such as `candidate_poses` gives.
        taken : array_like, shape (k, 4, 4)
            Flange poses of the lines so far.
        reachable : callable, optional
            Whether the arm can take its flange to T_b_f without touching anything. It is called
            for the poses with most information, not for all.

        Raises
        ------
        CalibrationRefused
            If no candidate sees the plane within reach.
        """
        poses, so_far = (
            np.reshape(np.array(each, dtype=float), (-1, 4, 4)) for each in (candidates, taken)
        )
        known, seen = self._information(so_far), self.lines(poses).information
        total = known + seen
        # The plane is unknown too: a Schur complement's determinant is a quotient of two.
        gain = np.linalg.slogdet(total)[1] - np.linalg.slogdet(total[:, 6:, 6:])[1]
        gain[np.abs(seen).max(axis=(1, 2)) == 0] = -np.inf
        for k in np.argsort(-gain):
            if np.isfinite(gain[k]) and reachable(poses[k]):
                return SuggestedPose(
                    poses[k], _uncertainty_left(known), _uncertainty_left(total[k])
                )
        raise CalibrationRefused(
            "no pose to suggest",
            f"none of {len(poses)} candidates sees the plane within reach; offer others",
        )

    def _information(self, T_b_f: Array) -> Array:
        """Information from lines and before any, shape (9, 9): mount roughly, plane as touched."""
        sigmas = np.repeat((PRIOR_SIGMA_POSITION, PRIOR_SIGMA_ROTATION), 3)
        known = block_diag(np.diag(1 / sigmas**2), self.target.information)
        if not self.target.was_touched:
            # Unknown, yet no determinant may vanish: half a turn and a metre.
            known[6:, 6:] = np.diag((np.pi**-2, np.pi**-2, 1.0))
        return np.asarray(known + self.lines(T_b_f).information.sum(0))


def _uncertainty_left(information: Array) -> HandEyeUncertainty:
    """Uncertainty of T_f_s that information about it and the plane, shape (9, 9), leaves."""
    return HandEyeUncertainty(covariance_from_information(information)[:6, :6])
