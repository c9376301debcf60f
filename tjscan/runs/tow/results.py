"""What a tow leaves behind: ``tow.csv``, a row a plan, and ``tow.json``, its figures.

The figures hold a tow against the plan, and against the truth of a simulation.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array
from tjscan.job.tow.job import TowJob
from tjscan.recording.journal import RunEvent
from tjscan.result.directory import job_label_of_run
from tjscan.runs.run import read_result_file, write_result_table
from tjscan.study.trial import RunOutcome
from tjscan.towing.journal import WELDED_EVENT, TowCycle, TowTruth, read_tow
from tjscan.towing.seam import Seam

PLANS_FILE: Final = "tow.csv"
TOW_KEY_FIGURES_FILE: Final = "tow.json"

PlannedCycle = tuple[TowCycle, TowTruth | None]

PLAN_COLUMNS: Final[dict[str, Callable[[PlannedCycle], str]]] = {
    "time_s": lambda row: f"{row[0].time:.3f}",
    "along_mm": lambda row: f"{1e3 * row[0].along:.2f}",
    "pace": lambda row: f"{row[0].pace:.3f}",
    "bend": lambda row: f"{row[0].plan.terms.bend:.5f}",
    "obstacle": lambda row: f"{row[0].plan.terms.obstacle:.5f}",
    "change": lambda row: f"{row[0].plan.terms.change:.5f}",
    "pace_term": lambda row: f"{row[0].plan.terms.pace:.5f}",
    "constraint": lambda row: f"{row[0].plan.constraint:.2e}",
    "bend_deg": lambda row: f"{np.degrees(np.abs(row[0].plan.angles).max()):.3f}",
    "plan_ms": lambda row: f"{1e3 * row[0].seconds:.3f}",
    "asked_mm_s": lambda row: f"{fastest_asked_mm_s(row[0]):.2f}",
    "force_n": lambda row: "" if row[1] is None else f"{np.hypot(*row[1].welder_force[:2]):.2f}",
    "wait": lambda row: row[0].wait,
}
"""Columns of ``tow.csv``, and their cells of a cycle and of what a simulation knows then."""


def fastest_asked_mm_s(cycle: TowCycle) -> float:
    """Fastest speed that was asked of a towing vehicle in a cycle, mm/s."""
    asked = cycle.asked[:-1]
    return float(1e3 * np.hypot(asked[:, 0], asked[:, 2]).max(initial=0.0))


@dataclass(frozen=True, slots=True)
class RecordedTow:
    """What a tow recorded, sorted.

    Parameters
    ----------
    cycles : tuple of TowCycle
    truths : tuple of TowTruth
        One for each cycle, or none.
    events : tuple of RunEvent
    """

    cycles: tuple[TowCycle, ...]
    truths: tuple[TowTruth, ...]
    events: tuple[RunEvent, ...]

    @property
    def complete(self) -> bool:
        """Whether the whole seam was welded."""
        return any(event.name == WELDED_EVENT for event in self.events)

    def outcome(self, job: TowJob) -> TowOutcome | None:
        """What came of the tow; None if not even one cycle was recorded."""
        if not self.cycles:
            return None
        ended = self.complete, "", ""  # events tell why
        return outcome_of_tow(job, self.cycles, self.truths, ended)


def read_recorded_tow(directory: Path) -> RecordedTow:
    """Read what a tow recorded, over all its parts; raises as `read_tow` does."""
    entries = list(read_tow(directory))
    cycles = tuple(entry for entry in entries if isinstance(entry, TowCycle))
    truths = tuple(entry for entry in entries if isinstance(entry, TowTruth))
    events = tuple(entry for entry in entries if isinstance(entry, RunEvent))
    return RecordedTow(cycles, truths if len(truths) == len(cycles) else (), events)


def write_tow_results(directory: Path, job: TowJob) -> None:
    """Write the results of a tow from its recording, whole or cut off.

    Raises
    ------
    RecordingError
        If a file can't be written, or the recording is damaged.
    """
    recorded = read_recorded_tow(directory)
    outcome = recorded.outcome(job)
    truths = recorded.truths or [None] * len(recorded.cycles)
    rows = zip(recorded.cycles, truths, strict=True)
    content = {
        "job": job_label_of_run(directory),
        "figures": None if outcome is None else outcome.figures,
        "events": [[event.name, event.detail] for event in recorded.events],
    }
    with write_files_atomically(directory) as draft:
        write_result_table(draft / PLANS_FILE, directory, PLAN_COLUMNS, rows)
        (draft / TOW_KEY_FIGURES_FILE).write_text(
            json.dumps(content, indent=2) + "\n", encoding="utf-8"
        )


def read_tow_key_figures(directory: Path) -> dict[str, Any]:
    """Figures of a run, by name; empty if nothing was towed.

    Raises
    ------
    ConfigurationError
        If the directory holds none.
    """
    return read_result_file(
        directory / TOW_KEY_FIGURES_FILE,
        "the figures of a tow",
        lambda text: dict(json.loads(text)["figures"] or {}),
    )


def _figure_field(words: str, unit: str = "") -> Any:
    return field(default=None, metadata={"words": (words, unit)})


@dataclass(frozen=True, slots=True)
class TowOutcome(RunOutcome):
    """What came of a tow: why it ended, and figures; None without what they are of.

    Those from `bend_deg` on are of a simulation's truth.

    Parameters
    ----------
    complete, reason, detail
        As in `RunOutcome`; complete is a tow that welded the whole seam.
    welded_mm : float
        Of the seam.
    seconds, waited_s : float
        Of the whole tow, and of it with the welder waiting.
    plan_hz : float
        Plans a second that one processor would make: 1 over the mean time of one.
    plan_p99_ms : float
        99th percentile of a plan's time.
    real_time_factor : float
        Seconds of the tow for each of a processor that it took.
    objective, objective_max : float
        The paper's f of 100, mean and largest.
    constraint : float
        Largest residual of a plan, metres or radians.
    halts : int
        Cycles without a plan.
    asked_mm_s : float
        Fastest that a towing vehicle was asked to drive.
    planned_bend_deg, bend_deg : float
        Largest angle of a joint, as planned and as it was.
    force_mean_n, force_max_n : float
        Of the cable on the welder.
    pull_max_n : float
        Largest with which a vehicle drove against the floor.
    welder_off_mm : float
        Largest distance of the welder from its line.
    welder_late_mm : float
        Largest along the line, from where it was to be.
    followed_mm : float
        Mean distance of the towing vehicles from where they were to be.
    estimate_deg, estimate_mm : float
        Mean error of the estimated cable, of a joint and of a link.
    link_clearance_mm, body_clearance_mm : float
        Least of links, but for those free of it, and of towing vehicles' bodies, to walls, pillars
        and obstacles.
    passer_by_mm : float
        Least distance of cable and bodies from what moves.
    vehicle_gap_mm : float
        Least between two bodies.
    touches : int
        How often something touched.
    """

    welded_mm: float | None = _figure_field("seam welded", "mm")
    seconds: float | None = _figure_field("time", "s")
    waited_s: float | None = _figure_field("of it waiting", "s")
    plan_hz: float | None = _figure_field("plans, mean rate", "Hz")
    plan_p99_ms: float | None = _figure_field("a plan's time, 99 %", "ms")
    real_time_factor: float | None = _figure_field("real-time factor")
    objective: float | None = _figure_field("objective f, mean of 100")
    objective_max: float | None = _figure_field("objective f, largest")
    constraint: float | None = _figure_field("constraint, largest residual")
    halts: int | None = _figure_field("cycles without a plan")
    asked_mm_s: float | None = _figure_field("towing speed asked, fastest", "mm/s")
    planned_bend_deg: float | None = _figure_field("joint angle planned, largest", "°")
    bend_deg: float | None = _figure_field("joint angle, largest", "°")
    force_mean_n: float | None = _figure_field("force on the welder, mean", "N")
    force_max_n: float | None = _figure_field("force on the welder, largest", "N")
    pull_max_n: float | None = _figure_field("pull of a vehicle, largest", "N")
    welder_off_mm: float | None = _figure_field("welder off its line, largest", "mm")
    welder_late_mm: float | None = _figure_field("welder along its line, largest", "mm")
    followed_mm: float | None = _figure_field("vehicles off their poses, mean", "mm")
    estimate_deg: float | None = _figure_field("estimate of a joint, mean error", "°")
    estimate_mm: float | None = _figure_field("estimate of a link, mean error", "mm")
    link_clearance_mm: float | None = _figure_field("clearance of links, least", "mm")
    body_clearance_mm: float | None = _figure_field("clearance of bodies, least", "mm")
    passer_by_mm: float | None = _figure_field("distance to what moves, least", "mm")
    vehicle_gap_mm: float | None = _figure_field("gap between vehicles, least", "mm")
    touches: int | None = _figure_field("touches")

    @property
    def figures(self) -> dict[str, float | int | bool | None]:
        """Each figure by its name, and whether the seam is complete."""
        return {name: getattr(self, name) for name in KEY_FIGURE_LABELS}


KEY_FIGURE_LABELS: Final = {"complete": ("whole seam welded", "")} | {
    one.name: one.metadata["words"] for one in fields(TowOutcome) if one.metadata
}
"""What each figure is, in words, and its unit."""


def key_figures_in_words(figures: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What each known figure is, and its value with its unit."""
    for name, value in figures.items():
        if value is not None:
            words, unit = KEY_FIGURE_LABELS[name]
            text = f"{value:.4g}" if isinstance(value, float) else str(value)
            yield words, f"{text} {unit}".strip()


