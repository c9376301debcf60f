"""Studies of tows: from the study's keys to a resolved job, and to what came of its tow."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.errors import ConfigurationError, TowHalted, VehicleFault
from tjscan.job.tow.cell import check_seam, make_shape_planner, make_tow_cell
from tjscan.job.tow.job import TowJob, read_tow_job
from tjscan.runs.tow.results import TowOutcome, outcome_of_tow
from tjscan.runs.tow.run import make_tow
from tjscan.study import trial
from tjscan.towing.journal import TowCycle, TowTruth


class InMemoryTowJournal:
    """A tow's journal that keeps its cycles in memory.

    Parameters
    ----------
    truth : callable
        Gives the `TowTruth` of the simulation.
    """

    def __init__(self, truth: Callable[[], TowTruth]) -> None:
        self._truth = truth
        self.cycles: list[TowCycle] = []
        self.truths: list[TowTruth] = []

    def record(self, message: object) -> None:
        """Keep a cycle and the truth then."""
        if isinstance(message, TowCycle):
            self.cycles.append(message)
            self.truths.append(self._truth())


def tow_for_study(job: TowJob) -> TowOutcome:
    """Execute one tow of a study and return its outcome; nothing is written.

    Parameters
    ----------
    job : TowJob
        Whose vehicles are simulated.

    Raises
    ------
    ConfigurationError
        If such a tow can't be.
    """
    planner = make_shape_planner(job)
    sweep = check_seam(job, planner)
    sweep.refuse_if_blocked()
    cell = make_tow_cell(job, sweep.start.angles)
    assert cell.truth is not None
    keeper = InMemoryTowJournal(cell.truth)
    ended = True, "Complete", "the whole seam is welded"
    try:
        with cell:
            make_tow(job, cell, planner, keeper).run(0.0, sweep.start)
    except (TowHalted, VehicleFault) as error:
        ended = False, type(error).__name__, str(error)
    if not keeper.cycles:
        return TowOutcome(*ended)
    return outcome_of_tow(job, keeper.cycles, keeper.truths, ended)


class TowStudyBackend(trial.StudyBackend[TowOutcome]):
    """How tows are resolved, executed and reported in a study; keys are as in the job file."""

    outcome = TowOutcome
    seed = "simulation.seed"
    measures = (
        trial.ReportedQuantity("seam welded / mm", lambda m: m.welded_mm, ".0f"),
        trial.ReportedQuantity("waited / s", lambda m: m.waited_s, ".1f"),
        trial.ReportedQuantity("plans a second", lambda m: m.plan_hz, ".0f"),
        trial.ReportedQuantity("objective f, mean of 100", lambda m: m.objective, ".2f"),
        trial.ReportedQuantity("towing speed asked, fastest / mm/s", lambda m: m.asked_mm_s, ".1f"),
        trial.ReportedQuantity("force on the welder, mean / N", lambda m: m.force_mean_n, ".1f"),
        trial.ReportedQuantity("force on the welder, largest / N", lambda m: m.force_max_n, ".1f"),
        trial.ReportedQuantity("welder off its line / mm", lambda m: m.welder_off_mm, ".2f"),
        trial.ReportedQuantity("estimate, mean a joint / °", lambda m: m.estimate_deg, ".2f"),
        trial.ReportedQuantity("joint angle, largest / °", lambda m: m.bend_deg, ".1f"),
        trial.ReportedQuantity(
            "clearance of links, least / mm", lambda m: m.link_clearance_mm, ".0f"
        ),
        trial.ReportedQuantity("gap between vehicles / mm", lambda m: m.vehicle_gap_mm, ".0f"),
        trial.ReportedQuantity("touches", lambda m: m.touches, ".0f"),
    )

    def resolve_run(self, job_file: Path, keys: Mapping[str, Any]) -> trial.ResolvedRun:
        """Resolve and check the settings of one tow; see `StudyBackend.resolve_run`."""
        with trial.drop_file_from_study_key_errors(keys):
            job = read_tow_job(job_file, dict(keys))
        if job.vehicles.driver != "simulated":
            raise ConfigurationError("a study simulates", key="vehicles.driver")
        return trial.ResolvedRun(trial.canonical_json(table_to_dict(job)), {})

    def execute_run(self, settings: str) -> TowOutcome:
        """Execute one tow; see `StudyBackend.execute_run`."""
        return tow_for_study(validate_table(TowJob, json.loads(settings)))


TOW_STUDY: Final = TowStudyBackend()
