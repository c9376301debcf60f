"""The continuous scan of the paper's joint and of others: time, sections, corners, clocks, limits.

``--quick`` takes fewer seeds, joints and faults.
"""

from __future__ import annotations

import os
import sys
import time
import tomllib
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import tomli_w
from _following_over_rtde import over_rtde_rows
from _table import Row, main
from scipy.interpolate import make_interp_spline
from yard import JOB as YARD
from yard import WAYS as YARD_WAYS

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.frames import Array, JointOrBaseFrame, transform_points
from tjscan.core.version import program_code
from tjscan.groove.section import FROM_NEIGHBOURS
from tjscan.job.cell import motion_limits_of_job
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.laser.optics import SimulatedLaser
from tjscan.recording.journal import CombinedJournal, RunEvent
from tjscan.robot.following import JointMotion
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.robot.simulated_following import CONTROLLER_TICK, SimulatedFollowing
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.runs.scan.study import ScanOutcome
from tjscan.runs.tasks import study_backend_of_task
from tjscan.scanning.continuous import scanner as continuous_scanner
from tjscan.scanning.continuous.smoothing import finished_sections, smooth_corners
from tjscan.scanning.journal import ScanEvent, ScanResult, plan_is_fulfilled
from tjscan.scanning.plan import view_deviation
from tjscan.scanning.section import ProfileView, ScannedSection, SetPoint, Substep
from tjscan.scanning.sections_before import (
    PLANNING_SPACING,
    planning_sections,
)
from tjscan.scanning.target import correction_target_pose
from tjscan.study.plan import StudyPlan, plan_study
from tjscan.study.run import run_trial

EXAMPLES: Final = Path(__file__).resolve().parents[1] / "examples"
WAYS: Final = {"ccw": EXAMPLES / "paper.toml", "cw": EXAMPLES / "paper-clockwise.toml"}
SEEDS: Final = tuple(range(1, 9))
QUICK_SEEDS: Final = (1, 2)
CONTINUOUS: Final = {"scan.mode": "continuous"}
EXACT_ARM: Final = {
    "simulation.arm.repeatability_mm": 0,
    "simulation.arm.repeatability_deg": 0,
}
AT_REST: Final = 1e-3
"""Metres per second: slower is at rest."""
GIVEN: Final = 0.4
"""Millimetres: a corner stated better than that is given."""

WRONG: Final = 0.5
"""Millimetres: a corner further off is wrong."""

BESIDE_TACK: Final = 4.1
"""Millimetres from a tack's end to a section that is named with it, at most."""

PAPER_START_AZIMUTH: Final = -18.0
"""Degrees, in frame j: where the paper's counterclockwise scan is begun."""

YARD_SEEDS: Final = tuple(range(1, 5))
FAULTS: Final = 200
QUICK_FAULTS: Final = 6


@dataclass(frozen=True)
class Followed:
    """A continuous scan in the numbers that count here; millimetres, seconds, degrees.

    Parameters
    ----------
    time, rest : float
        From the second taught pose on to the end, and at rest within.
    sections : float
        Share of those that were there to be read.
    errors, smoothed : ndarray
        Of corners that are seen, as read and smoothed.
    clock : ndarray
        Errors of the profiles' times, milliseconds; first that of the shuttle over its sigma.
    places, angles : ndarray
        How far the groove is seen from where it is wanted, and the work angle, per section.
    excess : float
        Of set-points over a limit: the largest ratio.
    cores : float
        CPU time of fusing and reading over the time of the motion.
    stepwise, retreats : int
        Steps that were made from rest, and returns to the last section.
    """

    time: float
    rest: float
    sections: float
    errors: Array
    smoothed: Array
    clock: Array
    shuttle: tuple[float, float]
    places: Array
    angles: Array
    excess: float
    cores: float
    stepwise: int
    retreats: int


