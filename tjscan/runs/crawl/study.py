"""Studies of crawls: from the study's keys to a resolved job, and to what came of its crawl."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, CrawlStopped, LaserFault, VehicleFault
from tjscan.crawler.journal import CrawlCycle, SimulatedPlace
from tjscan.crawler.pass_record import pass_records, root_mean_square
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.runs.crawl.run import CrawlContext, make_crawler
from tjscan.study import trial


@dataclass(frozen=True, slots=True)
class CrawlOutcome(trial.RunOutcome):
    """Outcome of one crawl of a study. Lengths in millimetres.

    All but the first four are of the last pass in which the arc burned, and None if it never
    did.

    Parameters
    ----------
    complete, reason, detail
        As in `RunOutcome`; complete is a crawl that welded every pass, and what ended another is
        the guard that stopped it.
    passes : int
        How many were begun.
    vehicle_rms_mm, vehicle_p95_mm : float
        True offset of the vehicle from the joint: root mean square, and 95th percentile of its
        amount.
    torch_rms_mm, torch_p95_mm : float
        The same of the torch's true deviation from its path.
    error_rms_mm : float
        Root mean square of the estimated offset's error.
    sigma_mm : float
        Root mean square of what the estimate states as its standard deviation.
    read_percent : float
        Share of the profiles in which the joint was read.
    """

    passes: int = 0
    vehicle_rms_mm: float | None = None
    vehicle_p95_mm: float | None = None
    torch_rms_mm: float | None = None
    torch_p95_mm: float | None = None
    error_rms_mm: float | None = None
    sigma_mm: float | None = None
    read_percent: float | None = None


class InMemoryCrawlJournal:
    """A crawl's journal that keeps in memory what its passes are judged by.

    Parameters
    ----------
    truth : callable
        Gives the `SimulatedPlace` of the simulation.
    """

    def __init__(self, truth: Callable[[], SimulatedPlace]) -> None:
        self._truth = truth
        self.cycles: list[CrawlCycle] = []
        self.places: list[tuple[CrawlCycle, SimulatedPlace]] = []

    def record(self, message: object) -> None:
        """Keep a cycle without its profile, and where the torch truly is while its arc burns."""
        if isinstance(message, CrawlCycle):
            self.cycles.append(replace(message, profile=None))
            if message.arc:
                self.places.append((self.cycles[-1], self._truth()))


def crawl_for_study(job: CrawlJob) -> CrawlOutcome:
    """Execute one crawl of a study and return its outcome; nothing is written.

    Parameters
    ----------
    job : CrawlJob
        With a simulated vehicle, and no calibration.

    Raises
    ------
    ConfigurationError
        If such a crawl can't be.
    """
    context, cell = CrawlContext(job, Path()), make_crawl_cell(job)
    if cell.simulated_place is None:
        raise ConfigurationError("a study simulates", key="vehicle.driver")
    keeper = InMemoryCrawlJournal(cell.simulated_place)
    ended = True, "Complete", "every pass is welded"
    try:
        with cell:
            make_crawler(context, cell, context.make_method(), keeper).run()
    except (VehicleFault, LaserFault) as error:
        reason = error.guard if isinstance(error, CrawlStopped) else type(error).__name__
        ended = False, reason, str(error)
    passes = pass_records(keeper.cycles, keeper.places)
    if not passes:
        return CrawlOutcome(*ended)
    last = passes[-1]
    vehicle_p95, torch_p95 = (
        float(np.percentile(np.abs(values), 95))
        for values in (last.true_offset, last.true_deviation)
    )
    return CrawlOutcome(
        *ended,
        passes=len(passes),
        vehicle_rms_mm=1e3 * root_mean_square(last.true_offset),
        vehicle_p95_mm=1e3 * vehicle_p95,
        torch_rms_mm=1e3 * root_mean_square(last.true_deviation),
        torch_p95_mm=1e3 * torch_p95,
        error_rms_mm=1e3 * root_mean_square(last.offset_error),
        sigma_mm=1e3 * root_mean_square(last.sigma),
        read_percent=100 * last.read_share,
    )


class CrawlStudyBackend(trial.StudyBackend[CrawlOutcome]):
    """How crawls are resolved, executed and reported in a study; keys are as in the job file."""

    outcome = CrawlOutcome
    seed = "simulation.seed"
    compared_key = "method"
    measures = (
        trial.ReportedQuantity(
            "vehicle off the joint, rms / mm", lambda m: m.vehicle_rms_mm, ".2f"
        ),
        trial.ReportedQuantity("torch off its path, rms / mm", lambda m: m.torch_rms_mm, ".2f"),
        trial.ReportedQuantity("the same, p95 / mm", lambda m: m.torch_p95_mm, ".2f"),
        trial.ReportedQuantity("stated sigma / mm", lambda m: m.sigma_mm, ".2f"),
        trial.ReportedQuantity("profiles read / %", lambda m: m.read_percent, ".1f"),
    )

    def resolve_run(self, job_file: Path, keys: Mapping[str, Any]) -> trial.ResolvedRun:
        """Resolve and check the settings of one crawl; see `StudyBackend.resolve_run`."""
        with trial.drop_file_from_study_key_errors(keys):
            job = read_crawl_job(job_file, dict(keys))
        if job.simulation is None or job.vehicle.driver_kind is not DriverKind.SIMULATED:
            raise ConfigurationError("a study simulates: its jobs need [simulation]")
        if job.calibration is not None:
            raise ConfigurationError(
                "a study's vehicles differ, and a calibration is of one: leave this key out",
                key="calibration",
            )
        if job.weld.layers:
            raise ConfigurationError("a study plans no passes from looks", key="weld.layers")
        return trial.ResolvedRun(trial.canonical_json(table_to_dict(job)), {})

    def execute_run(self, settings: str) -> CrawlOutcome:
        """Execute one crawl; see `StudyBackend.execute_run`."""
        return crawl_for_study(validate_table(CrawlJob, json.loads(settings)))


CRAWL_STUDY: Final = CrawlStudyBackend()
