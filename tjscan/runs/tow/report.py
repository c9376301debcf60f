"""What the report of a run shows of its tow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.core.manifest import check_files_unaltered
from tjscan.job.tow.job import TowJob, read_tow_job
from tjscan.recording.journal import REPLAY_EVENT
from tjscan.result.chapter import (
    AnimatedLine,
    HeadlineNumber,
    Judgement,
    MovingDiscs,
    PlaneAnimation,
    ReportChapter,
    ReportChart,
    verdict_on,
)
from tjscan.result.directory import JOB_FILE
from tjscan.runs.tow.results import (
    RecordedTow,
    TowOutcome,
    clearance_from_discs,
    key_figures_in_words,
    read_recorded_tow,
)
from tjscan.towing.journal import TOW_RECORDING
from tjscan.towing.seam import Seam

MOST_CHART_POINTS: Final = 2000
"""Of a line in a chart."""

ANIMATION_FRAMES: Final = 400
"""Of the animation."""

SHAPE_SNAPSHOTS: Final = 8
"""Shapes that are drawn over one another."""

PUBLISHED_MEAN_OBJECTIVE: Final = 3.5
"""Mean of the objective in the paper's simulation, V-C."""

PUBLISHED_PLANNING_TIME_MS: Final = 1e3 / 22
"""Milliseconds of a plan in the paper, figure 10."""

MISTRUSTED_EVENTS: Final = ("stopped", "off plan", "slips", "moved", "noisy poses")
"""Events of vehicles that do not follow their commands, and of poses that are not as stated."""

OBJECTIVE_TERM_LABELS: Final = {
    "paper": "f",
    "bend": "bending",
    "obstacle": "obstacles",
    "change": "change",
    "pace": "pace of the vehicles",
}
"""What the parts of the objective are called in its chart."""


def tow_chapter(directory: Path) -> ReportChapter:
    """Make a tow's chapter of a report; see `tjscan.result.chapter.ChapterWriter`."""
    if not (directory / f"{TOW_RECORDING}.mcap").is_file():
        return ReportChapter()
    check_files_unaltered(directory / JOB_FILE)
    job, found = read_tow_job(directory / JOB_FILE), read_recorded_tow(directory)
    outcome = found.outcome(job)
    if outcome is None:
        return ReportChapter(findings=("Nothing was towed.",), events=found.events)
    return ReportChapter(
        facts=tuple(_tow_facts(job, outcome)),
        findings=tuple(_tow_findings(job, found, outcome)),
        headline=tuple(_tow_headline(job, outcome)),
        charts=tuple(_tow_charts(job, found)),
        events=found.events,
        animation=_cable_animation(job, found),
    )


def _tow_headline(job: TowJob, outcome: TowOutcome) -> Iterator[HeadlineNumber]:
    length = 1e3 * Seam(job.seam).length
    welded = f"{outcome.welded_mm or 0:.0f} of {length:.0f} mm of the seam are welded"
    yield verdict_on(outcome.complete, welded if length else "the cable was led as long as asked")
    limit = float(np.degrees(job.chain.joint_limit))
    bend, how = outcome.bend_deg, "bent"
    if bend is None:
        bend, how = outcome.planned_bend_deg or 0.0, "planned to bend"
    judged: Judgement = "good" if bend <= limit else "bad"
    yield HeadlineNumber(f"{bend:.1f}°", f"a joint is {how} at most; {limit:.1f}° may be", judged)
    if outcome.touches is not None:
        yield HeadlineNumber(
            f"{outcome.touches} touches",
            "of cable, vehicles, walls and what is about",
            "bad" if outcome.touches else "good",
        )
    if outcome.objective is not None:
        yield HeadlineNumber(f"{outcome.objective:.2f} of 100", "objective f of the paper, mean")


def _tow_facts(job: TowJob, outcome: TowOutcome) -> Iterator[tuple[str, str]]:
    seam = Seam(job.seam)
    yield "seam", f"{1e3 * seam.length:.0f} mm at {6e4 * job.seam.speed:g} mm/min"
    yield "cable", f"{job.cable.length:g} m in {job.cable.links} links"
    yield "vehicles", f"{job.vehicles.count} ({job.vehicles.driver}), method {job.method}"
    yield from key_figures_in_words(outcome.figures)


