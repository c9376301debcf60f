"""How well the hand-eye calibration holds what it promises: Monte Carlo on a simulated hand."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from _board import BoardSimulator, points_rms
from _mistakes import KINDS, RADIUS, MistakeMaker
from _stopwatch import Stopwatch
from _table import Row, main
from _targets import TargetSimulator, calibrate_on_plane
from scipy.spatial.transform import Rotation

from tjscan.calibration.arm.calibrate import ArmModel, TargetInPostures, calibrate_arm
from tjscan.calibration.closed_form import PluckerPlane, plane_through_point, solve_closed_form
from tjscan.calibration.file import read_calibration
from tjscan.calibration.hand_eye import calibrate_on_targets
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.pose_files import pair_profiles_with_poses, read_flange_poses
from tjscan.calibration.result import HandEyeCalibration, HandEyeUncertainty
from tjscan.calibration.targets.ball import CircleFit, SeenBall, SphereTarget, fit_circle
from tjscan.calibration.targets.line import LineFit, fit_line, stack_lines
from tjscan.calibration.targets.plane import PlaneTarget, SeenBoard, fit_plane
from tjscan.calibration.targets.point import start_of_points
from tjscan.calibration.targets.roof import RoofFit, SeenRoof, fit_roof
from tjscan.calibration.targets.target import PosedFit, PosedProfile, fit_profiles
from tjscan.calibration.wizard.logbook import LaserLineTaken, MeasurementsSoFar
from tjscan.calibration.wizard.operator import DefaultAnswerOperator
from tjscan.calibration.wizard.session import BoardRectangle, CalibrationPlan, LinePredictor
from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, inverse_pose, pose, pose_from_rounded_matrix, transform_points
from tjscan.core.pose_vector import boxminus
from tjscan.job.files import read_calibration_job, read_scan_job
from tjscan.laser.faults import correlated_noise
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.laser.model import LaserModel, MeasuringRange
from tjscan.laser.profile import Profile
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance
from tjscan.runs.calibration.run import start_calibration
from tjscan.runs.scan.run import ScanContext, run_scan

EXAMPLES: Final = Path(__file__).resolve().parents[1] / "examples"
MM: Final = 1e-3
LINES: Final = 12
RUNS: Final = 1000
SPOILED_RUNS: Final = 240
SPOILED_BY: Final = 2 * MM
HALF_BOARD: Final = (0.15, 0.15)
"""Half the sides of the touched pattern, 3 x 3 points, in metres."""
TRACKER_SIGMA: Final = 4e-6
"""Metres, each axis."""
TRACKED_POSES: Final = 300
TRACKED_ARMS: Final = {
    "arm": ("ur5e", "ur10e", "ur20"),
    "arm of another make": ("kr5_arc", "irb1600_10_145", "m10ia"),
}
SETS: Final = 10
"""Of each kind of mistake; a set that fits no account takes seconds to refuse."""
QUICK_SETS: Final = 2
REAL: Final = Path(__file__).resolve().parents[2] / "shared" / "data" / "line-laser-calibration"
DATA: Final = Path(__file__).resolve().parents[2] / "shared" / "data" / "openlmd-lines"

T_F_S: Final = pose_from_rounded_matrix(  # the paper's eq. (26), in metres
    [
        [0.9999, -0.0129, -0.0002, -0.000749],
        [0.0129, 0.9999, 0.0082, -0.114845],
        [0.0001, -0.0082, 1.0, 0.167616],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
NOISE: Final = NoiseModel(
    range=0.03 * MM,
    position=0.05 * MM,
    rotation=float(np.radians(0.01)),
    touch=0.05 * MM,
    geometry=0.0,
)
OPENLMD_NOISE: Final = NoiseModel(range=0.15 * MM, correlation=60.0, geometry=0.0)
"""Assumption for those data: the lens was never calibrated, so errors vary slowly along a line, and
hold what the arm adds."""


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A board, nine places to touch it, and the default poses above it."""

    plane: PluckerPlane
    window: MeasuringRange
    places_b: Array
    target: PlaneTarget
    poses: Array

    @classmethod
    def set_up(cls) -> Stage:
        """The board that every run uses."""
        window = LaserModel().measuring_range
        centre = np.array((0.8, 0.1, 0.05))
        plane = plane_through_point(centre, (0.05, 0.02, 1.0))
        axes = PlaneTarget.from_unknown_plane(plane, centre).axes_b
        grid = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]) * HALF_BOARD
        places = centre + grid @ axes
        target = fit_plane(places, NOISE.touch, centre + plane.u)
        board = BoardRectangle.through_touched_points(places, target)
        hand = BoardSimulator(T_F_S, plane, window)
        return cls(plane, window, places, target, wizards_poses(hand, target, board))

    def touched(self, hand: BoardSimulator, rng: np.random.Generator) -> PlaneTarget:
        """The board as touched by a hand with errors."""
        return fit_plane(hand.touches(self.places_b, rng), NOISE.touch, self.poses[0, :3, 3])

    def profiles(self, hand: BoardSimulator, rng: np.random.Generator) -> list[Profile]:
        """One profile from each pose."""
        return [hand.profile(T_b_f, rng) for T_b_f in self.poses]


