"""What a calibration must pass: motion of the arm, quality of the estimate, and poses read rightly.

Whether poses were read as they were meant, and belong to their profiles, is tested by evidence: the
likelihoods of the same profiles are compared under two hypotheses about their poses that have
equally many unknowns. If the stated one is true, another is more likely by a factor of more
than 1/p with a probability of less than p (Royall 1997, Statistical Evidence, 1.4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain, combinations
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from tjscan.calibration.noise import geometry_error_correlation
from tjscan.calibration.result import HandEyeCalibration, HandEyeUncertainty, SampleResidual
from tjscan.calibration.solve import refine
from tjscan.calibration.solve.refine import CombinedModel, LeastSquaresEstimate
from tjscan.calibration.solve.solution import (
    CalibrationProblem,
    SensorSolution,
    blame_thresholds,
    inverse_poses,
)
from tjscan.calibration.targets.line import LineFit
from tjscan.calibration.targets.plane import SeenBoard
from tjscan.calibration.targets.target import PosedFit
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, unit_vector
from tjscan.core.pose_vector import rotation_to_vector

MIN_RMS_FLANGE_TURN: Final = float(np.radians(2.0))
"""Radians RMS; smaller turns are as good as none."""
MIN_TILT_SPREAD: Final = 5e-3
"""RMS by which the cosines of the tilts must differ: about 0° beside 10°."""
ADVISED_TILT_DEG: Final = 20
"""Degrees to tilt by, in the advice: they bring the condition number to about 20."""
ARBITRARY_ROTATION_CONDITION: Final = 1e4
"""Condition beyond which the rotation found is arbitrary and names no axes."""


def check_poses_fix_hand_eye(T_b_f: Array, u_b: Array | None, R_f_s: Array | None = None) -> None:
    """Refuse poses that can't fix a hand-eye transform, for any lines.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses.
    u_b : ndarray, shape (3,), optional
        Normal of the board, if it is known.
    R_f_s : ndarray, shape (3, 3), optional
        About how the sensor sits on the flange: lets the advice name the sensor's axes
        instead of the flange's.

    Raises
    ------
    CalibrationRefused
        With the motion that is missing.
    """
    R = T_b_f[:, :3, :3]
    turns = rotation_to_vector(R[0].T @ R)
    _, singular, axes = np.linalg.svd(turns, full_matrices=True)
    spread = singular / np.sqrt(len(turns))
    if spread[0] < MIN_RMS_FLANGE_TURN:
        advised = "the flange's axes that are parallel to the board"
        if R_f_s is not None:
            advised = "the sensor's x and y axes"
        raise CalibrationRefused(
            "only translations",
            f"the poses differ in orientation by {np.degrees(spread[0]):.1f}°; tilt by "
            f"{ADVISED_TILT_DEG}° or more, both ways, about {advised}",
        )
    if spread[1] < MIN_RMS_FLANGE_TURN:
        _refuse_turns_about_one_axis(axes[0], None if u_b is None else R[0].T @ u_b, R_f_s)
    if u_b is not None:
        _check_normals_lean_two_ways(u_b @ R, R_f_s)


def _refuse_turns_about_one_axis(axis_f: Array, u_f: Array | None, R_f_s: Array | None) -> None:
    """Name the axis turned about, and the one to tilt about: square to it, along the board."""
    if u_f is None and R_f_s is not None:
        u_f = -R_f_s[:, 2]  # the sensor looks at the board
    turned = describe_axis(axis_f, R_f_s)
    if u_f is None:
        advice = f"turn about an axis square to it by {ADVISED_TILT_DEG}° or more, both ways"
    elif abs(axis_f @ u_f) > 0.9:
        across = np.linalg.svd(u_f[None])[2][1:] if R_f_s is None else R_f_s[:, :2].T
        tilts = advise_tilts(list(across), R_f_s)
        advice = f"that is about the board's normal, which shows nothing new; {tilts}"
    else:
        advice = advise_tilts([np.cross(u_f, axis_f)], R_f_s)
    raise CalibrationRefused(
        "turns about one axis only", f"all poses differ by turns about {turned}; {advice}"
    )


def _check_normals_lean_two_ways(u_f: Array, R_f_s: Array | None) -> None:
    """The normals seen from the flange, shape (n, 3), must lean two ways."""
    spread, axes = tilt_spread(u_f)
    missing = [axis for axis, s in zip(axes, spread, strict=True) if s < MIN_RMS_FLANGE_TURN]
    if missing:
        singular = np.linalg.svd(u_f, compute_uv=False) / np.sqrt(len(u_f))
        shown = ", ".join(f"{s:.4f}" for s in singular)
        raise CalibrationRefused(
            "plane normals do not span space",
            "seen from the flange, the board's normals lean one way only (singular values "
            f"{shown}); {advise_tilts(missing, R_f_s)}",
        )


def check_tilts_vary(u_f: Array, R_f_s: Array | None = None) -> None:
    """Refuse normals on one cone: with the plane unknown, its height is then free.

    From poses tilted alike, a board farther away and a sensor further out look the same.

    Parameters
    ----------
    u_f : ndarray, shape (n, 3)
        The board's normal as each flange sees it.
    R_f_s : ndarray, shape (3, 3), optional
        Rotation of the sensor on the flange, to name the axes of the sensor.

    Raises
    ------
    CalibrationRefused
        With the motion that is missing.
    """
    _, singular, axes = np.linalg.svd(u_f - u_f.mean(axis=0))
    spread = singular[2] / np.sqrt(len(u_f))
    if spread < MIN_TILT_SPREAD:
        raise CalibrationRefused(
            "all tilts alike",
            f"the board is unknown, and every pose is tilted alike about "
            f"{describe_axis(axes[2], R_f_s)} (the cosines differ by {spread:.4f} RMS, "
            f"{MIN_TILT_SPREAD:g} is needed); missing: tilts of other sizes, some of them with the "
            "sensor square to the board",
        )


def rotation_condition(A: Array) -> float:
    """Condition number of eq. (21), `A` of shape (n, 6).

    First over fifth singular value; the last belongs to the solution.
    """
    singular = np.linalg.svd(A, compute_uv=False)
    return float(singular[0] / max(singular[4], 1e-300))


def advise_further_tilts(
    condition: float, u_f: Array, R_f_s: Array, R_f_s_guess: Array | None
) -> str:
    """Text on how far poses tilt, and about which axes they must tilt further.

    Parameters
    ----------
    condition : float
        Of eq. (21).
    u_f : ndarray, shape (n, 3)
        The board's normal as each flange sees it.
    R_f_s, R_f_s_guess : ndarray, shape (3, 3)
        Rotation of the sensor as found, and approximately, if that is known: one of them names
        the axes to tilt about.
    """
    # A rotation from an ill-conditioned set still names the axes, unless it is arbitrary.
    R = (
        R_f_s_guess
        if R_f_s_guess is not None or condition > ARBITRARY_ROTATION_CONDITION
        else R_f_s
    )
    spread, axes = tilt_spread(u_f)
    shown = " and ".join(
        f"{np.degrees(s):.1f}° about {describe_axis(axis, R)}"
        for s, axis in zip(spread, axes, strict=True)
    )
    # About equally little both ways: both are missing.
    weak = axes if spread[1] > 0.5 * spread[0] else axes[1:]
    return f"the tilts have an RMS of {shown}; {advise_tilts(list(weak), R)}"


def tilt_spread(u_f: Array) -> tuple[Array, Array]:
    """How far the normals lean about two axes of the flange, the larger first.

    Returns
    -------
    spread : ndarray, shape (2,)
        RMS tilts in radians.
    axes : ndarray, shape (2, 3)
        Unit vectors in frame f to tilt about.
    """
    mean = unit_vector(u_f.sum(axis=0))
    across = u_f - np.outer(u_f @ mean, mean)
    _, singular, lean = np.linalg.svd(across, full_matrices=True)
    # Turning about w moves the normal along w × mean.
    return singular[:2] / np.sqrt(len(u_f)), np.cross(mean, lean[:2])


def advise_tilts(axes_f: list[Array], R_f_s: Array | None) -> str:
    """Text that asks the operator for tilts about axes.

    Parameters
    ----------
    axes_f : list of ndarray, shape (3,)
        Axes in frame f.
    R_f_s : ndarray, shape (3, 3), or None
        Rotation of the sensor on the flange, if it is known.

    Returns
    -------
    str
        In the sensor's axes if its rotation is known, else in the flange's.
    """
    names = " and ".join(sorted({describe_axis(axis, R_f_s) for axis in axes_f}))
    return f"missing: tilt about {names}, by {ADVISED_TILT_DEG}° or more, both ways"


def describe_axis(axis_f: Array, R_f_s: Array | None) -> str:
    """Name of a direction for messages, by the sensor's axes if known, else by the flange's.

    Parameters
    ----------
    axis_f : ndarray, shape (3,)
        Frame f, of any length but zero.
    R_f_s : ndarray, shape (3, 3), or None
        Rotation of the sensor on the flange, if it is known.
    """
    whose, axis = ("flange", axis_f) if R_f_s is None else ("sensor", R_f_s.T @ axis_f)
    axis = unit_vector(axis)
    k = int(np.argmax(np.abs(axis)))
    if abs(axis[k]) > 0.85:
        return f"the {whose}'s {'xyz'[k]} axis"
    x, y, z = axis * np.sign(axis[k])
    return f"the {whose}'s direction ({x:.2f}, {y:.2f}, {z:.2f})"


MAX_SIGMA_SCALE: Final = 3.0
"""Residuals so many times larger than stated contradict the noise model. Smaller excess, if it is
significant, widens the covariance."""
MAX_SIGMA_SCALE_AFTER_REJECTION: Final = 2.0
"""The same limit if profiles were left out: without the worst ones the others look better than
they are, and which ones are bad is itself in doubt."""
MAX_SIGMA_POSITION: Final = 5e-3
MAX_SIGMA_ROTATION: Final = float(np.radians(1.0))
"""Metres and radians RMS; a drawing of the bracket is better than a calibration less certain."""


def scaled_condition(covariance: Array) -> float:
    """Condition of a pose's normal equations, each parameter in units of its own certainty.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
        Of the pose.
    """
    sigma = np.sqrt(np.diag(covariance))
    return float(np.sqrt(np.linalg.cond(covariance / np.outer(sigma, sigma))))


def sample_residuals(
    names: list[str], estimate: LeastSquaresEstimate, settled: LeastSquaresEstimate
) -> tuple[SampleResidual, ...]:
    """Residuals of each profile, and the change of the result without it.

    Parameters
    ----------
    names : list of str
        Of the profiles, in order.
    estimate : LeastSquaresEstimate
        From these profiles.
    settled : LeastSquaresEstimate
        The same with the targets where the arm sees them; see `refit_targets`.
    """
    falls, steps = refine.leave_one_out_changes(estimate)
    found = []
    for i, name in enumerate(names):
        r = settled.stacked.residuals[settled.stacked.profile == i]
        off, misfit = _offset_and_tilt(r), np.sqrt(falls[i] / len(r))
        found.append(SampleResidual.from_changes(name, estimate.used[i], off, misfit, steps[i]))
    return tuple(found)


def _offset_and_tilt(r: Array) -> tuple[float, float | None]:
    """Of a line (2 residuals), an arc (3) or a roof (4: two lines)."""
    if len(r) == 3:
        return float(np.hypot(r[0], r[1])), None
    offsets, tilts = r[0::2], r[1::2]
    return float(offsets[np.argmax(np.abs(offsets))]), float(tilts[np.argmax(np.abs(tilts))])


def check_residuals(estimate: LeastSquaresEstimate, residuals: tuple[SampleResidual, ...]) -> float:
    """By how much residuals exceed the noise model: one unless that is significant.

    Parameters
    ----------
    estimate : LeastSquaresEstimate
        Of all profiles.
    residuals : tuple of SampleResidual
        Of its profiles, to name the worst.

    Raises
    ------
    CalibrationRefused
        If they are larger than any noise model within reason allows.
    """
    sigma_scale = estimate.sigma_scale
    if sigma_scale <= (MAX_SIGMA_SCALE if estimate.used.all() else MAX_SIGMA_SCALE_AFTER_REJECTION):
        return sigma_scale
    worst = sorted(residuals, key=lambda one: -one.misfit)[:3]
    shown = ", ".join(
        f"{one.name} ({1e3 * one.offset:+.2f} mm"
        + ("" if one.tilt is None else f", {np.degrees(one.tilt):+.2f}°")
        + ")"
        for one in worst
    )
    raise CalibrationRefused(
        "residuals that the noise model can't explain",
        f"they are {sigma_scale:.1f} times larger than stated range and pose noise allow; worst "
        f"are {shown}. Check the sensor's own calibration, that board and sensor sit tight and "
        "that each line belongs to its pose; or state the noise that this cell really has",
    )


def check_result_certainty(covariance: Array, advice: str) -> None:
    """Refuse a result that is worse than a drawing of the bracket.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
        Of T_f_s.
    advice : str
        What to do about it.

    Raises
    ------
    CalibrationRefused
        With how uncertain it is, and the limit.
    """
    sure = HandEyeUncertainty(covariance)
    if sure.position > MAX_SIGMA_POSITION or sure.rotation > MAX_SIGMA_ROTATION:
        raise CalibrationRefused(
            "too uncertain",
            f"the sensor's place is certain to {1e3 * sure.position:.2f} mm and "
            f"{np.degrees(sure.rotation):.2f}° only, the limits are "
            f"{1e3 * MAX_SIGMA_POSITION:g} mm and {np.degrees(MAX_SIGMA_ROTATION):g}°; {advice}",
        )


@dataclass(frozen=True, slots=True)
class FreshLineVerification:
    """How well a fresh line agrees with what a calibration predicts.

    Parameters
    ----------
    offset, sigma_offset : float
        Distance of its centroid from the plane and its standard deviation, in metres.
    tilt, sigma_tilt : float
        Angle out of the plane and its standard deviation, in radians.
    misfit : float
        Both together, in standard deviations (RMS of the two).
    limit : float
        The largest misfit that chance explains.
    """

    offset: float
    sigma_offset: float
    tilt: float
    sigma_tilt: float
    misfit: float
    limit: float

    @property
    def line_agrees(self) -> bool:
        """Whether the line is as the calibration predicts, within chance."""
        return self.misfit <= self.limit


def verify_with_fresh_line(
    board: SeenBoard, result: HandEyeCalibration, fresh: PosedFit[LineFit]
) -> FreshLineVerification:
    """Verify a calibration with a line that took no part in it.

    An error of arm or laser that is alike in all lines is no contradiction: the line may be off
    by its own errors, by errors of the calibration, and by errors that both have in common.

    Parameters
    ----------
    board : SeenBoard
        The lines that `result` was found from.
    result : HandEyeCalibration
        From them.
    fresh : PosedFit
        A line on the same board.
    """
    every = replace(board, samples=[*board.samples, fresh])
    used = np.array([*(one.used for one in result.residuals), False])
    plane, start = every.model_at_sensor_pose(result.T_f_s)
    model = CombinedModel((plane,), geometry_error_correlation(every.T_b_f), result.geometry)
    estimate = refine.refine_by_least_squares(model, result.T_f_s, start, used)
    r, covariance = refine.predicted_residuals(estimate, len(used) - 1)
    covariance = result.sigma_scale**2 * covariance
    sigma = np.sqrt(np.diag(covariance))
    misfit = np.sqrt(r @ np.linalg.solve(covariance, r) / 2)
    return FreshLineVerification(
        float(r[0]),
        float(sigma[0]),
        float(r[1]),
        float(sigma[1]),
        float(misfit),
        float(np.sqrt(chdtri(2, refine.FALSE_ALARM_PROBABILITY) / 2)),
    )


MAX_REFINED_STARTS: Final = 2
"""The nearest ones, for each other hypothesis about the poses."""
MAX_VARIANCE_SCALE: Final = 9.0
"""A hypothesis fits if no variance must be larger than stated by more than this."""
MAX_SWAPPED_PAIRS_TRIED: Final = 15
"""Pairs of rejected profiles whose poses are exchanged."""
PoseReadings = Mapping[str, Mapping[str, Array]]
"""Poses by other readings of their files, by the words for these and the names of profiles."""
POSE_ORDER_SHIFTS_TRIED: Final = 5
"""Ways to give profiles one another's poses."""


