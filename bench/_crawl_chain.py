"""Whole crawls whose passes are planned from looks: reader, vehicle, arc and metal as shipped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from _weld_worlds import SurfaceErrors, bench_wps

from tjscan.crawler.plan import with_rows
from tjscan.job.crawl.cell import InterruptedWorld, make_crawl_cell
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.runs.crawl.results import RecordedCrawl, read_recorded_crawl
from tjscan.runs.crawl.run import CrawlContext, run_crawl
from tjscan.welding.state import WeldState

JOB = Path(__file__).parents[1] / "examples" / "crawl-layers.toml"


@dataclass(frozen=True, slots=True)
class CrawlChainOutcome:
    """A finished weld of a crawl against the truth.

    Parameters
    ----------
    surface : SurfaceErrors
    deviations : tuple of float
        Errors of the wire's deviations that looks stated, in their standard deviations.
    """

    surface: SurfaceErrors
    deviations: tuple[float, ...]


def crawl_chain(seed: int, length: float) -> CrawlChainOutcome:
    """Crawl the example's joint for a length, metres; raises as `run_crawl` does.

    The wire points aside, more metal is laid and the joint shrinks otherwise by chance.
    """
    rng = np.random.default_rng([seed, 1])
    keys = {
        "weld.length_m": length,
        "simulation.seed": seed,
        "simulation.weld.offset_mm": float(rng.choice((-0.5, 0.5))),
        "simulation.weld.gain_percent": float(rng.uniform(-3, 3)),
        "simulation.weld.shrinkage_percent": float(rng.uniform(-30, 30)),
    }
    job = read_crawl_job(JOB, keys)
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        run_crawl(CrawlContext(job, JOB, arc=True), run)
        return outcome_of_crawl(job, read_recorded_crawl(run))


def outcome_of_crawl(job: CrawlJob, found: RecordedCrawl) -> CrawlChainOutcome:
    """Hold what a crawl recorded against its truth."""
    surface = SurfaceErrors.of_weld(true_weld(job, found), bench_wps().bead.cap_height)
    return CrawlChainOutcome(surface, tuple(deviation_errors(job, found)))


def true_weld(job: CrawlJob, found: RecordedCrawl) -> WeldState:
    """The metal of a recorded crawl along its weld, laid again as it was."""
    arcs = tuple(
        (with_rows(job.passes[number - 1], found.planned[number].table), way)
        for number, way in found.true_arcs
    )
    world = make_crawl_cell(job, InterruptedWorld(np.zeros(3), 0.0, arcs)).world
    if world is None or world.metal is None:
        raise SystemExit(f"{JOB} simulates no weld")
    state = world.metal.metal.state
    return state.part((state.s >= 0) & (state.s <= job.weld.length))


def deviation_errors(job: CrawlJob, found: RecordedCrawl) -> list[float]:
    """Errors of the deviations of all but the last pass, over their standard deviations.

    The wire truly is beside its path by what the torch was, and by what it points aside.
    """
    if job.simulation is None or job.simulation.weld is None:
        raise SystemExit(f"{JOB} simulates no weld")
    errors = []
    for number, (_, s, right) in ((number, way.T) for number, way in found.true_arcs):
        before, now = found.planned[number], found.planned.get(number + 1)
        if now is None or now.deviation is None or now.deviation_sigma is None:
            continue
        aim = np.interp(s, before.s, before.offset + before.closed / 2) + before.torch_offset
        true = float(np.mean(right - aim)) + job.simulation.weld.offset
        errors.append((now.deviation - true) / now.deviation_sigma)
    return errors
