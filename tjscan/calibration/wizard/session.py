"""The steps of a calibration, without devices: the next one follows from the measurements.

The pose for the next line is the one that reduces the sensor's uncertainty most (D-optimal).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.noise import FlangeMoves, NoiseModel
from tjscan.calibration.result import HandEyeCalibration, HandEyeUncertainty
from tjscan.calibration.solve.refine import covariance_from_information
from tjscan.calibration.targets.line import LineBundle, LineFit, fit_line
from tjscan.calibration.targets.plane import PlaneModel, PlaneTarget, SeenBoard, fit_plane
from tjscan.calibration.targets.target import PosedFit, PosedProfile, fit_profiles
from tjscan.calibration.wizard.logbook import MeasurementsSoFar
from tjscan.core import frames
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, Mask, array_dataclass
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.model import MeasuringRange

LINE_EDGE_MARGIN: Final = 5e-3
"""Metres that a line keeps from the board's edges: the mount is not known exactly yet."""
MIN_PLANNED_LINE_LENGTH: Final = 0.04
"""Metres; a planned line is at least this long."""
ReachabilityCheck = Callable[[Array], bool]
"""Whether the flange can be taken to T_b_f, shape (4, 4), without touching anything."""

MOUNT_PRIOR_SIGMA_POSITION: Final = 0.05
MOUNT_PRIOR_SIGMA_ROTATION: Final = float(np.radians(10.0))
"""How well the sensor's place is known before any line: metres and radians, as for a drawing of
the bracket. An assumption; it only keeps the first choices finite."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibleLines:
    """Where the laser sees planes as lines: their ends, length and columns, frame s.

    Parameters
    ----------
    ends_s : ndarray, shape (n, 2, 3)
        Both ends, by rising x; NaN if the plane is out of the window.
    span : ndarray, shape (n,)
        Length in metres; zero where nothing is seen.
    columns : ndarray, shape (n,)
        Points on each line.
    """

    ends_s: Array
    span: Array
    columns: Array


def visible_lines_on_plane(window: MeasuringRange, u_s: Array, u0_s: Array) -> VisibleLines:
    """Lines that the laser sees where planes cut its window.

    Parameters
    ----------
    window : MeasuringRange
        The measuring range.
    u_s, u0_s : ndarray, shapes (n, 3) and (n,)
        The planes ``u · p + u0 = 0`` in frame s.
    """
    tan = np.tan(window.half_angle)
    # A column at tangent t is the ray (t, 0, 1) from the apex; it meets the plane at depth d.
    with np.errstate(divide="ignore", invalid="ignore"):
        to_plane = -(u0_s + u_s[:, 2] * window.apex_z)
        # depth(t) = to_plane / (u_x t + u_z), so t(depth) limits the columns that see near..far.
        limits = to_plane[:, None] / np.array(
            (window.near - window.apex_z, window.far - window.apex_z)
        )
        at = (limits - u_s[:, 2:3]) / u_s[:, :1]
        level = np.abs(u_s[:, 0]) < 1e-12 * np.abs(u_s[:, 2])
        depth_0 = to_plane / u_s[:, 2]
        inside = (depth_0 >= window.near - window.apex_z) & (depth_0 <= window.far - window.apex_z)
        low = np.where(level, np.where(inside, -tan, np.inf), np.min(at, axis=1))
        high = np.where(level, np.where(inside, tan, -np.inf), np.max(at, axis=1))
        low, high = np.maximum(low, -tan), np.minimum(high, tan)
        t = np.stack((low, high), axis=1)
        depth = to_plane[:, None] / (u_s[:, :1] * t + u_s[:, 2:3])
        seen = (low < high) & (depth > 0).all(axis=1)
        ends = np.stack((depth * t, np.zeros_like(t), window.apex_z + depth), axis=2)
    ends[~seen] = np.nan
    span = np.where(seen, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 0.0)
    columns = np.where(seen, (high - low) / (2 * tan) * (window.columns - 1) + 1, 0.0)
    return VisibleLines(ends, span, columns)


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


@array_dataclass
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


@array_dataclass
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
class LinePredictor:
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

    def predict_lines(self, T_b_f: Array) -> PredictedLines:
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
        return _remaining_uncertainty(self._information(T_b_f))

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
        x = frames.unit_vector(x - (x @ u) * u)
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
        T_b_f = T_b_s.reshape(-1, 4, 4) @ frames.inverse_pose(self.T_f_s)
        seen = self.predict_lines(T_b_f)
        on_board = board.contains_points(seen.ends_b, LINE_EDGE_MARGIN).all(axis=1)
        return np.asarray(T_b_f[(seen.line_length >= MIN_PLANNED_LINE_LENGTH) & on_board])

    def most_informative_pose(
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
        known, seen = self._information(so_far), self.predict_lines(poses).information
        total = known + seen
        # The plane is unknown too: a Schur complement's determinant is a quotient of two.
        gain = np.linalg.slogdet(total)[1] - np.linalg.slogdet(total[:, 6:, 6:])[1]
        gain[np.abs(seen).max(axis=(1, 2)) == 0] = -np.inf
        for k in np.argsort(-gain):
            if np.isfinite(gain[k]) and reachable(poses[k]):
                return SuggestedPose(
                    poses[k], _remaining_uncertainty(known), _remaining_uncertainty(total[k])
                )
        raise CalibrationRefused(
            "no pose to suggest",
            f"none of {len(poses)} candidates sees the plane within reach; offer others",
        )

    def _information(self, T_b_f: Array) -> Array:
        """Information from lines and before any, shape (9, 9): mount roughly, plane as touched."""
        sigmas = np.repeat((MOUNT_PRIOR_SIGMA_POSITION, MOUNT_PRIOR_SIGMA_ROTATION), 3)
        known = block_diag(np.diag(1 / sigmas**2), self.target.information)
        if not self.target.is_place_known:
            # Unknown, yet no determinant may vanish: half a turn and a metre.
            known[6:, 6:] = np.diag((np.pi**-2, np.pi**-2, 1.0))
        return np.asarray(known + self.predict_lines(T_b_f).information.sum(0))


def _remaining_uncertainty(information: Array) -> HandEyeUncertainty:
    """Uncertainty of T_f_s that information about it and the plane, shape (9, 9), leaves."""
    return HandEyeUncertainty(covariance_from_information(information)[:6, :6])


TOUCH_EDGE_MARGIN: Final = 0.02
"""Metres that touched places keep from the board's edges: its stated place is approximate."""
BOARD_CLEARANCE: Final = 0.03
"""Metres that probe tip and sensor keep from the board while lines are taken."""
SAME_POSE_TOLERANCE: Final = (0.01, float(np.radians(5.0)))
"""Metres and radians; poses nearer to each other in both count as the same."""
FLANGE_YAW_COUNT: Final = 8
"""Ways to turn the flange about the board's normal, evenly spaced."""
SMALL_TILT_POSE_GRID: Final = CandidatePoseGrid(
    tilts=tuple(np.radians((0.0, 15.0, 30.0))), depths=(0.5,), places=(-0.2, 0.0, 0.2)
)
"""What to choose from until there is a first result: the mount is known only roughly, and the
line must not leave board or range."""