def wizards_poses(hand: BoardSimulator, target: PlaneTarget, board: BoardRectangle) -> Array:
    """The poses that the wizard goes to when the mount is known and every pose is in reach."""
    at = np.eye(4)
    at[:3, 3] = board.centre_b
    task = CalibrationPlan(
        at, board.half_sizes, np.zeros(3), hand.T_f_s, hand.window, NOISE, 9, LINES
    )
    measured, rng = MeasurementsSoFar(datetime.now(UTC), {}), np.random.default_rng(0)
    for k in range(LINES):
        result = task.progress(measured, target).result
        T_b_f = task.suggest_line_pose(measured, target, board, result, lambda _: True).T_b_f
        shot = PosedProfile(f"line {k + 1}", T_b_f, hand.profile(T_b_f, rng))
        measured = measured.with_entry(LaserLineTaken(shot))
    return np.stack([shot.T_b_f for shot in measured.line_profiles])


def samples(
    poses: Array, profiles: list[Profile], noise: NoiseModel = NOISE
) -> list[PosedFit[LineFit]]:
    return [
        PosedFit(f"line {i + 1}", T_b_f, fit_line(profile, noise))
        for i, (T_b_f, profile) in enumerate(zip(poses, profiles, strict=True))
    ]


def error(T_f_s: Array) -> Array:
    """Truth minus result, translation and rotation vector in the axes of f, shape (6,)."""
    turn = Rotation.from_matrix(T_F_S[:3, :3] @ T_f_s[:3, :3].T).as_rotvec()
    return np.concatenate((T_F_S[:3, 3] - T_f_s[:3, 3], turn))


def rms(errors: list[Array]) -> tuple[float, float]:
    """RMS length of the translation error in metres, and RMS angle in radians."""
    e = np.array(errors)
    position, rotation = (np.sqrt((part**2).sum(axis=1).mean()) for part in (e[:, :3], e[:, 3:]))
    return float(position), float(rotation)


def noise_free(stage: Stage) -> list[Row]:
    rng = np.random.default_rng(1)
    hand = BoardSimulator(T_F_S, stage.plane, stage.window)
    taken = samples(stage.poses, stage.profiles(hand, rng))
    result = calibrate_on_plane(taken, stage.target, NOISE)
    closed = solve_closed_form(stack_lines(stage.poses, [s.fit for s in taken]), stage.target.plane)
    return [
        Row("noise free, closed form: largest entry", worst(closed.T_f_s), 1e-9),
        Row("noise free, refined: largest entry", worst(result.T_f_s), 1e-9),
    ]


def worst(T_f_s: Array) -> float:
    return float(np.abs(T_f_s - T_F_S).max())