class Watched:
    """Watches what the scan under way hides: true times, set-points, CPU time of reading.

    Its parts are laid over the classes that the product uses, in this process.
    """

    def __init__(self) -> None:
        self.true_times: dict[bytes, float] = {}
        self.motions: dict[SimulatedFollowing, JointMotion] = {}
        self.reading = 0.0
        self._saved = (SimulatedLaser.stream, SimulatedFollowing.replace)
        self._take = continuous_scanner.ContinuousScanner._take

    def __enter__(self) -> Watched:
        stream, replace = self._saved
        watched, read = self, self._take

        def heard(laser: SimulatedLaser, period: float) -> Iterator[Any]:
            model = laser.model
            for streamed in stream(laser, period):
                profile = streamed.profile
                true = profile.time / (1.0 + model.clock_drift) - model.clock_offset
                watched.true_times[profile.digest] = true
                yield streamed

        def replaced(following: SimulatedFollowing, motion: JointMotion) -> None:
            replace(following, motion)
            watched.motions[following] = following._motion

        def timed(scanner: Any, *arguments: Any) -> None:
            start = time.process_time()
            try:
                read(scanner, *arguments)
            finally:
                watched.reading += time.process_time() - start

        SimulatedLaser.stream = heard  # type: ignore[method-assign,assignment]
        SimulatedFollowing.replace = replaced  # type: ignore[method-assign,assignment]
        continuous_scanner.ContinuousScanner._take = timed  # type: ignore[method-assign,assignment]
        return self

    def __exit__(self, *error: object) -> None:
        SimulatedLaser.stream, SimulatedFollowing.replace = self._saved  # type: ignore[method-assign]
        continuous_scanner.ContinuousScanner._take = self._take  # type: ignore[method-assign]


def from_second_pose(result: ScanResult) -> list[ProfileView]:
    """Profiles from the second taught pose on."""
    profiles = [view for view in result.views if view.substep is not Substep.FUSED]
    second = [i for i, v in enumerate(profiles) if v.substep is Substep.TAUGHT and v.index > 0]
    return profiles[second[0] :]


def corner_errors(sections: list[ScannedSection], corners: Array, context: ScanContext) -> Array:
    """Distances of corners, shape (n, 3, 3), from the edges, mm; NaN where one is not seen."""
    assert context.job.joint is not None
    assert context.joint is not None
    T_r_b = JointOrBaseFrame(context.job.joint.T_w_j).T_r_b
    points = np.array([section.points_b for section in sections])
    hidden = ~np.isfinite(corners[..., 0])
    hidden |= [[c in s.groove.absent for c in ("p2", "p3", "p4")] for s in sections]
    points[:, 1:4] = np.where(hidden[..., None], points[:, 1:4], corners)
    in_joint = transform_points(T_r_b, points.reshape(-1, 3)).reshape(points.shape)
    off = 1e3 * corner_to_edge_distances(in_joint, feature_edges(context.joint))
    return np.where(hidden, np.nan, off)


def follow(key: tuple[str, int, tuple[tuple[str, Any], ...]]) -> Followed:
    """Scan an example without stopping."""
    way, seed, others = key
    job = read_scan_job(WAYS[way], CONTINUOUS | {"simulation.seed": seed} | dict(others))
    context = ScanContext(job, WAYS[way])
    cell, events = context.make_cell(), []

    class Events:
        def record(self, message: object) -> None:
            if isinstance(message, RunEvent):
                events.append(message)

    with Watched() as watched:
        result = scan_in_cell(cell, job, Events())
    views = from_second_pose(result)
    times = np.array([view.time for view in views])
    origins = np.array([view.T_b_f[:3, 3] for view in views])
    speeds = np.linalg.norm(np.diff(origins, axis=0), axis=1) / np.diff(times)
    moving = np.flatnonzero(speeds > AT_REST)
    end = moving[-1] + 1
    whole = [s for s in result.sections if s.view.substep is Substep.FUSED]
    sections = [section for section in whole if section.view.time >= times[0]]
    read = np.array([section.points_b[1:4] for section in sections])
    clock = 1e3 * np.array(
        [
            v.time - watched.true_times[v.profile.digest]
            for v in views
            if v.profile.digest in watched.true_times
        ]
    )
    said = next(event.detail for event in events if event.name == ScanEvent.CLOCK)
    sigma = float(said.split("±")[1].split()[0])
    shuttles = [
        v for v in result.views if v.substep is Substep.PASSING and v.time < whole[0].view.time
    ]
    shuttle = 1e3 * float(
        np.mean([v.time - watched.true_times[v.profile.digest] for v in shuttles[:300]])
    )
    places, angles = views_of(sections, job.scan)
    return Followed(
        time=float(times[end] - times[0]),
        rest=float((speeds[:end] <= AT_REST).sum() * 5e-3),
        sections=len(result.sections)
        / (1 + round(groove_between(result) / job.scan.section_spacing)),
        errors=corner_errors(sections, read, context).ravel(),
        smoothed=corner_errors(sections, smooth_corners(sections), context).ravel(),
        clock=clock,
        shuttle=(shuttle, sigma),
        places=places,
        angles=angles,
        excess=excess_of(
            watched.motions.values(), cell.clearance.kinematics, motion_limits_of_job(job)
        ),
        cores=watched.reading / float(times[end] - times[0]),
        stepwise=result.counts.stepwise,
        retreats=result.counts.retreats,
    )


