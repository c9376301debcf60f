"""The steps of a calibration, without devices: the next one follows from the measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tjscan.calibration.arm_error import FlangeMoves
from tjscan.calibration.hand_eye import calibrate_on_plane
from tjscan.calibration.measuring_range import MeasuringRange
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeCalibration, HandEyeUncertainty
from tjscan.calibration.targets.line import LineFit, fit_line
from tjscan.calibration.targets.plane import PlaneTarget
from tjscan.calibration.targets.target import PosedFit, PosedProfile, fit_profiles
from tjscan.calibration.targets.touched import fit_plane
from tjscan.calibration.wizard.advice import (
    BoardRectangle,
    CandidatePoseGrid,
    ReachabilityCheck,
    SuggestedPose,
    candidate_poses,
    predict_uncertainty,
    suggest_pose,
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


def planned_touch_points(task: CalibrationPlan) -> Array:
    """Points at which to touch the board: a grid of `task.touches`, frame b, shape (n, 3)."""
    rows = round(np.sqrt(task.touches))
    columns = -(-task.touches // rows)
    reach = task.half_sizes - TOUCH_EDGE_MARGIN
    grid = [
        (x, y, 0.0)
        for y in np.linspace(-reach[1], reach[1], rows)
        for x in np.linspace(-reach[0], reach[0], columns)
    ]
    return transform_points(task.T_b_board, grid[: task.touches])


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


def start_poses_over_board(task: CalibrationPlan, near: Array) -> list[Array]:
    """Flange poses with the sensor square over the board in mid range, nearest turn first.

    Parameters
    ----------
    task : CalibrationPlan
        The board, the laser's range, and about how the sensor sits.
    near : ndarray, shape (4, 4)
        Flange pose whose turn is preferred.
    """
    depth = 0.5 * (task.window.near + task.window.far)
    seen_f = transform_points(task.T_f_s, (0.0, 0.0, depth))
    facing_f = task.T_f_s[:3, :3]
    # The sensor's z, not the flange's, is to point into the board.
    square = poses_square_to_board(task.T_b_board, np.zeros(3), np.zeros(3), near @ pose(facing_f))
    R_b_f = [T[:3, :3] @ facing_f.T for T in square]
    return [pose(R, task.T_b_board[:3, 3] - R @ seen_f) for R in R_b_f]


def touched_points(task: CalibrationPlan, measured: MeasurementsSoFar) -> dict[int, Array]:
    """Positions of the tip at each touch so far, frame b, metres, by number of the place.

    Parameters
    ----------
    task : CalibrationPlan
        Has the tip in frame f.
    measured : MeasurementsSoFar
        The touches.
    """
    touches = sorted(measured.touches.items())
    return {k: transform_points(t.T_b_f, task.tip_f) for k, t in touches if t.T_b_f is not None}


def fit_touched_board(
    task: CalibrationPlan, measured: MeasurementsSoFar
) -> tuple[PlaneTarget, BoardRectangle]:
    """Fit the board's plane to the touches, and find the rectangle that they span.

    Parameters
    ----------
    task : CalibrationPlan
        Has the tip, its error and the side that the board is seen from.
    measured : MeasurementsSoFar
        The touches.

    Raises
    ------
    CalibrationRefused
        As `fit_plane` does.
    """
    points = np.array(list(touched_points(task, measured).values())).reshape(-1, 3)
    outside = task.T_b_board[:3, 3] + task.T_b_board[:3, 2]
    target = fit_plane(
        points,
        task.noise.touch,
        outside,
        geometry=task.noise.geometry,
        by_arm=_tip_by_arm(task, measured),
    )
    return target, BoardRectangle.through_touched_points(points, target)


def _tip_by_arm(task: CalibrationPlan, measured: MeasurementsSoFar) -> Array | None:
    """How the tip moves at each touch with draws of the arm's geometry, shape (n, 3, m)."""
    touches = [t for _, t in sorted(measured.touches.items()) if t.T_b_f is not None]
    moves = []
    for touch in touches:
        if task.flange_moves is None or touch.q is None or touch.T_b_f is None:
            return None
        by_flange = task.flange_moves(touch.q)
        tip_b = touch.T_b_f[:3, :3] @ task.tip_f
        moves.append(by_flange[:3] - skew_matrix(tip_b) @ by_flange[3:])
    return np.array(moves) if moves else None


