"""Tow a cable along a seam as a job states, go on with an interrupted tow, or replay one."""

from __future__ import annotations

import time as host
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w

from tjscan.core.config import add_file_to_errors, table_to_dict
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.job.tow.cell import (
    TowCell,
    check_seam,
    fixed_obstacles,
    make_shape_planner,
    make_tow_cell,
)
from tjscan.job.tow.job import TowJob, read_tow_job
from tjscan.recording.journal import REPLAY_EVENT, Journal, RunEvent, event_recorder
from tjscan.recording.reader import read_job_snapshot
from tjscan.result.directory import JOB_FILE
from tjscan.runs import run
from tjscan.runs.tow.results import read_recorded_tow, write_tow_results
from tjscan.towing.journal import (
    TOW_RECORDING,
    WELDED_EVENT,
    TowCycle,
    TowRecording,
    TowTruth,
    read_tow,
)
from tjscan.towing.loop import PLAN_PERIOD, CableTow, TowSetup
from tjscan.towing.seam import Seam
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.shape.plan import PlanInputs, PoseAccuracy, ShapePlanner, TowingPlan

RESUMABLE_KEYS: Final = (
    "method",
    "weights",
    "targets",
    "limits",
    "following",
    "localisation",
    "area",
    "obstacles",
    "seam.speed_mm_min",
    "seam.stand_s",
    "vehicles.driver",
    "vehicles.mqtt",
    "simulation",
)
"""Tables and keys that may change while a tow goes on: none is about the cable's shape."""


@dataclass(frozen=True)
class TowContext(run.JobContext[TowJob]):
    """A tow job with its file, and where its run reports to; see `JobContext`.

    Parameters
    ----------
    show_truth : callable, optional
        Is given what a simulation knows, each time that it is recorded.
    show_planned : callable, optional
        Is given the share of the seam that is planned before anything moves.
    """

    show_truth: Callable[[TowTruth], object] | None = None
    show_planned: Callable[[float], object] = bool

    def truth_of(self, cell: TowCell) -> Callable[[], TowTruth] | None:
        """What a recording asks for the truth of a simulation; None for a real team."""
        truth, show = cell.truth, self.show_truth
        if truth is None or show is None:
            return truth

        def shown_truth() -> TowTruth:
            show(found := truth())
            return found

        return shown_truth


def make_tow(job: TowJob, cell: TowCell, planner: ShapePlanner, journal: Journal) -> CableTow:
    """Make the loop of a job for a cell whose devices are connected."""
    setting = TowSetup(
        job.chain,
        job.team,
        Seam(job.seam),
        job.localisation,
        job.following,
        cell.obstacles,
        clearance=job.limits.vehicle_clearance,
    )
    return CableTow(cell.team, cell.localisation, setting, planner, journal)


def run_tow(context: TowContext, directory: Path) -> None:
    """Tow as a job states, into a new run directory.

    Raises
    ------
    TjscanError
        If the job is wrong, the tow is halted or a device fails; the recording holds what
        happened until then, and the results are written from it.
    """
    job = context.job
    with add_file_to_errors(context.job_file):
        planner = make_shape_planner(job)
        sweep = check_seam(job, planner, show=context.show_planned)
        sweep.refuse_if_blocked()
        cell = make_tow_cell(job, sweep.start.angles)
        run.make_vehicle_run_directory(directory, context)
    _record_tow(context, directory, cell, planner, 0.0, sweep.start)


def resume_tow(context: TowContext) -> None:
    """Go on with an interrupted tow, in its run directory.

    Raises
    ------
    ConfigurationError
        If there is nothing to go on with, or the job was edited: to keys other than
        `RESUMABLE_KEYS`, or so that the cable can't follow along the rest of the seam.
    """
    directory = context.job_file.parent
    recorded = read_recorded_tow(directory)
    if any(event.name == REPLAY_EVENT for event in recorded.events):
        reason = "is a replay: nothing was towed there. Resume the tow itself"
        raise ConfigurationError(reason, file=directory)
    if recorded.complete:
        raise ConfigurationError("the whole seam is welded: nothing is left to do", file=directory)
    if not recorded.cycles:
        reason = "nothing was towed: there is nothing to go on with. Start a new tow"
        raise ConfigurationError(reason, file=directory)
    last = next((c for c in reversed(recorded.cycles) if not c.plan.halt), recorded.cycles[-1])
    is_edited = _is_job_edited(directory)
    with add_file_to_errors(context.job_file):
        planner = make_shape_planner(context.job)
        if is_edited:
            check_seam(context.job, planner, last.along, last.plan).refuse_if_blocked()
        left = recorded.truths[-1] if recorded.truths else None
        cell = make_tow_cell(context.job, last.plan.angles, left)
    hauled = PLAN_PERIOD * sum(cycle.pace > 0 for cycle in recorded.cycles)
    _record_tow(context, directory, cell, planner, last.along, last.plan, hauled)


def _is_job_edited(directory: Path) -> bool:
    """Whether the job of a tow is another than when it was recorded.

    Raises
    ------
    ConfigurationError
        If a key other than `RESUMABLE_KEYS` is.
    """
    before = read_job_snapshot(directory, TOW_RECORDING)
    if before is None:
        return False
    now = run.job_snapshot_of_file(directory / JOB_FILE)
    advice = (
        "The cable has the shape in which it was left: put it back, or start a new tow. "
        f"What may change: {', '.join(RESUMABLE_KEYS)}"
    )
    return bool(run.check_job_changes(before, now, RESUMABLE_KEYS, advice, directory / JOB_FILE))