def check_pose_convention(
    problem: CalibrationProblem, solution: SensorSolution, readings: PoseReadings
) -> None:
    """Refuse poses that fit far better when read by another convention.

    Parameters
    ----------
    problem : CalibrationProblem
        The profiles.
    solution : SensorSolution
        With the poses as they were read.
    readings : mapping of str to mapping of str to ndarray, shape (4, 4)
        What the numbers of their files mean by other conventions, by the words for these and by
        the profiles' names.

    Raises
    ------
    CalibrationRefused
        With how they fit better.
    """
    if solution.whole.is_plausible:
        return
    stated = problem.invert_if_fixed(problem.T_b_f)
    others: dict[str, Array] = {}
    for name, T in chain(
        (
            (
                f"read {words}",
                np.array([T_b_f.get(*one) for one in zip(problem.names, stated, strict=True)]),
            )
            for words, T_b_f in readings.items()
        ),
        poses_by_other_conventions(stated).items(),
    ):
        if not any(np.allclose(T, known) for known in (stated, *others.values())):
            others[name] = T
    fits = {
        name: _fit_with_poses(problem, problem.invert_if_fixed(T)) for name, T in others.items()
    }
    name = min(fits, key=lambda one: _likelihood_cost(fits[one]))
    nearest = problem.with_poses(problem.invert_if_fixed(others[name]))
    best = nearest.fit(nearest.starts)[1]
    gain = _cost_of_stated_poses(solution) - _likelihood_cost(best)
    # If neither fits, the cause is another one.
    if gain > _likelihood_limit(len(fits)) and best.variance_scale < MAX_VARIANCE_SCALE:
        raise CalibrationRefused(
            "poses that were read in another way than they were meant",
            f"the profiles fit e^{gain / 2:.0f} times better to the same poses {name}; check which "
            "convention the file's angles have, and that they are poses of the flange in the base",
        )