def groove_between(result: ScanResult) -> float:
    """Length of the groove from the first section to the last, by sections 8 mm apart."""
    origins = [result.sections[0].T_b_g[:3, 3]]
    for section in result.sections:
        if np.linalg.norm(section.T_b_g[:3, 3] - origins[-1]) >= PLANNING_SPACING:
            origins.append(section.T_b_g[:3, 3])
    origins.append(result.sections[-1].T_b_g[:3, 3])
    return float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())


def views_of(sections: list[ScannedSection], plan: Any) -> tuple[Array, Array]:
    """How far each section was seen from where it is wanted (mm), and off the work angle (deg)."""
    places, angles = [], []
    for k, section in enumerate(sections):
        origin = section.groove.T_s_g[:3, 3]
        places.append(1e3 * np.hypot(origin[0] - plan.offset, origin[2] - plan.standoff))
        before = planning_sections(sections[: k + 1])
        if len(before) > 1:
            T_s_t = plan.target_pose_in_sensor(section.groove.work_angle)
            ideal = SetPoint(correction_target_pose(before[-2].T_b_g, section.T_b_g), T_s_t)
            angles.append(abs(float(np.degrees(view_deviation(section, ideal)[3]))))
    return np.array(places), np.array(angles)


def excess_of(motions: Iterable[JointMotion], arm: Kinematics, limits: MotionLimits) -> float:
    """Largest ratio of speed or acceleration of the set-points to its limit."""
    worst = 0.0
    for motion in motions:
        ticks = np.arange(motion.times[0], motion.end, CONTROLLER_TICK)
        q, _speed = motion.at(ticks)
        points = np.array([arm.forward(one)[:3, 3] for one in q])
        speed, moved = (np.diff(v, axis=0) / CONTROLLER_TICK for v in (q, points))
        quick, pushed = (np.diff(v, axis=0) / CONTROLLER_TICK for v in (speed, moved))
        worst = max(
            worst,
            float((np.abs(speed) / (limits.joint_speed * arm.velocity)).max()),
            float(np.abs(quick).max() / limits.joint_acceleration),
            float(np.linalg.norm(moved, axis=1).max() / limits.tcp_speed),
            float(np.linalg.norm(pushed, axis=1).max() / limits.tcp_acceleration),
        )
    return worst


def step_time(key: tuple[str, int]) -> float:
    """Motion time of the paper's case 3 at 40 mm, seconds."""
    way, seed = key
    job = read_scan_job(WAYS[way], {"simulation.seed": seed})
    result = scan_in_cell(ScanContext(job, WAYS[way]).make_cell(), job, CombinedJournal())
    views = from_second_pose(result)
    return views[-1].time - views[0].time


