"""Poses that reduce the sensor's uncertainty most: D-optimal choice among candidates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from tjscan.calibration.measuring_range import MeasuringRange, visible_lines_on_plane
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.result import HandEyeUncertainty
from tjscan.calibration.solve.refine import covariance_from_information
from tjscan.calibration.targets.line import LineBundle
from tjscan.calibration.targets.plane import PlaneModel, PlaneTarget
from tjscan.core.frames import Array

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


def predict_lines(
    T_b_f: Array, T_f_s: Array, target: PlaneTarget, window: MeasuringRange, noise: NoiseModel
) -> PredictedLines:
    """Predict the lines that a sensor would take of a plane, and their information.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.
    T_f_s : ndarray, shape (4, 4)
        About how the sensor sits on the flange.
    target : PlaneTarget
        The board.
    window : MeasuringRange
        The laser's measuring range.
    noise : NoiseModel
        Errors of points and poses.
    """
    T_b_s = T_b_f @ T_f_s
    u_s = target.plane.u @ T_b_s[:, :3, :3]
    u0_s = T_b_s[:, :3, 3] @ target.plane.u + target.plane.u0
    seen = visible_lines_on_plane(window, u_s, u0_s)
    there = seen.span > 0
    ends_s = np.where(there[:, None, None], seen.ends_s, np.array(((-1.0, 0, 0), (1.0, 0, 0))))
    along = ends_s[:, 1] - ends_s[:, 0]
    direction = along / np.linalg.norm(along, axis=1, keepdims=True)
    count = np.maximum(seen.columns, 2)
    # Points evenly spread over a length have a variance of a twelfth of its square.
    sigma = np.sqrt(noise.mean_variance_inflation / count) * noise.range * np.abs(direction[:, 0])
    sigma_angle = sigma * np.sqrt(12) / np.where(there, seen.span, 1.0)
    lines = LineBundle(T_b_f[:, :3, :3], T_b_f[:, :3, 3], ends_s.mean(axis=1), direction)
    found = PlaneModel(lines, sigma, sigma_angle, target, noise).linearise(T_f_s, np.zeros(3))
    J = np.concatenate((found.by_pose, found.by_target), axis=2)
    information = J.transpose(0, 2, 1) @ np.linalg.solve(found.covariance, J)
    ends_b = np.einsum("nij,nkj->nki", T_b_s[:, :3, :3], seen.ends_s) + T_b_s[:, None, :3, 3]
    return PredictedLines(np.where(there[:, None, None], information, 0.0), ends_b, seen.span)


def prior_information(target: PlaneTarget) -> Array:
    """Information before any line, shape (9, 9): the mount roughly, the plane as touched."""
    information = np.zeros((9, 9))
    information[:3, :3] = np.eye(3) / PRIOR_SIGMA_POSITION**2
    information[3:6, 3:6] = np.eye(3) / PRIOR_SIGMA_ROTATION**2
    information[6:, 6:] = target.information
    if not target.was_touched:
        # Unknown, yet no determinant may vanish: half a turn and a metre.
        information[6:, 6:] = np.diag((np.pi**-2, np.pi**-2, 1.0))
    return information


def predict_uncertainty(
    T_b_f: Array, T_f_s: Array, target: PlaneTarget, window: MeasuringRange, noise: NoiseModel
) -> HandEyeUncertainty:
    """Predict how far a calibration with lines from these poses would be off.

    It falls with every pose, also before there are enough of them to solve; n may be zero.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses, n ≥ 0.
    T_f_s : ndarray, shape (4, 4)
        About how the sensor sits on the flange.
    target : PlaneTarget
        The board.
    window : MeasuringRange
        The laser's measuring range.
    noise : NoiseModel
        Errors of points and poses.
    """
    return uncertainty_of(information_of_lines(T_b_f, T_f_s, target, window, noise))


def information_of_lines(
    T_b_f: Array, T_f_s: Array, target: PlaneTarget, window: MeasuringRange, noise: NoiseModel
) -> Array:
    """Information from lines and before them, shape (9, 9); see `predict_uncertainty`."""
    information = prior_information(target)
    if len(T_b_f):
        seen = predict_lines(T_b_f, T_f_s, target, window, noise)
        information = information + seen.information.sum(0)
    return information


def uncertainty_of(information: Array) -> HandEyeUncertainty:
    """Uncertainty of T_f_s that information about it and the plane, shape (9, 9), leaves."""
    return HandEyeUncertainty(covariance_from_information(information)[:6, :6])


def information_gain(before: Array, information: Array) -> Array:
    """Log-determinant of the information about T_f_s, the plane being unknown, shape (n,).

    Parameters
    ----------
    before : ndarray, shape (9, 9) or (n, 9, 9)
        Information so far.
    information : ndarray, shape (n, 9, 9)
        Of a line from each candidate.
    """
    total = before + information
    # The determinant of a Schur complement is the quotient of two determinants.
    return np.asarray(np.linalg.slogdet(total)[1] - np.linalg.slogdet(total[:, 6:, 6:])[1])


def choose_most_informative(
    candidates: Array, information: Array, before: Array, reachable: ReachabilityCheck | None = None
) -> int | None:
    """Choose the reachable candidate with most information; None if no line is seen.

    Parameters
    ----------
    candidates : ndarray, shape (n, 4, 4)
        Flange poses.
    information : ndarray, shape (n, 9, 9)
        Of a line from each.
    before : ndarray, shape (9, 9)
        Information so far.
    reachable : callable, optional
        Whether the arm reaches a flange pose.
    """
    score = information_gain(before, information)
    score[np.abs(information).max(axis=(1, 2)) == 0] = -np.inf
    for k in np.argsort(-score):
        if not np.isfinite(score[k]):
            return None
        if reachable is None or reachable(candidates[k]):
            return int(k)
    return None
