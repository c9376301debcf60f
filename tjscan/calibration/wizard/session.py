"""The steps of a calibration, without devices: the next one follows from the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.hand_eye import calibrate_on_plane
from tjscan.calibration.measuring_range import MeasuringRange
from tjscan.calibration.noise import FlangeMoves, NoiseModel
from tjscan.calibration.result import HandEyeCalibration, HandEyeUncertainty
from tjscan.calibration.targets.consensus import Mask
from tjscan.calibration.targets.line import LineFit, fit_line
from tjscan.calibration.targets.plane import PlaneTarget, fit_plane
from tjscan.calibration.targets.target import PosedFit, PosedProfile, fit_profiles
from tjscan.calibration.wizard.advice import (
    BoardRectangle,
    CandidatePoseGrid,
    LinePrediction,
    ReachabilityCheck,
    SuggestedPose,
)
from tjscan.calibration.wizard.logbook import MeasurementsSoFar
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import (
    Array,
    frozen_arrays,
    pose,
    rot_x,
    rot_z,
    skew_matrix,
    transform_points,
)
from tjscan.laser.deviation import LaserDeviation

TOUCH_EDGE_MARGIN: Final = 0.02
"""Metres that touched places keep from the board's edges: its stated place is approximate."""
BOARD_CLEARANCE: Final = 0.03
"""Metres that probe tip and sensor keep from the board while lines are taken."""
SAME_POSE_TOLERANCE: Final = (0.01, float(np.radians(5.0)))
"""Metres and radians; poses nearer to each other in both count as the same."""
YAW_COUNT: Final = 8
"""Ways to turn the flange about the board's normal, evenly spaced."""
SMALL_TILT_GRID: Final = CandidatePoseGrid(
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
    facing = T_b_board[:3, :3] @ rot_x(np.pi)
    turns = [facing @ rot_z(2 * np.pi * k / YAW_COUNT) for k in range(YAW_COUNT)]
    turns.sort(key=lambda R: Rotation.from_matrix(near[:3, :3].T @ R).magnitude())
    return [pose(R, place_b - R @ tip_f) for R in turns]


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


@dataclass(frozen=True, slots=True, eq=False)
@frozen_arrays
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
        return transform_points(self.T_b_board, grid[: self.touches])

    def start_poses(self, near: Array) -> list[Array]:
        """Flange poses with the sensor square over the board in mid range, nearest turn first.

        Parameters
        ----------
        near : ndarray, shape (4, 4)
            Flange pose whose turn is preferred.
        """
        depth = 0.5 * (self.window.near + self.window.far)
        seen_f = transform_points(self.T_f_s, (0.0, 0.0, depth))
        facing_f = self.T_f_s[:3, :3]
        # The sensor's z, not the flange's, is to point into the board.
        nowhere = np.zeros(3)
        square = poses_square_to_board(self.T_b_board, nowhere, nowhere, near @ pose(facing_f))
        R_b_f = [T[:3, :3] @ facing_f.T for T in square]
        return [pose(R, self.T_b_board[:3, 3] - R @ seen_f) for R in R_b_f]

    def tip_positions(self, measured: MeasurementsSoFar) -> dict[int, Array]:
        """Positions of the tip at each touch so far, frame b, metres, by number of the place."""
        return {
            number: transform_points(T_b_f, self.tip_f) for number, T_b_f, _ in measured.contacts
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
        by_arm, noise = self._tip_by_arm(measured), self.noise
        target = fit_plane(points, noise.touch, outside, geometry=noise.geometry, by_arm=by_arm)
        return target, BoardRectangle.through_touched_points(points, target)

    def _tip_by_arm(self, measured: MeasurementsSoFar) -> Array | None:
        """How the tip moves at each touch with draws of the arm's geometry, shape (n, 3, m)."""
        moves = []
        for _, T_b_f, q in measured.contacts:
            if self.flange_moves is None or q is None:
                return None
            by_flange = self.flange_moves(q)
            tip_b = T_b_f[:3, :3] @ self.tip_f
            moves.append(by_flange[:3] - skew_matrix(tip_b) @ by_flange[3:])
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

    def predict_from(self, T_f_s: Array, target: PlaneTarget) -> LinePrediction:
        """Predicts lines on the board of a sensor that sits at T_f_s, shape (4, 4)."""
        return LinePrediction(T_f_s, target, self.window, self.noise)

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
            result = calibrate_on_plane(samples, target, self.noise, T_f_s_guess=self.T_f_s)
            T_f_s = result.T_f_s
        except CalibrationRefused as refused:
            refusal = refused
        taken = np.array([sample.T_b_f for sample in samples]).reshape(-1, 4, 4)
        predicted = self.predict_from(T_f_s, target).uncertainty(taken)
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
        T_f_s, grid = self.T_f_s, SMALL_TILT_GRID
        if result is not None:
            T_f_s, grid = result.T_f_s, CandidatePoseGrid()
        prediction = self.predict_from(T_f_s, target)
        candidates = prediction.candidate_poses(board, grid, self.T_b_board[:3, 0])
        taken = [shot.T_b_f for shot in measured.line_profiles]
        done = [*taken, *(passed.T_b_f for passed in measured.skipped_poses)]
        # Flange, probe tip and sensor keep clear of the board.
        points_f = np.stack((np.zeros(3), self.tip_f, T_f_s[:3, 3]))
        points_b = np.einsum("nij,kj->nki", candidates[:, :3, :3], points_f)
        heights = target.plane.signed_distances(points_b + candidates[:, None, :3, 3])
        free = _mask_of_new_poses(candidates, done) & (heights > BOARD_CLEARANCE).all(axis=1)
        return prediction.suggest_pose(candidates[free], taken, reachable)


def _mask_of_new_poses(candidates: Array, others: list[Array]) -> Mask:
    """Which candidates, shape (n, 4, 4), are not the same as any of the others."""
    apart = np.ones(len(candidates), dtype=bool)
    for T in others:
        shift = np.linalg.norm(candidates[:, :3, 3] - T[:3, 3], axis=1)
        cosine = 0.5 * (np.einsum("nij,ij->n", candidates[:, :3, :3], T[:3, :3]) - 1)
        apart &= (shift > SAME_POSE_TOLERANCE[0]) | (cosine < np.cos(SAME_POSE_TOLERANCE[1]))
    return apart