def trials(tables: dict[str, Any]) -> list[tuple[StudyPlan, int]]:
    """Scans of a study."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "study.toml"
        file.write_text(tomli_w.dumps(tables))
        plan = plan_study(file, study_backend_of_task)
    return [(plan, index) for index in range(len(plan))]


def trials_of_joints(*, thin: bool) -> list[tuple[StudyPlan, int]]:
    """The example's study of joints, both ways; of fewer joints if `thin`."""
    plan = tomllib.loads((EXAMPLES / "continuous-study.toml").read_text())
    plan["job"] = str(EXAMPLES / plan["job"])
    if thin:
        plan["grid"]["rule"]["leg_to_brace"] = [1.05, 2.0]
        plan["grid"]["joint"]["brace"]["angle_deg"] = [75.0]
        each = plan["together"][0]
        for table, name in (("brace", "outer_diameter_mm"), ("brace", "wall_mm")):
            each["joint"][table][name] = each["joint"][table][name][1::8]
        for name in ("near_mm", "far_mm"):
            each["laser"][name] = each["laser"][name][1::8]
        each["simulation"]["laser"]["noise_mm"] = each["simulation"]["laser"]["noise_mm"][1::8]
    return trials(plan)


def trials_of_others(mode: str) -> list[tuple[StudyPlan, int]]:
    """Four joints where the paper's stands, from where that is begun on: as far as the arm reaches.

    Nothing is kept clear of but what was scanned.
    """
    cell = tomllib.loads(WAYS["ccw"].read_text())
    place = {name: cell["joint"][name] for name in ("position_mm", "euler_zyx_deg")}
    study = tomllib.loads((EXAMPLES / "continuous-study.toml").read_text())
    rule = {
        "room_mm": 150.0,
        "leg_wall_to_brace_wall": 1.0,
        "hand_mm": 3.0,
        "hand_deg": 3.0,
        "centre_view": True,
    }
    plan = {
        "job": str(EXAMPLES / study["job"]),
        "fixed": {
            "scan": {"mode": mode, "step_mm": 40.0},
            "rule": rule | {"start_azimuth_deg": PAPER_START_AZIMUTH},
            "joint": place | {"groove": study["fixed"]["joint"]["groove"]},
            "simulation": {"arm": {"home_deg": cell["simulation"]["arm"]["home_deg"]}},
        },
        "together": [
            {
                "joint": {
                    "leg": {"outer_diameter_mm": [508.0, 762.0, 406.4, 600.0]},
                    "brace": {
                        "outer_diameter_mm": [323.9, 711.0, 323.9, 457.2],
                        "wall_mm": [16.0, 20.0, 16.0, 25.4],
                        "angle_deg": [90.0, 90.0, 90.0, 60.0],
                    },
                },
                "scan": {"length_mm": [400.0, 240.0, 400.0, 560.0]},
            }
        ],
    }
    return trials(plan)


def outcome_of(trial: tuple[StudyPlan, int]) -> ScanOutcome:
    """Of a scan of a study."""
    plan, index = trial
    outcome = run_trial(plan[index], plan, study_backend_of_task, program_code()).outcome
    assert isinstance(outcome, ScanOutcome)
    return outcome


def rows_of_joints(
    found: list[ScanOutcome], others: list[ScanOutcome], steps: list[ScanOutcome]
) -> Iterator[Row]:
    """Joints of many sizes, both ways; and four others, beside their steps of case 3."""
    whole = [one for one in found if one.complete]
    name = f"{len(found)} joints and ways"
    yield Row(f"{name}: complete", len(whole) / len(found), np.inf, at_least=0.99)
    far = sum((one.corner_p95_mm or np.inf) > GIVEN for one in whole)
    yield Row(f"{name}: corners' p95 over {GIVEN} mm", far, 0)
    yield Row(f"{name}: with steps from rest", sum(one.stepwise > 0 for one in found), np.inf)
    ratios = [
        (one.motion_time_s or np.inf) / (peer.motion_time_s or np.nan)
        if one.complete and peer.complete
        else np.inf
        for one, peer in zip(others, steps, strict=True)
    ]
    yield Row("motion time over case 3 at 40 mm, worst of four other joints", max(ratios), 0.45)


