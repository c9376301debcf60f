"""What another planner would have asked for in a recorded tow; nothing moves."""

from __future__ import annotations

import time as host
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.files import lock_and_clean_directory
from tjscan.core.frames import Array
from tjscan.job.tow.cell import fixed_obstacles, make_planner
from tjscan.job.tow.checks import read_tow_job
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import RunEvent
from tjscan.result.directory import JOB_FILE
from tjscan.runs.run import check_replay, do_nothing_when_finished, make_vehicle_run_directory
from tjscan.runs.tow.results import write_tow_results
from tjscan.runs.tow.run import TowContext
from tjscan.towing.journal import WELDED_EVENT, TowCycle, TowTruth
from tjscan.towing.loop import PLAN_PERIOD
from tjscan.towing.seam import Seam
from tjscan.towing.shape.area import DiscObstacle
from tjscan.towing.shape.plan import ShapePlanner, TowingPlan
from tjscan.towing.topics import REPLAY_EVENT, TOW_RECORDING, TowRecording, read_tow

REPLAYABLE_KEYS: Final = ("method", "weights.", "targets.", "limits.")
"""Keys of what a planner makes of poses, not of how the tow was done."""


def replay_tow(
    directory: Path,
    overrides: dict[str, Any],
    out: Path,
    finished: Callable[[Path], object] = do_nothing_when_finished,
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
    check_replay(directory, out, overrides, REPLAYABLE_KEYS, "tow")
    context = TowContext(read_tow_job(job_file, overrides), job_file, finished=finished)
    with add_file_to_errors(job_file):
        planner = make_planner(context.job)
    entries = list(read_tow(directory))
    make_vehicle_run_directory(out, context.job, job_file)
    origin = JobSnapshot((out / JOB_FILE).read_text(encoding="utf-8"))
    truths = iter([entry for entry in entries if isinstance(entry, TowTruth)])
    truth = (lambda: next(truths)) if any(isinstance(e, TowTruth) for e in entries) else None
    seam = Seam(context.job.seam)
    starts = planner.starts(seam.pose_at(0.0), fixed_obstacles(context.job))
    began = next((entry.poses for entry in entries if isinstance(entry, TowCycle)), None)
    last = starts[0] if began is None else min(starts, key=partial(_apart, began))
    with lock_and_clean_directory(out):
        with TowRecording(out / f"{TOW_RECORDING}.mcap", origin, truth) as journal:
            journal.record(RunEvent(REPLAY_EVENT, f"planned anew from {directory}; nothing moved"))
            halted = False
            for entry in entries:
                if isinstance(entry, TowCycle):
                    cycle = _planned_anew(entry, planner, seam, last)
                    halted |= bool(cycle.plan.halt)
                    last = last if cycle.plan.halt else cycle.plan
                    journal.record(cycle)
                elif isinstance(entry, RunEvent) and not (halted and entry.name == WELDED_EVENT):
                    journal.record(entry)
        write_tow_results(out, context.job)
    finished(out)


def _apart(poses: Array, start: TowingPlan) -> float:
    """Mean distance of vehicles from the vehicles of a shape to begin with, metres."""
    return float(np.hypot(*(start.held_poses - poses)[:, :2].T).mean())


def _planned_anew(cycle: TowCycle, planner: ShapePlanner, seam: Seam, last: TowingPlan) -> TowCycle:
    obstacles = [DiscObstacle(x, y, r, (vx, vy)) for x, y, r, vx, vy in np.array(cycle.obstacles)]
    began = host.thread_time()
    plan = planner.plan(
        cycle.poses,
        seam.pose_at(cycle.along),
        dt=PLAN_PERIOD,
        last=last,
        obstacles=obstacles,
        stopped=cycle.stopped,
    )
    seconds = host.thread_time() - began
    if plan.halt:
        still = np.zeros_like(cycle.asked)
        return replace(cycle, plan=plan, seconds=seconds, asked=still, pace=0.0, wait=plan.halt)
    ways = plan.held_poses - last.held_poses
    steps = np.column_stack((np.hypot(*ways[:, :2].T), ways[:, 2], np.zeros(len(ways))))
    return replace(cycle, plan=plan, seconds=seconds, asked=steps / PLAN_PERIOD)