def monte_carlo(stage: Stage) -> list[Row]:
    rng = np.random.default_rng(2)
    hand = BoardSimulator(T_F_S, stage.plane, stage.window, NOISE)
    predicted = LinePredictor(T_F_S, stage.target, stage.window, NOISE)
    bound: HandEyeUncertainty = predicted.uncertainty(stage.poses)
    refined, closed, squares = [], [], []
    for _ in range(RUNS):
        target = stage.touched(hand, rng)
        result = calibrate_on_plane(samples(stage.poses, stage.profiles(hand, rng)), target, NOISE)
        refined.append(error(result.T_f_s))
        closed.append(error(closed_form_of(result)))
        squares.append(refined[-1] @ np.linalg.solve(result.covariance, refined[-1]) / 6)
    position, rotation = rms(refined)
    svd_position, svd_rotation = rms(closed)
    return [
        Row("RMS position error", position / MM, 0.12, "mm"),
        Row("RMS rotation error", float(np.degrees(rotation)), 0.03, "°"),
        Row("the same over the Cramér–Rao bound, position", position / bound.position, 1.2),
        Row("the same over the Cramér–Rao bound, rotation", rotation / bound.rotation, 1.2),
        Row("refined over closed form, position", position / svd_position, 1.0),
        Row("refined over closed form, rotation", rotation / svd_rotation, 1.0),
        Row("normalised error squared, 1,000 runs", float(np.mean(squares)), 1.1, "", 0.9),
        *spoiled(stage, hand, rng, position, rotation),
    ]


def closed_form_of(result: HandEyeCalibration) -> Array:
    if result.closed_form is None:
        raise ValueError("a touched plane has a closed form")
    return result.closed_form.T_f_s