def poses_square_to_board(
    T_b_board: Array, tip_f: Array, place_b: Array, near: Array
) -> list[Array]:
    """Flange poses whose z points into the board with `tip_f` on a place, nearest turn first.

    Parameters
    ----------
    T_b_board : ndarray, shape (4, 4)
        Approximate pose of the board.
    tip_f, place_b : ndarray, shape (3,)
        Point of the flange, and the place to take it to.
    near : ndarray, shape (4, 4)
        Flange pose to turn as little as possible from.
    """
    facing = T_b_board[:3, :3] @ frames.rot_x(np.pi)
    turns = [
        facing @ frames.rot_z(2 * np.pi * k / FLANGE_YAW_COUNT) for k in range(FLANGE_YAW_COUNT)
    ]
    turns.sort(key=lambda R: Rotation.from_matrix(near[:3, :3].T @ R).magnitude())
    return [frames.pose(R, place_b - R @ tip_f) for R in turns]


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationProgress:
    """How far a calibration has come: its result so far, or why there is none yet.

    Parameters
    ----------
    samples : tuple of PosedFit
        The lines there are.
    wanted : int
        Lines to take.
    expected : HandEyeUncertainty
        As predicted from the geometry of the poses, from the first line on.
    result : HandEyeCalibration or None
        From the lines.
    refusal : CalibrationRefused or None
        Why there is none yet.
    """

    samples: tuple[PosedFit[LineFit], ...]
    wanted: int
    expected: HandEyeUncertainty
    result: HandEyeCalibration | None
    refusal: CalibrationRefused | None

    @property
    def uncertainty(self) -> HandEyeUncertainty:
        """Uncertainty of the result; before there is one, as the geometry predicts it."""
        return self.expected if self.result is None else self.result.uncertainty


