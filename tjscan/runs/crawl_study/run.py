"""One crawl of a study: its job in, what came out of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, CrawlStopped, LaserFault, VehicleFault
from tjscan.core.frames import Array
from tjscan.crawler.journal import CrawlCycle, SimulatedPlace
from tjscan.crawler.pass_record import PassRecord, pass_records, root_mean_square
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.job.crawl.job import CrawlJob
from tjscan.laser.profile import Profile
from tjscan.runs.crawl.run import CrawlContext, make_crawler
from tjscan.runs.crawl_study.outcome import CrawlOutcome

COMPLETE: Final = "Complete"


class CrawlKeeper:
    """A crawl's journal that keeps in memory what its passes are judged by.

    Parameters
    ----------
    truth : callable
        Gives the `SimulatedPlace` of the simulation.
    """

    def __init__(self, truth: Callable[[], SimulatedPlace]) -> None:
        self._truth = truth
        self._cycles: list[CrawlCycle] = []
        self._places: list[tuple[CrawlCycle, SimulatedPlace]] = []

    def record_cycle(self, cycle: CrawlCycle, profile: Profile | None) -> None:
        """Keep a cycle, and where the torch truly is while its arc burns."""
        self._cycles.append(cycle)
        if cycle.arc:
            self._places.append((cycle, self._truth()))

    def record_event(self, name: str, detail: str) -> None:
        """Keep nothing of events."""

    @property
    def passes(self) -> tuple[PassRecord, ...]:
        """Records of the passes in which the arc burned."""
        return pass_records(self._cycles, self._places)


def run_study_crawl(job: CrawlJob) -> CrawlOutcome:
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
    keeper = CrawlKeeper(cell.simulated_place)
    try:
        with cell:
            make_crawler(context, cell, context.make_method(), keeper).run()
    except (VehicleFault, LaserFault) as error:
        reason = error.guard if isinstance(error, CrawlStopped) else type(error).__name__
        return _outcome(keeper.passes, complete=False, reason=reason, detail=str(error))
    return _outcome(keeper.passes, complete=True, reason=COMPLETE, detail="every pass is welded")


def _outcome(
    passes: tuple[PassRecord, ...], *, complete: bool, reason: str, detail: str
) -> CrawlOutcome:
    if not passes:
        return CrawlOutcome(complete, reason, detail)
    last = passes[-1]
    return CrawlOutcome(
        complete,
        reason,
        detail,
        passes=len(passes),
        vehicle_rms_mm=1e3 * root_mean_square(last.true_offset),
        vehicle_p95_mm=1e3 * _p95(last.true_offset),
        torch_rms_mm=1e3 * last.true_deviation_rms,
        torch_p95_mm=1e3 * _p95(last.true_deviation),
        error_rms_mm=1e3 * last.offset_error_rms,
        sigma_mm=1e3 * last.sigma_rms,
        read_percent=100 * last.read_share,
    )


def _p95(values: Array) -> float:
    return float(np.percentile(np.abs(values), 95))