def spoiled(
    stage: Stage, hand: BoardSimulator, rng: np.random.Generator, position: float, rotation: float
) -> list[Row]:
    """Move one line of twelve along z and see whether it is found."""
    errors, named = [], 0
    for i in range(SPOILED_RUNS):
        target, taken = stage.touched(hand, rng), stage.profiles(hand, rng)
        k = i % LINES
        taken[k] = Profile(taken[k].x_s, taken[k].z_s + SPOILED_BY * (-1) ** (i // LINES))
        result = calibrate_on_plane(samples(stage.poses, taken), target, NOISE)
        named += result.rejected_sample_names == (f"line {k + 1}",)
        errors.append(error(result.T_f_s))
    p, r = rms(errors)
    return [
        Row(
            "one line off by 2 mm: it, and only it, named", 100 * named / SPOILED_RUNS, 100, "%", 99
        ),
        Row("the same: position error over the clean one", p / position, 1.5),
        Row("the same: rotation error over the clean one", r / rotation, 1.5),
    ]


def timing(stage: Stage) -> list[Row]:
    rng = np.random.default_rng(3)
    hand = BoardSimulator(T_F_S, stage.plane, stage.window, NOISE)
    target, profiles = stage.touched(hand, rng), stage.profiles(hand, rng)
    closed, whole = Stopwatch(), Stopwatch()
    for _ in range(30):
        with closed:
            fits = [fit_line(profile, NOISE) for profile in profiles]
            solve_closed_form(stack_lines(stage.poses, fits), target.plane)
        with whole:
            calibrate_on_plane(samples(stage.poses, profiles), target, NOISE)
    return [
        closed.row("closed form, 12 lines of 640 points, line fits included", median, 5),
        whole.row("with refinement, line fits included", median, 100),
    ]


def refusals(stage: Stage) -> list[Row]:
    """Poses that can't work, and what the refusal must say."""
    rng = np.random.default_rng(4)
    hand = BoardSimulator(T_F_S, stage.plane, stage.window, NOISE)
    upright = upright_pose(stage)
    angles = np.radians(np.linspace(-25, 25, LINES))
    cases = {
        "only translations": (
            [moved(upright, 0.01 * rng.standard_normal(3), np.zeros(3)) for _ in angles],
            "only translations",
            "the sensor's x and y axes",
        ),
        "turns about y_s only": (
            [moved(upright, np.zeros(3), (0, a, 0)) for a in angles],
            "turns about one axis only",
            "tilt about the sensor's x axis",
        ),
        "turns about x_s only": (
            [moved(upright, np.zeros(3), (a, 0, 0)) for a in angles],
            "turns about one axis only",
            "tilt about the sensor's y axis",
        ),
        "turns about the board's normal only": (
            [moved(upright, np.zeros(3), (0, 0, 3 * a)) for a in angles],
            "turns about one axis only",
            "tilt about the sensor's x axis and the sensor's y axis",
        ),
    }
    rows = []
    for name, (poses, reason, advice) in cases.items():
        profiles = [hand.profile(T_b_f, rng) for T_b_f in poses]
        taken = samples(np.stack(poses), profiles)
        said = False
        try:
            calibrate_on_plane(taken, stage.touched(hand, rng), NOISE, T_f_s_guess=T_F_S)
        except CalibrationRefused as refusal:
            said = refusal.reason == reason and advice in refusal.evidence
        rows.append(Row(f"{name}: refused, missing motion named", float(said), 1, "", 1))
    return rows


def upright_pose(stage: Stage) -> Array:
    """Sensor pose T_b_s that looks straight at the middle of the board."""
    u, x = stage.plane.u, stage.target.axes_b[0]
    depth = 0.5 * (stage.window.near + stage.window.far)
    R = np.column_stack((x, np.cross(-u, x), -u))
    return pose(R, stage.target.centre_b + depth * u)


def moved(T_b_s: Array, by_b: Array, turn_s: tuple[float, float, float] | Array) -> Array:
    """Flange pose after a shift in b and a turn of the sensor about the line it sees."""
    depth = np.array((0, 0, 0.24))
    pivot = pose(None, depth) @ pose(Rotation.from_rotvec(turn_s).as_matrix()) @ pose(None, -depth)
    return np.asarray(pose(None, by_b) @ T_b_s @ pivot @ inverse_pose(T_F_S))


def recorded() -> list[Row]:
    """Real lines of openlmd/etna, where they lie beside the checkout."""
    if not DATA.is_dir():
        print(f"left out: no recorded lines at {DATA}", file=sys.stderr)
        return []
    root = openlmd("root")
    rms_root = points_rms(calibrate_on_plane(root, None, OPENLMD_NOISE), root) / MM
    refused = False
    try:
        calibrate_on_plane(openlmd("calib4"), None, OPENLMD_NOISE)
    except CalibrationRefused:
        refused = True
    return [
        Row("openlmd root, plane unknown: plane RMS", rms_root, 0.19, "mm"),
        Row("openlmd calib4: flagged as not to be trusted", float(refused), 1, "", 1),
    ]


def openlmd(name: str) -> list[PosedFit[LineFit]]:
    lines = np.loadtxt(DATA / f"{name}_profiles.csv", delimiter=",")
    found = []
    for frame, x, y, z, *quaternion in np.loadtxt(DATA / f"{name}_poses.csv", delimiter=","):
        rows = lines[lines[:, 0] == frame]
        profile = Profile(MM * rows[:, 4], MM * rows[:, 3])
        T_b_f = pose(Rotation.from_quat(quaternion).as_matrix(), MM * np.array((x, y, z)))
        found.append(PosedFit(f"frame {frame:.0f}", T_b_f, fit_line(profile, OPENLMD_NOISE)))
    return found


def end_to_end() -> list[Row]:
    """Calibrate with the wizard on the simulated cell, then scan the paper's joint with it."""
    with TemporaryDirectory() as folder:
        job = read_calibration_job(EXAMPLES / "calibrate.toml")
        start_calibration(
            job, EXAMPLES / "calibrate.toml", Path(folder) / "found", DefaultAnswerOperator()
        )
        file = Path(folder) / "found" / "calibration.toml"
        position, rotation = rms([error(read_calibration(file).T_f_s)])
        with_it = corner_error({"calibration.file": str(file)}, Path(folder) / "with it")
        with_truth = corner_error({}, Path(folder) / "with the truth")
    return [
        Row("wizard, truth hidden: position error", position / MM, 0.12, "mm"),
        Row("the same: rotation error", float(np.degrees(rotation)), 0.03, "°"),
        Row(
            "scan with that result: mean corner error over that with the truth",
            with_it - with_truth,
            0.1,
            "mm",
        ),
    ]


def corner_error(keys: dict[str, Any], folder: Path) -> float:
    """Mean corner error in millimetres of the paper's scan, with keys replaced."""
    file = EXAMPLES / "paper.toml"
    summary = run_scan(ScanContext(read_scan_job(file, keys), file), folder)
    if summary.corner_error_mm is None:
        raise SystemExit(f"{file} names no joint to compare with")
    return summary.corner_error_mm.mean


def real_sets() -> list[Row]:
    """A ball and a roof edge that one real sensor saw, where they lie beside the checkout."""
    if not REAL.is_dir():
        print(f"left out: no recorded ball and edge at {REAL}", file=sys.stderr)
        return []
    noise = NoiseModel()
    roofs, _ = fit_profiles(real_set("edge"), fit_roof, noise)
    balls = real_set("ball40")
    arcs, _ = fit_profiles(balls, fit_circle, noise)
    edge, ball = SeenRoof(roofs, noise), SeenBall(arcs, SphereTarget(0.040), noise)
    sets: list[list[SeenBoard | SeenBall | SeenRoof]] = [[edge], [ball], [edge, ball]]
    on_edge, on_ball, both = (
        calibrate_on_targets(seen, noise, check_conventions=True) for seen in sets
    )
    off = boxminus(on_ball.T_f_s, on_edge.T_f_s)
    apart = float(off @ np.linalg.solve(on_ball.covariance + on_edge.covariance, off))
    rows = [
        Row("real edge: points off its planes, RMS", roof_rms(on_edge, roofs) / MM, 0.10, "mm"),
        Row(
            "real ball: points off its surface, RMS",
            ball_rms(on_ball, arcs, balls) / MM,
            0.09,
            "mm",
        ),
        Row("edge and ball alone: difference squared over its covariance, /6", apart / 6, 2.1),
    ]
    for one, name in ((on_edge, "edge"), (on_ball, "ball")):
        off = boxminus(both.T_f_s, one.T_f_s)
        away = float(off @ np.linalg.solve(one.covariance, off)) / 6
        rows.append(Row(f"both together against the {name} alone, the same", away, 2.1))
    refused = 0
    for wrong in (-0.5 * MM, 0.5 * MM):
        try:
            calibrate_on_targets([SeenBall(arcs, SphereTarget(0.040 + wrong), noise)], noise)
        except CalibrationRefused as refusal:
            refused += "radius" in refusal.reason
    return [*rows, Row("real ball, radius stated 0.5 mm off: refused", refused / 2, 1, "", 1)]


def real_set(name: str) -> list[PosedProfile]:
    form = ProfileFormat(None, None, (), z_offset=0.0)
    profiles = read_profiles(REAL / f"{name}_profiles.csv", form).profiles
    poses = REAL / f"{name}_poses.csv"
    return pair_profiles_with_poses(profiles, read_flange_poses(poses), poses)


def roof_rms(result: HandEyeCalibration, taken: list[PosedFit[RoofFit]]) -> float:
    """RMS distance of the flanks' points from the planes, metres."""
    if result.roof is None:
        raise ValueError("a roof edge was calibrated on")
    squares, count = 0.0, 0
    for sample in taken:
        for fit, plane in (
            (sample.fit.left, result.roof.left),
            (sample.fit.right, result.roof.right),
        ):
            T = sample.T_b_f @ result.T_f_s
            offset = plane.plane.signed_distances(T[:3, :3] @ fit.point_s + T[:3, 3])
            tilt = plane.plane.u @ T[:3, :3] @ fit.direction_s
            each = offset**2 + (tilt * fit.span) ** 2 / 12 + fit.scatter**2
            squares, count = (
                squares + int(fit.inlier.sum()) * float(each),
                count + int(fit.inlier.sum()),
            )
    return float(np.sqrt(squares / count))


def ball_rms(
    result: HandEyeCalibration, taken: list[PosedFit[CircleFit]], profiles: list[PosedProfile]
) -> float:
    """RMS distance of the arcs' points from the ball, metres."""
    if result.centre_b is None or result.radius is None:
        raise ValueError("a ball was calibrated on")
    shots = {shot.name: shot.profile for shot in profiles}
    away = []
    for sample, residual in zip(taken, result.residuals, strict=True):
        if residual.used:
            on_arc, T = sample.fit.inlier, sample.T_b_f @ result.T_f_s
            x, z = shots[sample.name].x_s[on_arc], shots[sample.name].z_s[on_arc]
            points = transform_points(T, np.column_stack((x, np.zeros_like(x), z)))
            away.append(np.linalg.norm(points - result.centre_b, axis=1) - result.radius)
    return float(np.sqrt(np.mean(np.concatenate(away) ** 2)))


def straight_lines() -> list[Row]:
    """Straight lines of all lengths and roughnesses, offered as arcs."""
    refused = 0
    for seed in range(1000):
        rng = np.random.default_rng(seed)
        count, noise = (
            int(rng.integers(60, 640)),
            NoiseModel(range=rng.choice([0.01, 0.03, 0.15]) * MM),
        )
        along, angle = np.linspace(-0.5, 0.5, count) * rng.uniform(0.004, 0.1), rng.uniform(-1, 1)
        z = 0.24 + along * np.sin(angle)
        rough = noise.range * rng.choice([1, 1, 2])
        z += correlated_noise(rng, count, rough, noise.correlation)
        try:
            fit_circle(Profile(along * np.cos(angle), z), noise)
        except CalibrationRefused:
            refused += 1
    return [Row("straight lines refused as arcs, of 1,000", refused / 10, 100, "%", 100)]


def made_sets(count: int) -> list[Row]:
    """Sets with every mistake, and good ones, on arms drawn anew for each."""
    stage, noise = Stage.set_up(), NoiseModel()
    hand = TargetSimulator(T_F_S, stage.window, noise, RADIUS)
    maker = MistakeMaker(hand, noise, Kinematics.load("ur10e"))
    caught = {
        kind: sum(maker.verdict(seed, kind).caught for seed in range(count)) for kind in KINDS
    }
    bad = [100 * caught[kind] / count for kind in KINDS if kind != "good"]
    return [
        Row(f"good sets refused, of {count}", 100 * caught["good"] / count, 1, "%"),
        Row(
            f"sets with a mistake refused or named, of {count * len(bad)}",
            float(np.mean(bad)),
            100,
            "%",
            100,
        ),
    ]


def tracked_arms(which: str, seeds: range) -> list[Row]:
    """Arms whose joints' frames have moved, and the points that a tracker measures of them."""
    noise, tolerance = (
        NoiseModel(position=1e-7, rotation=1e-7, touch=TRACKER_SIGMA),
        PlacementTolerance(),
    )
    held_out, p_f = np.arange(TRACKED_POSES) % 5 == 2, np.array((0.06, -0.11, 0.14))
    before, after, farthest, squares = [], [], [], []
    for name in TRACKED_ARMS[which]:
        arm = Kinematics.load(name)
        lower, upper = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
        for seed in seeds:
            rng = np.random.default_rng(seed)
            T_t_b = pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-3, 3, 3))
            true = deviate_joint_frames(arm, tolerance.sigmas * rng.standard_normal((6, 6)))
            q = rng.uniform(lower, upper, (TRACKED_POSES, 6))
            points = [transform_points(T_t_b @ true.forward(one), p_f) for one in q]
            points += TRACKER_SIGMA * rng.standard_normal((TRACKED_POSES, 3))
            T_b_f = np.array([arm.forward(one) for one in q])
            model, start = start_of_points(np.array(points), T_b_f, noise)
            target = TargetInPostures(model, q, T_b_f, start)
            found = calibrate_arm(ArmModel(arm, (target,)), held_out, tolerance, np.eye(4))
            before.append(found.error_before)
            after.append(found.error_after)
            stacked = found.estimate.stacked
            for k in np.flatnonzero(held_out):
                own = stacked.profile == k
                r, J = stacked.residuals[own], stacked.jacobian[own]
                C = stacked.covariance[np.ix_(own, own)] + J @ found.estimate.covariance @ J.T
                squares.append(r @ np.linalg.solve(C, r) / 3)
                farthest.append(np.linalg.norm(r))
    return [
        Row(f"{which} by tracker points, held out: least before", min(before) / MM, np.inf, "mm"),
        Row("the same: largest error after (RMS of an arm)", max(after) / MM, 0.085, "mm"),
        Row("the same: largest error of a point after", float(max(farthest)) / MM, 0.085, "mm"),
        Row("the same: normalised error squared", float(np.mean(squares)), 1.1, "", 0.9),
    ]


def measure(quick: bool) -> list[Row]:
    if quick:
        return [
            *real_sets(),
            *straight_lines(),
            *recorded(),
            *(row for which in TRACKED_ARMS for row in tracked_arms(which, range(2))),
            *made_sets(QUICK_SETS),
        ]
    stage = Stage.set_up()
    return [
        *noise_free(stage),
        *monte_carlo(stage),
        *timing(stage),
        *refusals(stage),
        *end_to_end(),
        *recorded(),
        *real_sets(),
        *straight_lines(),
        *(row for which in TRACKED_ARMS for row in tracked_arms(which, range(10))),
        *made_sets(SETS),
    ]


if __name__ == "__main__":
    options = [word for word in sys.argv[1:] if word != "--quick"]
    quick = len(options) < len(sys.argv) - 1
    sys.exit(main("Hand-eye calibration of the laser", lambda: measure(quick), options))