def _record_tow(
    context: TowContext,
    directory: Path,
    cell: TowCell,
    planner: ShapePlanner,
    along: float,
    last: TowingPlan,
    hauled: float = 0.0,
) -> None:
    """Tow, record, and write the results, however it ended."""
    record = partial(TowRecording, truth=context.truth_of(cell))
    results = partial(write_tow_results, job=context.job)
    with run.record_vehicle_run(context, directory, TOW_RECORDING, record, results) as journal:
        run.accept_edited_copies(directory, journal)
        cell.report_events_to(event_recorder(journal))
        with cell:
            make_tow(context.job, cell, planner, journal).run(along, last, hauled)


REPLAYABLE_KEYS: Final = ("method", "weights.", "targets.", "limits.")
"""Keys of what a planner makes of poses, not of how the tow was done."""


def replay_tow(
    directory: Path,
    overrides: dict[str, Any],
    out: Path,
    finished: run.WhenFinished = run.do_nothing,
) -> None:
    """Plan a recorded tow again from the poses as they were estimated, into a run directory.

    Speeds asked follow from the steps from plan to plan, for no vehicle follows them. If the
    planner finds no plan, the tow would have halted, and its seam was not welded.

    Parameters
    ----------
    directory : Path
        Of the tow, whole, cut short or resumed; it stays as it is.
    overrides : dict
        Dotted keys and values, from `REPLAYABLE_KEYS` only.
    out : Path
        The directory to make.
    finished : callable
        Is called with it once its results are written.

    Raises
    ------
    ConfigurationError
        If there is no tow, or a key is about how it was done.
    RecordingError
        If its recording is damaged, or the new directory can't be written.
    """
    job_file = directory / JOB_FILE
    run.check_replay(directory, out, overrides, REPLAYABLE_KEYS, "tow")
    context = TowContext(read_tow_job(job_file, overrides), job_file, finished=finished)
    with add_file_to_errors(job_file):
        planner = make_shape_planner(context.job)
    entries = list(read_tow(directory))
    run.make_vehicle_run_directory(out, context)
    truths = [entry for entry in entries if isinstance(entry, TowTruth)]
    truth = partial(next, iter(truths)) if truths else None
    seam = Seam(context.job.seam)
    starts = planner.starts(seam.pose_at(0.0), fixed_obstacles(context.job))
    began = next((entry.poses for entry in entries if isinstance(entry, TowCycle)), None)
    last = starts[0]
    if began is not None:  # the shape whose vehicles are nearest to where they were
        last = min(starts, key=lambda plan: np.hypot(*(plan.held_poses - began)[:, :2].T).mean())
    record = partial(TowRecording, truth=truth)
    results = partial(write_tow_results, job=context.job)
    with run.record_vehicle_run(context, out, TOW_RECORDING, record, results) as journal:
        journal.record(RunEvent(REPLAY_EVENT, f"planned again from {directory}; nothing moved"))
        halted = False
        for entry in entries:
            if isinstance(entry, TowCycle):
                cycle = _replan_cycle(entry, planner, seam, last)
                halted |= bool(cycle.plan.halt)
                last = last if cycle.plan.halt else cycle.plan
                journal.record(cycle)
            elif isinstance(entry, RunEvent) and not (halted and entry.name == WELDED_EVENT):
                journal.record(entry)


def _replan_cycle(cycle: TowCycle, planner: ShapePlanner, seam: Seam, last: TowingPlan) -> TowCycle:
    obstacles = [DiscObstacle(x, y, r, (vx, vy)) for x, y, r, vx, vy in np.array(cycle.obstacles)]
    began = host.thread_time()
    welder_pose = seam.pose_at(cycle.along)
    measured = (cycle.poses, welder_pose, PLAN_PERIOD, last, obstacles, cycle.stopped)
    plan = planner.plan(PlanInputs(*measured, cycle.sigmas))
    seconds = host.thread_time() - began
    if plan.halt:
        still = np.zeros_like(cycle.asked)
        return replace(cycle, plan=plan, seconds=seconds, asked=still, pace=0.0, wait=plan.halt)
    if plan.retreat:
        cycle = replace(cycle, pace=0.0, wait=plan.retreat)
    ways = plan.held_poses - last.held_poses
    steps = np.column_stack((np.hypot(*ways[:, :2].T), ways[:, 2], np.zeros(len(ways))))
    return replace(cycle, plan=plan, seconds=seconds, asked=steps / PLAN_PERIOD)


def identify_cable_of_run(directory: Path, file: Path) -> dict[str, float]:
    """Find from a tow what cable it was, and write that to a new file; its keys and values.

    Raises
    ------
    ConfigurationError
        If the tow does not show it, or the file is there already.
    RecordingError
        If the recording is damaged, or the file can't be written.
    """
    from tjscan.towing.identification import identify_cable

    job, cycles = read_tow_job(directory / JOB_FILE), read_recorded_tow(directory).cycles
    known, unknown = job.localisation, np.full((job.vehicles.count, 3), np.nan)
    with add_file_to_errors(directory):
        if file.exists():
            raise ConfigurationError(f"{file} exists already: give another name with --out")
        found = identify_cable(
            job.chain,
            job.held_links,
            np.array([cycle.poses for cycle in cycles]).reshape(-1, job.vehicles.count, 3),
            np.array([cycle.pushes if len(cycle.pushes) else unknown for cycle in cycles]),
            cycles[0].plan.estimate if cycles else np.zeros(job.cable.links),
            PoseAccuracy(known.position_sigma, known.heading_sigma),
        )
    keys: dict[str, float] = table_to_dict(found)
    with write_files_atomically(file.parent) as draft:
        (draft / file.name).write_text(tomli_w.dumps(keys), encoding="utf-8")
    return keys