@dataclass(frozen=True)
class FollowedYard:
    """A continuous scan of the yard's joint.

    Parameters
    ----------
    sections : int
        Of the result.
    read : float
        Share of a section every 2 mm that they are; 0 if the scan did not end as asked.
    single, wrong, sure, smoothed : int
        Sections off tacks with a corner over `WRONG` off: as read singly; as given; of those stated
        better than `GIVEN`; smoothed.
    by_neighbours : int
        Sections with a corner that is given by its neighbours.
    unnamed, beside : int
        Sections on a tack that are not named, and named ones further than `BESIDE_TACK` from one.
    fallbacks : int
        Steps from rest and returns.
    """

    sections: int
    read: float
    single: int
    wrong: int
    sure: int
    smoothed: int
    by_neighbours: int
    unnamed: int
    beside: int
    fallbacks: int


def follow_yard(key: tuple[str, int]) -> FollowedYard:
    """Scan the yard's joint without stopping."""
    way, seed = key
    job = read_scan_job(YARD, YARD_WAYS[way] | CONTINUOUS | {"simulation.seed": seed})
    context = ScanContext(job, YARD)
    assert job.joint is not None
    assert context.joint is not None
    result = scan_in_cell(context.make_cell(), job, CombinedJournal())
    sections = list(finished_sections(result.sections))
    read = np.array([section.points_b[1:4] for section in sections])
    errors = corner_errors(sections, read, context)
    smoothed = corner_errors(sections, smooth_corners(sections), context)
    singly = np.array([section.points_b[1:4] for section in result.sections])
    single = corner_errors(sections, singly, context)
    covariances = np.array([section.groove.corner_covariances_s for section in sections])
    sure = 1e3 * np.sqrt(np.trace(covariances, axis1=2, axis2=3)) < GIVEN
    T_r_b = JointOrBaseFrame(job.joint.T_w_j).T_r_b
    edges, roots = (
        feature_edges(context.joint),
        [transform_points(T_r_b, read[:, k]) for k in (1, 2)],
    )
    covered = edges.on_tack(roots[0]) | edges.on_tack(roots[1])
    named = np.array([section.groove.on_tack for section in sections])
    places = np.arange(0.0, len(sections) - 1.0, 0.05)
    fine = [make_interp_spline(range(len(sections)), one, k=1)(places) for one in roots]
    tacks = fine[0][edges.on_tack(fine[0]) | edges.on_tack(fine[1])]
    away = 1e3 * np.linalg.norm(roots[0][:, None] - tacks, axis=2).min(axis=1)
    done = plan_is_fulfilled(result.stop, job.scan)
    asked = 1 + groove_between(result) / job.scan.section_spacing
    alone, wrong, stated, smooth = (
        int((off[~named] > WRONG).any(axis=1).sum())
        for off in (single, errors, np.where(sure, errors, 0.0), smoothed)
    )
    return FollowedYard(
        sections=len(sections),
        read=len(sections) / asked if done else 0.0,
        single=alone,
        wrong=wrong,
        sure=stated,
        smoothed=smooth,
        by_neighbours=sum(FROM_NEIGHBOURS in section.groove.conditions for section in sections),
        unnamed=int((covered & ~named).sum()),
        beside=int((named & (away > BESIDE_TACK)).sum()),
        fallbacks=result.counts.stepwise + result.counts.retreats,
    )


def rows_of_yard(found: list[FollowedYard]) -> Iterator[Row]:
    """The yard's joint, both ways."""
    total = {name: sum(getattr(one, name) for one in found) for name in vars(found[0])}
    name = f"yard, {total['sections']} sections of {len(found)} scans"
    yield Row(f"{name}: read, worst", min(one.read for one in found), np.inf, at_least=0.97)
    yield Row(f"yard: a corner over {WRONG} mm wrong off tacks, as given", total["wrong"], 0)
    yield Row("yard: … as read singly", total["single"], np.inf)
    yield Row("yard: with a corner given by its neighbours", total["by_neighbours"], np.inf)
    yield Row(f"yard: … of those stated better than {GIVEN} mm", total["sure"], 0)
    yield Row("yard: … smoothed", total["smoothed"], 0)
    yield Row("yard: on a tack and not named", total["unnamed"], 0)
    yield Row("yard: named over 4 mm from a tack", total["beside"], 0)
    yield Row("yard: steps from rest and returns", total["fallbacks"], np.inf)