@array_dataclass
class CalibrationPlan:
    """Plan of a calibration: approximate board and sensor, and how many lines to take.

    Parameters
    ----------
    T_b_board : ndarray, shape (4, 4)
        Approximate pose of the board: origin in the middle of its face, z away from it.
    half_sizes : ndarray, shape (2,)
        Half its sides along its x and y, in metres.
    tip_f : ndarray, shape (3,)
        The probe's tip in frame f, in metres. The flange's z points into the board to touch.
    T_f_s : ndarray, shape (4, 4)
        About how the sensor sits on the flange.
    window : MeasuringRange
        Measuring range of the sensor.
    noise : NoiseModel
        Errors of measurements.
    touches, lines : int
        How many to take.
    flange_moves : callable, optional
        How the arm's geometry error moves its flange, if its model is known.
    laser : LaserDeviation, optional
        Possible deviation of the laser.
    """

    T_b_board: Array
    half_sizes: Array
    tip_f: Array
    T_f_s: Array
    window: MeasuringRange
    noise: NoiseModel
    touches: int
    lines: int
    flange_moves: FlangeMoves | None = None
    laser: LaserDeviation | None = None

    @property
    def touch_points(self) -> Array:
        """Points at which to touch the board: a grid of `touches`, frame b, shape (n, 3)."""
        rows = round(np.sqrt(self.touches))
        columns = -(-self.touches // rows)
        reach = self.half_sizes - TOUCH_EDGE_MARGIN
        grid = [
            (x, y, 0.0)
            for y in np.linspace(-reach[1], reach[1], rows)
            for x in np.linspace(-reach[0], reach[0], columns)
        ]
        return frames.transform_points(self.T_b_board, grid[: self.touches])

    def start_poses(self, near: Array) -> list[Array]:
        """Flange poses with the sensor square over the board in mid range, nearest turn first.

        Parameters
        ----------
        near : ndarray, shape (4, 4)
            Flange pose whose turn is preferred.
        """
        depth = 0.5 * (self.window.near + self.window.far)
        seen_f = frames.transform_points(self.T_f_s, (0.0, 0.0, depth))
        facing_f = self.T_f_s[:3, :3]
        # The sensor's z, not the flange's, is to point into the board.
        nowhere = np.zeros(3)
        square = poses_square_to_board(
            self.T_b_board, nowhere, nowhere, near @ frames.pose(facing_f)
        )
        R_b_f = [T[:3, :3] @ facing_f.T for T in square]
        return [frames.pose(R, self.T_b_board[:3, 3] - R @ seen_f) for R in R_b_f]

    def tip_positions(self, measured: MeasurementsSoFar) -> dict[int, Array]:
        """Positions of the tip at each touch so far, frame b, metres, by number of the place."""
        return {
            number: frames.transform_points(T_b_f, self.tip_f)
            for number, T_b_f, _ in measured.tip_contacts
        }

    def fit_board(self, measured: MeasurementsSoFar) -> tuple[PlaneTarget, BoardRectangle]:
        """Fit the board's plane to the touches, and find the rectangle that they span.

        Raises
        ------
        CalibrationRefused
            As `fit_plane` does.
        """
        points = np.array(list(self.tip_positions(measured).values())).reshape(-1, 3)
        outside = self.T_b_board[:3, 3] + self.T_b_board[:3, 2]
        by_arm, noise = self._tip_motion_per_draw(measured), self.noise
        target = fit_plane(points, noise.touch, outside, geometry=noise.geometry, by_arm=by_arm)
        return target, BoardRectangle.through_touched_points(points, target)

    def _tip_motion_per_draw(self, measured: MeasurementsSoFar) -> Array | None:
        """How the tip moves at each touch with draws of the arm's geometry, shape (n, 3, m)."""
        moves = []
        for _, T_b_f, q in measured.tip_contacts:
            if self.flange_moves is None or q is None:
                return None
            by_flange = self.flange_moves(q)
            tip_b = T_b_f[:3, :3] @ self.tip_f
            moves.append(by_flange[:3] - frames.skew_matrix(tip_b) @ by_flange[3:])
        return np.array(moves) if moves else None

    def worst_touch(self, measured: MeasurementsSoFar) -> int:
        """Number of the touch, of three or more, that is farthest off the plane through all."""
        points = self.tip_positions(measured)
        p = np.array(list(points.values()))
        off = np.abs((p - p.mean(axis=0)) @ np.linalg.svd(p - p.mean(axis=0))[2][2])
        return list(points)[int(np.argmax(off))]

    def fit_lines(self, profiles: Sequence[PosedProfile]) -> list[PosedFit[LineFit]]:
        """Lines of the profiles that show one, with their responses to errors that all share."""
        return fit_profiles(profiles, fit_line, self.noise, self.laser, self.flange_moves)[0]

    def line_predictor(self, T_f_s: Array, target: PlaneTarget) -> LinePredictor:
        """Predicts lines on the board of a sensor that sits at T_f_s, shape (4, 4)."""
        return LinePredictor(T_f_s, target, self.window, self.noise)

    def progress(self, measured: MeasurementsSoFar, target: PlaneTarget) -> CalibrationProgress:
        """Result of the lines taken so far, or why there is none yet.

        Parameters
        ----------
        measured : MeasurementsSoFar
            The lines.
        target : PlaneTarget
            The board as touched.
        """
        samples = self.fit_lines(measured.line_profiles)
        result, refusal, T_f_s = None, None, self.T_f_s
        try:
            seen = [SeenBoard(samples, target, self.noise)]
            result = calibrate_on_targets(seen, self.noise, T_f_s_guess=self.T_f_s)
            T_f_s = result.T_f_s
        except CalibrationRefused as refused:
            refusal = refused
        taken = np.array([sample.T_b_f for sample in samples]).reshape(-1, 4, 4)
        predicted = self.line_predictor(T_f_s, target).uncertainty(taken)
        return CalibrationProgress(tuple(samples), self.lines, predicted, result, refusal)

    def suggest_line_pose(
        self,
        measured: MeasurementsSoFar,
        target: PlaneTarget,
        board: BoardRectangle,
        result: HandEyeCalibration | None,
        reachable: ReachabilityCheck,
    ) -> SuggestedPose:
        """Suggest the pose whose line reduces the uncertainty most; none is taken twice.

        Parameters
        ----------
        measured : MeasurementsSoFar
            The lines taken, and the poses passed over.
        target : PlaneTarget
            The board as touched.
        board : BoardRectangle
            Its extent.
        result : HandEyeCalibration or None
            Of the lines so far.
        reachable : callable
            Whether the arm reaches a flange pose.

        Raises
        ------
        CalibrationRefused
            If no pose is left that the arm reaches and that sees the board.
        """
        T_f_s, grid = self.T_f_s, SMALL_TILT_POSE_GRID
        if result is not None:
            T_f_s, grid = result.T_f_s, CandidatePoseGrid()
        prediction = self.line_predictor(T_f_s, target)
        candidates = prediction.candidate_poses(board, grid, self.T_b_board[:3, 0])
        taken = [shot.T_b_f for shot in measured.line_profiles]
        done = [*taken, *(passed.T_b_f for passed in measured.skipped_poses)]
        # Flange, probe tip and sensor keep clear of the board.
        points_f = np.stack((np.zeros(3), self.tip_f, T_f_s[:3, 3]))
        points_b = np.einsum("nij,kj->nki", candidates[:, :3, :3], points_f)
        heights = target.plane.signed_distances(points_b + candidates[:, None, :3, 3])
        free = _mask_of_new_poses(candidates, done) & (heights > BOARD_CLEARANCE).all(axis=1)
        return prediction.most_informative_pose(candidates[free], taken, reachable)


def _mask_of_new_poses(candidates: Array, others: list[Array]) -> Mask:
    """Which candidates, shape (n, 4, 4), are not the same as any of the others."""
    apart = np.ones(len(candidates), dtype=bool)
    for T in others:
        shift = np.linalg.norm(candidates[:, :3, 3] - T[:3, 3], axis=1)
        cosine = 0.5 * (np.einsum("nij,ij->n", candidates[:, :3, :3], T[:3, :3]) - 1)
        apart &= (shift > SAME_POSE_TOLERANCE[0]) | (cosine < np.cos(SAME_POSE_TOLERANCE[1]))
    return apart
