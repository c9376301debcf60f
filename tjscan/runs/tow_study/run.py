"""One tow of a study: its job in, what came out of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Final

from tjscan.core.errors import TowHalted, VehicleFault
from tjscan.job.tow.cell import make_planner, make_tow_cell
from tjscan.job.tow.job import TowJob
from tjscan.job.tow.sweep import sweep_seam
from tjscan.runs.tow.figures import figures_of_tow
from tjscan.runs.tow.run import make_tow
from tjscan.runs.tow_study.outcome import TowOutcome
from tjscan.towing.journal import TowCycle, TowTruth

COMPLETE: Final = "Complete"


class TowKeeper:
    """A tow's journal that keeps everything in memory.

    Parameters
    ----------
    truth : callable
        Gives the `TowTruth` of the simulation.
    """

    def __init__(self, truth: Callable[[], TowTruth]) -> None:
        self._truth = truth
        self.cycles: list[TowCycle] = []
        self.truths: list[TowTruth] = []
        self.events: list[tuple[str, str]] = []

    def record_cycle(self, cycle: TowCycle) -> None:
        """Keep a cycle, and the truth then."""
        self.cycles.append(cycle)
        self.truths.append(self._truth())

    def record_event(self, name: str, detail: str) -> None:
        """Keep an event."""
        self.events.append((name, detail))


def run_study_tow(job: TowJob) -> TowOutcome:
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
    planner = make_planner(job)
    sweep = sweep_seam(job, planner)
    sweep.refuse_if_blocked()
    cell = make_tow_cell(job, sweep.start.angles)
    assert cell.truth is not None
    keeper = TowKeeper(cell.truth)
    reason, detail = COMPLETE, "the whole seam is welded"
    try:
        with cell:
            make_tow(job, cell, planner, keeper).run(0.0, sweep.start)
    except (TowHalted, VehicleFault) as error:
        reason, detail = type(error).__name__, str(error)
    return outcome_of(job, keeper, reason, detail)


def outcome_of(job: TowJob, keeper: TowKeeper, reason: str, detail: str) -> TowOutcome:
    """Outcome of a tow that was kept in memory."""
    complete = reason == COMPLETE
    if not keeper.cycles:
        return TowOutcome(complete, reason, detail)
    found = figures_of_tow(job, keeper.cycles, keeper.truths, complete=complete).as_numbers
    wanted = {field.name for field in fields(TowOutcome)} - {"complete", "reason", "detail"}
    return TowOutcome(complete, reason, detail, **{k: found[k] for k in wanted})  # type: ignore[arg-type]