def _tow_findings(job: TowJob, found: RecordedTow, outcome: TowOutcome) -> Iterator[str]:
    if job.vehicles.driver == "simulated":
        yield "Simulated: no real vehicle towed this cable."
    for event in found.events:
        if event.name == REPLAY_EVENT:
            yield f"A replay, {event.detail}: what the method {job.method} would have planned."
        elif event.name == "stop":
            yield f"It was stopped: {event.detail}"
    found_out = {(e.name, e.detail.partition(":")[0]): e for e in reversed(found.events)}
    for (name, who), event in sorted(found_out.items(), key=lambda item: item[0][1]):
        if name in MISTRUSTED_EVENTS:
            yield f"{name.capitalize()}, {who}: {event.detail.partition(': ')[2]}."
    if not outcome.complete:
        yield f"Only {outcome.welded_mm:.0f} mm of the seam are welded."
    if outcome.touches:
        yield f"Something was touched, {outcome.touches} times."
    if (outcome.bend_deg or 0.0) > np.degrees(job.chain.joint_limit):
        yield (
            f"A joint was bent by {outcome.bend_deg:.1f}°, beyond the "
            f"{np.degrees(job.chain.joint_limit):.1f}° of the cable."
        )


def _tow_charts(job: TowJob, found: RecordedTow) -> Iterator[ReportChart]:
    cycles = found.cycles
    thin = slice(None, None, max(len(cycles) // MOST_CHART_POINTS, 1))
    time = np.array([cycle.time - cycles[0].time for cycle in cycles])[thin]

    def over_time(
        title: str, label: str, values: Sequence[float] | Array, **more: Any
    ) -> ReportChart:
        return ReportChart(title, "time / s", label, time, np.array(values)[thin], **more)

    yield from _snapshot_charts(job, found)
    title, of_100 = "objective of 100, as figures 9 (a) and 12 (a) of the paper", "weighted, of 100"
    caption = (
        "Dashed: the paper's mean in its simulation, whose loss functions are not printed; "
        "absolute values can't be compared."
    )
    for name, line in OBJECTIVE_TERM_LABELS.items():
        values = [getattr(cycle.plan.terms, name) for cycle in cycles]
        nominal = PUBLISHED_MEAN_OBJECTIVE if name == "paper" else None
        yield over_time(title, of_100, values, line=line, nominal=nominal, caption=caption)
    title = "constraint, as figures 9 (b) and 12 (b) of the paper"
    residuals = [1e6 * cycle.plan.constraint for cycle in cycles]
    yield over_time(title, "largest residual / µm or µrad", residuals)
    yield over_time(
        "time of a plan, as figure 10 of the paper",
        "time / ms",
        [1e3 * cycle.seconds for cycle in cycles],
        nominal=PUBLISHED_PLANNING_TIME_MS,
        caption="Estimate and optimisation together. Dashed: the paper's mean, 22 Hz.",
    )
    *vehicles, welder = np.array([np.hypot(c.asked[:, 0], c.asked[:, 2]) for c in cycles]).T
    named = {f"vehicle {number}": speeds for number, speeds in enumerate(vehicles, start=1)}
    for name, speeds in (named | {"welder": welder}).items():
        yield over_time("speed asked", "speed / (mm/s)", 1e3 * speeds, line=name)
    if all(len(cycle.forces) for cycle in cycles):
        title = "force of the cable on the vehicles, estimated"
        caption = "Mean of four seconds. Dashed: what a vehicle can pull with at most."
        forces = np.array([np.hypot(*cycle.forces.T) for cycle in cycles])
        for number, values in enumerate(forces.T, start=1):
            line, most = f"vehicle {number}", job.vehicles.force
            yield over_time(title, "force / N", values, line=line, nominal=most, caption=caption)
        tension = [cycle.tension for cycle in cycles]
        yield over_time("largest tension along the cable, estimated", "tension / N", tension)
    if found.truths:
        yield from _truth_charts(found, over_time)


def _truth_charts(found: RecordedTow, draw: Callable[..., ReportChart]) -> Iterator[ReportChart]:
    force = np.array([np.hypot(*truth.welder_force[:2]) for truth in found.truths])
    pulls = np.array([truth.vehicle_forces for truth in found.truths])
    yield draw("force of the cable on the welder", "force / N", force)
    for number, pull in enumerate(pulls.T, start=1):
        yield draw("pull of the vehicles", "force / N", pull, line=f"vehicle {number}")
    if all(len(truth.passers_by) for truth in found.truths):
        title = "distance of the cable from what moves, as figure 13 of the paper shows by pictures"
        near = [clearance_from_discs(truth.line, truth.passers_by) for truth in found.truths]
        yield draw(title, "distance / mm", 1e3 * np.array(near))


def _snapshot_charts(job: TowJob, found: RecordedTow) -> Iterator[ReportChart]:
    """Shapes of the cable on its way, x and y changed so that the seam is across the page."""
    title = "shapes on the way, as figures 8, 11 and 13 of the paper"
    caption = "The cable at evenly spaced times, in the area that it may use."
    polygons = (job.area.outline, *job.area.holes)
    lines = [("", np.array((*polygon, polygon[0]))) for polygon in polygons]
    for k in _evenly_picked(found, SHAPE_SNAPSHOTS):
        cycle = found.cycles[k]
        line = found.truths[k].line if found.truths else job.chain.line(cycle.plan.angles)
        lines.append((f"{cycle.time - found.cycles[0].time:.0f} s", line))
    for name, line in lines:
        x, y = -line[:, 1], line[:, 0]
        yield ReportChart(title, "-y / m", "x / m", x, y, line=name, caption=caption, plane=True)


def _evenly_picked(found: RecordedTow, count: int) -> Array:
    return np.unique(np.linspace(0, len(found.cycles) - 1, count).astype(int))


def _cable_animation(job: TowJob, found: RecordedTow) -> PlaneAnimation:
    picked = _evenly_picked(found, ANIMATION_FRAMES)
    cycles = [found.cycles[k] for k in picked]
    planned = np.array([job.chain.line(cycle.plan.angles) for cycle in cycles])
    estimate = np.array([job.chain.line(cycle.plan.estimate) for cycle in cycles])
    cable = AnimatedLine("estimated", "#222222", estimate)
    poses = np.array([cycle.poses for cycle in cycles])
    values = [
        ("objective f of 100", np.array([cycle.plan.terms.paper for cycle in cycles])),
        ("along the seam / mm", np.array([1e3 * cycle.along for cycle in cycles])),
        ("bend planned / °", np.degrees([np.abs(cycle.plan.angles).max() for cycle in cycles])),
    ]
    if found.truths:
        truths = [found.truths[k] for k in picked]
        cable = AnimatedLine("cable", "#222222", np.array([truth.line for truth in truths]))
        poses = np.array([truth.poses for truth in truths])
        force = np.array([np.hypot(*truth.welder_force[:2]) for truth in truths])
        values.append(("force on the welder / N", force))
    sizes = np.full((*poses.shape[:2], 1), job.vehicles.radius)
    vehicles = np.concatenate((poses[..., :2], sizes), axis=2)
    most = max(len(cycle.obstacles) for cycle in cycles)
    moving = np.full((len(cycles), most, 3), -1e3)
    moving[..., 2] = 0.0
    for frame, cycle in zip(moving, cycles, strict=True):
        frame[: len(cycle.obstacles)] = cycle.obstacles[:, :3]
    discs = [
        MovingDiscs("towing vehicles", "#2ca02c", vehicles[:, :-1]),
        MovingDiscs("welder", "#d62728", vehicles[:, -1:]),
    ]
    if most:
        discs.append(MovingDiscs("obstacles", "#ff7f0e", moving))
    return PlaneAnimation(
        "The tow",
        "Dotted red: the seam. Drag the slider, or press play.",
        np.array([cycle.time - cycles[0].time for cycle in cycles]),
        [np.array(ring) for ring in (job.area.outline, *job.area.holes)],
        Seam(job.seam).path.points,
        [cable, AnimatedLine("planned", "#1f77b4", planned, dashed=True)],
        discs,
        values,
        [cycle.wait for cycle in cycles],
    )