def check_pose_pairing(problem: CalibrationProblem, solution: SensorSolution) -> None:
    """Refuse profiles that fit their own poses no better than one another's.

    Parameters
    ----------
    problem : CalibrationProblem
        The profiles.
    solution : SensorSolution
        With each profile's own pose.

    Raises
    ------
    CalibrationRefused
        If some other pairing is as good.
    """
    count = min(len(one.names) for one in problem.targets)
    if count <= 2 or (solution.whole.is_plausible and solution.estimate.used.all()):
        return
    costs = {}
    for shift in map(
        int, np.unique(np.linspace(1, count - 1, POSE_ORDER_SHIFTS_TRIED).astype(int))
    ):
        moved = np.concatenate([np.roll(one.T_b_f, shift, axis=0) for one in problem.targets])
        costs[shift] = _likelihood_cost(_fit_with_poses(problem, moved))
    best = min(costs, key=lambda one: costs[one])
    if costs[best] - _cost_of_stated_poses(solution) < _likelihood_limit(len(costs)):
        raise CalibrationRefused(
            "profiles that do not belong to their poses",
            f"they fit the poses {best} places further on about as well as their own; check that "
            "both lists begin with the same profile, that none is missing, and that the target "
            "stayed where it was",
        )


def swapped_pose_notes(problem: CalibrationProblem, solution: SensorSolution) -> tuple[str, ...]:
    """Name the rejected profiles that have each other's poses.

    Parameters
    ----------
    problem : CalibrationProblem
        The profiles.
    solution : SensorSolution
        Without the profiles that contradict the others.
    """
    pairs = list(combinations(np.flatnonzero(~solution.estimate.used), 2))[:MAX_SWAPPED_PAIRS_TRIED]
    notes, T, names = [], problem.T_b_f, problem.names
    for i, j in pairs:
        swapped = T.copy()
        swapped[[i, j]] = T[[j, i]]
        _, estimate = problem.with_poses(swapped).fit([solution.estimate.T_f_s], 1)
        gain = _likelihood_cost(solution.whole) - _likelihood_cost(estimate)
        if gain > _likelihood_limit(len(pairs)):
            notes.append(
                f"{names[i]} and {names[j]} fit with each other's poses: they were swapped"
            )
    return tuple(notes)