def outcome_of_tow(
    job: TowJob,
    cycles: Sequence[TowCycle],
    truths: Sequence[TowTruth],
    ended: tuple[bool, str, str],
) -> TowOutcome:
    """What came of a tow, from what was recorded of it; one cycle at least.

    Parameters
    ----------
    job : TowJob
    cycles : sequence of TowCycle
    truths : sequence of TowTruth
        One for each cycle, or none.
    ended : tuple of (bool, str, str)
        Whether it is complete, the reason and the detail of a `TowOutcome`.
    """
    elapsed = cycles[-1].time - cycles[0].time
    seconds = np.array([cycle.seconds for cycle in cycles])
    plans = [cycle.plan for cycle in cycles if not cycle.plan.halt]
    terms = np.array([plan.terms.paper for plan in plans] or [nan])
    bends = [np.abs(plan.angles).max() for plan in plans]
    # A part's processor time begins at zero.
    host = sum(b.host - (a.host if a.host <= b.host else 0.0) for a, b in pairwise(cycles))
    found = {
        "welded_mm": 1e3 * cycles[-1].along,
        "seconds": elapsed,
        "waited_s": float(sum(b.time - a.time for a, b in pairwise(cycles) if not b.pace)),
        "plan_hz": float(1 / seconds.mean()),
        "plan_p99_ms": float(1e3 * np.percentile(seconds, 99)),
        "real_time_factor": elapsed / host if host else nan,
        "objective": float(terms.mean()),
        "objective_max": float(terms.max()),
        "constraint": float(max((plan.constraint for plan in plans), default=nan)),
        "halts": len(cycles) - len(plans),
        "asked_mm_s": max(map(fastest_asked_mm_s, cycles)),
        "planned_bend_deg": float(np.degrees(max(bends, default=nan))),
    }
    found |= _figures_against_truth(job, cycles, truths) if truths else {}
    known: dict[str, Any] = {name: value for name, value in found.items() if value == value}
    return TowOutcome(*ended, **known)