def measure(*, quick: bool) -> list[Row]:
    """Measure every bar."""
    seeds = QUICK_SEEDS if quick else SEEDS
    plain = [(way, seed, ()) for way, seed in product(WAYS, seeds)]
    exact = [(way, seed, tuple(EXACT_ARM.items())) for way, seed in product(WAYS, seeds)]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(follow, plain))
        without = list(pool.map(follow, exact))
        steps = list(pool.map(step_time, product(WAYS, seeds)))
        yard = list(pool.map(follow_yard, product(YARD_WAYS, YARD_SEEDS[: 1 if quick else None])))
        joints, *others = (
            list(pool.map(outcome_of, some))
            for some in (
                trials_of_joints(thin=quick),
                trials_of_others("continuous"),
                trials_of_others("stepwise"),
            )
        )
    ratios = [one.time / peer for one, peer in zip(found, steps, strict=True)]
    errors, off, smooth = (
        np.concatenate([getattr(one, name) for one in runs])
        for runs, name in ((found, "errors"), (without, "errors"), (without, "smoothed"))
    )
    clocks = np.concatenate([one.clock for one in found])
    shuttle = np.array([one.shuttle for one in found])
    far = np.concatenate([one.places[40:] for one in found])
    places, angles = (np.concatenate([getattr(o, n) for o in found]) for n in ("places", "angles"))

    def p95(values: Array) -> float:
        return float(np.nanpercentile(values, 95))

    runs = f"{len(plain)} runs"
    return [
        Row(f"motion time over case 3 at 40 mm, worst of {runs}", max(ratios), 0.36),
        Row("motion time, median", median(one.time for one in found), np.inf, "s"),
        Row(
            "at rest between the second pose and the end, worst", max(o.rest for o in found), 0, "s"
        ),
        Row("steps from rest, all runs", sum(o.stepwise for o in found), 0),
        Row("returns to the last section, all runs", sum(o.retreats for o in found), 0),
        Row("sections, worst", min(o.sections for o in found), np.inf, at_least=0.995),
        Row("corners, mean", float(np.nanmean(errors)), 0.055, "mm"),
        Row("corners, p95", p95(errors), 0.11, "mm"),
        Row("corners, exact arm, mean", float(np.nanmean(off)), 0.03, "mm"),
        Row("corners, exact arm, p95", p95(off), 0.05, "mm"),
        Row("corners, exact arm, smoothed, mean", float(np.nanmean(smooth)), 0.025, "mm"),
        Row("corners, exact arm, smoothed, p95", p95(smooth), 0.04, "mm"),
        Row("clock at the shuttle, p95", p95(np.abs(shuttle[:, 0])), 0.3, "ms"),
        Row("clock at every profile, largest", float(np.abs(clocks).max()), 0.5, "ms"),
        Row(
            "z² of the shuttle's sigma",
            float(np.mean((shuttle[:, 0] / shuttle[:, 1]) ** 2)),
            2,
            at_least=0.5,
        ),
        Row("place in the view, p95", p95(places), 3, "mm"),
        Row("place in the view after 80 mm, p95", p95(far), 2, "mm"),
        Row("work angle off, p95", p95(angles), 3, "deg"),
        Row("set-point over its limit, largest ratio", max(o.excess for o in found), 1.02),
        Row("cores for fusing and reading, median", median(o.cores for o in found), 0.5),
        *rows_of_yard(yard),
        *over_rtde_rows(QUICK_FAULTS if quick else FAULTS),
        *rows_of_joints(joints, *others),
    ]


if __name__ == "__main__":
    arguments = sys.argv[1:]
    measured = partial(measure, quick="--quick" in arguments)
    sys.exit(main("continuous scan", measured, [a for a in arguments if a != "--quick"]))