def _fit_with_poses(problem: CalibrationProblem, T_b_f: Array) -> LeastSquaresEstimate:
    """The fit to other poses, from the nearest of the starts that these give."""
    other = problem.with_poses(T_b_f)
    return other.fit(other.starts, MAX_REFINED_STARTS)[1]


def _cost_of_stated_poses(solution: SensorSolution) -> float:
    """Cost of the stated poses, if profiles may be left out at a price."""
    estimate = solution.estimate
    price = float(blame_thresholds(estimate)[~estimate.used].sum())
    return min(_likelihood_cost(solution.whole), _likelihood_cost(estimate) + price)


def _likelihood_cost(estimate: LeastSquaresEstimate) -> float:
    """Minus twice the log-likelihood, all errors being as much larger than stated as fits best."""
    widened = estimate.variance_scale
    return float(estimate.chi2 / widened + estimate.dof * np.log(widened))


def _likelihood_limit(count: int) -> float:
    """Limit of twice the logarithm of likelihoods for the best of so many."""
    return float(2 * np.log(count / refine.FALSE_ALARM_PROBABILITY))


def poses_by_other_conventions(T_b_f: Array) -> dict[str, Array]:
    """Poses that the same numbers mean under other conventions, by the words for these.

    They are the mistakes that are made when arms' files are converted.

    Parameters
    ----------
    T_b_f : ndarray, shape (n, 4, 4)
        Flange poses as they were read.
    """
    R = Rotation.from_matrix(T_b_f[:, :3, :3])
    zyx = R.as_euler("ZYX")
    quaternion = R.as_quat()
    turned = {
        "with the angles in the opposite order": Rotation.from_euler("ZYX", zyx[:, ::-1]),
        "with angles about fixed in place of moving axes": Rotation.from_euler("zyx", zyx),
        "with angles about moving x, y, z axes (write them as quaternions)": Rotation.from_euler(
            "XYZ", zyx
        ),
        "with a rotation vector in place of angles about z, y, x": Rotation.from_rotvec(
            zyx[:, ::-1]
        ),
        "with angles about z, y, x in place of a rotation vector": Rotation.from_euler(
            "ZYX", R.as_rotvec()[:, ::-1]
        ),
        "with the quaternion's scalar first in place of last": Rotation.from_quat(
            np.roll(quaternion, -1, axis=1)
        ),
        "with the quaternion's scalar last in place of first": Rotation.from_quat(
            np.roll(quaternion, 1, axis=1)
        ),
        "with every rotation inverted": R.inv(),
    }
    readings = {"inverted: of the base in the flange's frame": inverse_poses(T_b_f)}
    for name, rotation in turned.items():
        T = T_b_f.copy()
        T[:, :3, :3] = rotation.as_matrix()
        readings[name] = T
    return readings