def _figures_against_truth(
    job: TowJob, cycles: Sequence[TowCycle], truths: Sequence[TowTruth]
) -> dict[str, Any]:
    force = np.array([np.hypot(*truth.welder_force[:2]) for truth in truths])
    line = np.array([truth.line for truth in truths])
    poses = np.array([truth.poses for truth in truths])
    steps = np.diff(line, axis=1)
    headings = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    angles = np.diff(headings, axis=1, prepend=job.root.heading)
    angles = (angles + np.pi) % (2 * np.pi) - np.pi
    estimate = np.array([cycle.plan.estimate for cycle in cycles])
    estimated = np.array([job.chain.poses(one)[:, :2] for one in estimate])
    off, late = _welder_off_its_line(Seam(job.seam), cycles, poses)
    targets = np.array([cycle.targets for cycle in cycles])[:-1, :-1, :2]
    followed = np.linalg.norm(poses[1:, :-1, :2] - targets, axis=-1)
    link, body = _clearances_from_solids(job, line, poses)
    radius, none = job.vehicles.radius, np.zeros((0, 3))
    passers = [_passer_by_clearance(job, truth) for truth in truths if len(truth.passers_by)]
    return {
        "bend_deg": float(np.degrees(np.abs(angles).max())),
        "force_mean_n": float(force.mean()),
        "force_max_n": float(force.max()),
        "pull_max_n": float(max(truth.vehicle_forces.max() for truth in truths)),
        "welder_off_mm": 1e3 * off,
        "welder_late_mm": 1e3 * late,
        "followed_mm": float(1e3 * followed.mean()) if len(followed) else nan,
        "estimate_deg": float(np.degrees(np.abs(estimate - angles).mean())),
        "estimate_mm": float(1e3 * np.linalg.norm(estimated - line[:, 1:], axis=-1).mean()),
        "link_clearance_mm": 1e3 * link,
        "body_clearance_mm": 1e3 * body,
        "passer_by_mm": 1e3 * min(passers, default=nan),
        "vehicle_gap_mm": 1e3 * min(vehicles_apart(each, radius, none) for each in poses),
        "touches": sum(len(truth.touches) for truth in truths),
    }