def worst_touch_number(task: CalibrationPlan, measured: MeasurementsSoFar) -> int:
    """Number of the touch that lies farthest off the plane through all touches.

    Parameters
    ----------
    task : CalibrationPlan
        Has the tip in frame f.
    measured : MeasurementsSoFar
        Three touches or more.
    """
    points = touched_points(task, measured)
    p = np.array(list(points.values()))
    off = np.abs((p - p.mean(axis=0)) @ np.linalg.svd(p - p.mean(axis=0))[2][2])
    return list(points)[int(np.argmax(off))]


def line_samples(
    task: CalibrationPlan, profiles: Sequence[PosedProfile]
) -> list[PosedFit[LineFit]]:
    """Lines of the profiles that show one, with their responses to errors that all share.

    Parameters
    ----------
    task : CalibrationPlan
        Has the errors of arm and laser.
    profiles : sequence of PosedProfile
        Of the board.
    """
    return fit_profiles(profiles, fit_line, task.noise, task.laser, task.flange_moves)[0]


def current_progress(
    task: CalibrationPlan, measured: MeasurementsSoFar, target: PlaneTarget
) -> CalibrationProgress:
    """Result of the lines taken so far, or why there is none yet.

    Parameters
    ----------
    task : CalibrationPlan
        Has the noise model and about how the sensor sits.
    measured : MeasurementsSoFar
        The lines.
    target : PlaneTarget
        The board as touched.
    """
    samples = line_samples(task, measured.line_profiles)
    result, refusal = None, None
    try:
        result = calibrate_on_plane(samples, target, task.noise, T_f_s_guess=task.T_f_s)
    except CalibrationRefused as refused:
        refusal = refused
    T_f_s = task.T_f_s if result is None else result.T_f_s
    taken = np.array([sample.T_b_f for sample in samples]).reshape(-1, 4, 4)
    predicted = predict_uncertainty(taken, T_f_s, target, task.window, task.noise)
    return CalibrationProgress(tuple(samples), task.lines, predicted, result, refusal)


def suggest_next_line_pose(
    task: CalibrationPlan,
    measured: MeasurementsSoFar,
    target: PlaneTarget,
    board: BoardRectangle,
    progress: CalibrationProgress,
    reachable: ReachabilityCheck,
) -> SuggestedPose:
    """Suggest the pose whose line reduces the uncertainty most; none is taken twice.

    Parameters
    ----------
    task : CalibrationPlan
        About how the sensor sits, and the laser's range.
    measured : MeasurementsSoFar
        The lines taken, and the poses passed over.
    target : PlaneTarget
        The board as touched.
    board : BoardRectangle
        Its extent.
    progress : CalibrationProgress
        Result so far.
    reachable : callable
        Whether the arm reaches a flange pose.

    Raises
    ------
    CalibrationRefused
        If no pose is left that the arm reaches and that sees the board.
    """
    T_f_s, grid = task.T_f_s, SMALL_TILT_GRID
    if progress.result is not None:
        T_f_s, grid = progress.result.T_f_s, CandidatePoseGrid()
    x_b = task.T_b_board[:3, 0]
    candidates = candidate_poses(T_f_s, target, board, task.window, grid, x_b)
    taken = [shot.T_b_f for shot in measured.line_profiles]
    done = [*taken, *(passed.T_b_f for passed in measured.skipped_poses)]
    free = candidates[_apart(candidates, done) & _clear(candidates, task, T_f_s, target)]
    return suggest_pose(
        list(free), taken, T_f_s, target, task.window, task.noise, reachable=reachable
    )


def _apart(candidates: Array, others: list[Array]) -> NDArray[np.bool_]:
    """Which candidates, shape (n, 4, 4), are not the same as any of the others."""
    apart = np.ones(len(candidates), dtype=bool)
    for T in others:
        shift = np.linalg.norm(candidates[:, :3, 3] - T[:3, 3], axis=1)
        cosine = 0.5 * (np.einsum("nij,ij->n", candidates[:, :3, :3], T[:3, :3]) - 1)
        apart &= (shift > SAME_POSE_TOLERANCE[0]) | (cosine < np.cos(SAME_POSE_TOLERANCE[1]))
    return apart


def _clear(
    candidates: Array, task: CalibrationPlan, T_f_s: Array, target: PlaneTarget
) -> NDArray[np.bool_]:
    """Which candidates keep flange, probe tip and sensor clear of the board."""
    points_f = np.stack((np.zeros(3), task.tip_f, T_f_s[:3, 3]))
    points_b = np.einsum("nij,kj->nki", candidates[:, :3, :3], points_f)
    heights = target.plane.signed_distances(points_b + candidates[:, None, :3, 3])
    return np.asarray((heights > BOARD_CLEARANCE).all(axis=1))
