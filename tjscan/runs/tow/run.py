"""Tow a cable along a seam as a job states, or go on with a tow that was interrupted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.job.tow.cell import TowCell, make_planner, make_tow_cell
from tjscan.job.tow.job import TowJob
from tjscan.job.tow.sweep import sweep_seam
from tjscan.recording.header import JobSnapshot
from tjscan.recording.journal import CombinedJournal, Journal, event_recorder
from tjscan.recording.reader import read_job_snapshot
from tjscan.result.directory import JOB_FILE
from tjscan.runs.run import (
    JobContext,
    accept_edited_copies,
    changes_of_job,
    make_vehicle_run_directory,
    record_vehicle_run,
)
from tjscan.runs.tow.results import read_recorded_tow, write_tow_results
from tjscan.towing.journal import TowTruth
from tjscan.towing.loop import PLAN_PERIOD, CableTow, TowSetting
from tjscan.towing.seam import Seam
from tjscan.towing.shape.plan import ShapePlanner, TowingPlan
from tjscan.towing.topics import REPLAY_EVENT, TOW_RECORDING, TowRecording

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
class TowContext(JobContext[TowJob]):
    """A tow job with its file, and where its run reports to; see `JobContext`.

    Parameters
    ----------
    show_truth : callable, optional
        Is given what a simulation knows, each time that it is recorded.
    """

    show_truth: Callable[[TowTruth], object] | None = None

    def truth_of(self, cell: TowCell) -> Callable[[], TowTruth] | None:
        """What a recording asks for the truth of a simulation; None for a real team."""
        truth, show = cell.truth, self.show_truth
        if truth is None or show is None:
            return truth

        def shown_truth() -> TowTruth:
            found = truth()
            show(found)
            return found

        return shown_truth


def make_tow(job: TowJob, cell: TowCell, planner: ShapePlanner, journal: Journal) -> CableTow:
    """Make the loop of a job for a cell whose devices are connected."""
    setting = TowSetting(
        job.chain, job.team, Seam(job.seam), job.localisation, job.following, cell.obstacles
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
        planner = make_planner(job)
        sweep = sweep_seam(job, planner)
        sweep.refuse_if_blocked()
        cell = make_tow_cell(job, sweep.start.angles)
        make_vehicle_run_directory(directory, job, context.job_file)
    _tow(context, directory, cell, planner, 0.0, sweep.start)


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
        raise ConfigurationError(
            "is a replay: nothing was towed there. Resume the tow itself", file=directory
        )
    if recorded.complete:
        raise ConfigurationError("the whole seam is welded: nothing is left to do", file=directory)
    if not recorded.cycles:
        raise ConfigurationError(
            "nothing was towed: there is nothing to go on with. Start a new tow", file=directory
        )
    left = recorded.truths[-1] if recorded.truths else None
    last = next((c for c in reversed(recorded.cycles) if not c.plan.halt), recorded.cycles[-1])
    edited = _is_edited(directory)
    with add_file_to_errors(context.job_file):
        planner = make_planner(context.job)
        if edited:
            sweep_seam(context.job, planner, last.along, last.plan).refuse_if_blocked()
        cell = make_tow_cell(context.job, last.plan.angles, left)
    hauled = PLAN_PERIOD * sum(cycle.pace > 0 for cycle in recorded.cycles)
    _tow(context, directory, cell, planner, last.along, last.plan, hauled)


def _is_edited(directory: Path) -> bool:
    """Whether the job of a tow is another than when it was recorded.

    Raises
    ------
    ConfigurationError
        If a key other than `RESUMABLE_KEYS` is.
    """
    before = read_job_snapshot(directory, TOW_RECORDING)
    if before is None:
        return False
    now = JobSnapshot((directory / JOB_FILE).read_text(encoding="utf-8"))
    advice = (
        "The cable has the shape in which it was left: put it back, or start a new tow. "
        f"What may change: {', '.join(RESUMABLE_KEYS)}"
    )
    return bool(changes_of_job(before, now, RESUMABLE_KEYS, advice, directory / JOB_FILE))


def _tow(
    context: TowContext,
    directory: Path,
    cell: TowCell,
    planner: ShapePlanner,
    along: float,
    last: TowingPlan,
    hauled: float = 0.0,
) -> None:
    """Tow, record, and write the results, however it ended."""
    with record_vehicle_run(
        directory,
        TOW_RECORDING,
        lambda file, job: TowRecording(file, job, context.truth_of(cell)),
        partial(write_tow_results, job=context.job),
        context.finished,
    ) as recording:
        journal = CombinedJournal(recording, context.journal)
        accept_edited_copies(directory, journal)
        cell.report_events_to(event_recorder(journal))
        with cell:
            make_tow(context.job, cell, planner, journal).run(along, last, hauled)