def _welder_off_its_line(
    seam: Seam, cycles: Sequence[TowCycle], poses: Array
) -> tuple[float, float]:
    """Largest distance of the welder from its line, and along it, metres."""
    along, point_at = np.array([cycle.along for cycle in cycles[:-1]]), seam.path.point_at
    off = poses[1:, -1, :2] - point_at(along)
    if not seam.length:
        return float(np.hypot(*off.T).max(initial=0.0)), 0.0
    ways = point_at(along + 1e-3) - point_at(along - 1e-3)
    (x, y), (dx, dy) = (ways / np.hypot(*ways.T)[:, None]).T, off.T
    across, ahead = np.abs(x * dy - y * dx), np.abs(x * dx + y * dy)
    return float(across.max(initial=0.0)), float(ahead.max(initial=0.0))


def _clearances_from_solids(job: TowJob, line: Array, poses: Array) -> tuple[float, float]:
    """Least distance of links and of bodies from walls, pillars and obstacles that do not move."""
    from shapely import Point, Polygon, distance, linestrings, points, union_all

    fixed = [Point(o.points[0]).buffer(o.radius) for o in job.obstacles if not o.speed]
    floor = Polygon(job.area.outline, job.area.holes).difference(union_all(fixed))
    outside = Polygon(job.area.outline).buffer(10).difference(floor)
    free = job.limits.free_links
    link = distance(linestrings(line[:, free : line.shape[1] - free]), outside).min()
    body = distance(points(poses[:, :-1, :2]), outside).min() - job.vehicles.radius
    return float(link), float(body)


def clearance_from_discs(line: Array, discs: Array) -> float:
    """Least distance in metres of a line's corners, (n, 2), from discs x, y, radius, (m, 3)."""
    apart = np.linalg.norm(line[:, None, :2] - discs[None, :, :2], axis=2) - discs[:, 2]
    return float(apart.min())


def vehicles_apart(poses: Array, radius: float, discs: Array) -> float:
    """Least distance in metres between the rims of two vehicles, or of one and an obstacle.

    Parameters
    ----------
    poses : ndarray, shape (vehicles, 3)
    radius : float
        Of each vehicle, metres.
    discs : ndarray, shape (m, 3)
        x, y and radius of the obstacles.
    """
    between = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2) - 2 * radius
    np.fill_diagonal(between, np.inf)
    aside = np.linalg.norm(poses[:, None, :2] - discs[None, :, :2], axis=2) - radius - discs[:, 2]
    return float(min(between.min(initial=np.inf), aside.min(initial=np.inf)))


def _passer_by_clearance(job: TowJob, truth: TowTruth) -> float:
    """Least distance of cable and bodies from what moves, metres."""
    from shapely import LineString, distance, points

    at = points(truth.passers_by[:, :2])
    cable = distance(LineString(truth.line), at) - truth.passers_by[:, 2]
    apart = np.linalg.norm(truth.poses[:, None, :2] - truth.passers_by[None, :, :2], axis=-1)
    bodies = apart - truth.passers_by[:, 2] - job.vehicles.radius
    return float(min(cable.min(), bodies.min()))
