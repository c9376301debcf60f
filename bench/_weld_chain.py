"""Whole welds with the reader in the loop: scan, weld and look as the program ships it.

And whole crawls, whose passes are planned at *Ready* from the way back.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from _weld_worlds import SurfaceErrors

from tjscan.core.config import validate_table
from tjscan.core.errors import TjscanError
from tjscan.core.sourced import NumberSource
from tjscan.crawler.journal import CrawlCycle, PlannedPass
from tjscan.job.crawl.cell import CrawlCell, make_crawl_cell
from tjscan.job.crawl.job import CrawlJob
from tjscan.job.weld import read_weld_job
from tjscan.planning.wps import read_wps
from tjscan.runs.crawl.replan import bead_order
from tjscan.runs.crawl.run import CrawlContext, make_crawler
from tjscan.runs.weld.journal import LookMessage, read_weld
from tjscan.runs.weld.results import WELD_LOG_FILE
from tjscan.runs.weld.run import LookSchedule, Weld, WeldContext, run_weld

EXAMPLES = Path(__file__).parents[1] / "examples"
JOB = EXAMPLES / "weld.toml"
STATIONS_JOB = EXAMPLES / "whole-joint.toml"
"""Of a scan of the whole joint from two stations."""

OFFSET = 0.5e-3
"""Of the wire, to either side, metres."""


@dataclass(frozen=True, slots=True)
class ChainOutcome:
    """A finished weld against the truth.

    Parameters
    ----------
    surface : SurfaceErrors
    offset_error : float
        Of the offset learnt, metres.
    deviations : tuple of float
        Errors of the torch's deviations that looks stated, in their standard deviations.
    unsourced : int
        Numbers of its log that do not state where they come from.
    """

    surface: SurfaceErrors
    offset_error: float
    deviations: tuple[float, ...]
    unsourced: int


def weld_chain(seed: int, length: float) -> ChainOutcome:
    """Weld a length of the example's joint; its wire points to the leg or to the brace by chance.

    Parameters
    ----------
    seed : int
        Of everything.
    length : float
        Metres.
    """
    true = float(np.random.default_rng(seed).choice((-OFFSET, OFFSET)))
    keys = {
        "scan.length_mm": 1e3 * length,
        "simulation.seed": seed,
        "weld.simulation.seed": seed,
        "weld.simulation.offset_mm": 1e3 * true,
    }
    return _weld_and_compare(JOB, keys, true, LookSchedule.PASS)


def weld_ring(seed: int, looks: LookSchedule) -> ChainOutcome:
    """Weld all of the paper's joint from two stations, with sections every 4 mm and faults.

    Parameters
    ----------
    seed : int
        Of everything.
    looks : LookSchedule
    """
    true = float(np.random.default_rng(seed).choice((-OFFSET, OFFSET)))
    keys = {
        "simulation.seed": seed,
        "weld.simulation.seed": seed,
        "weld.simulation.offset_mm": 1e3 * true,
        "weld.wps": str(EXAMPLES / "wps.toml"),
        "weld.station_step_mm": 4.0,
        "weld.look_step_mm": 8.0,
    }
    text, weld = STATIONS_JOB.read_text(), JOB.read_text()
    text = text.replace('"../cad/', f'"{EXAMPLES.parent}/cad/') + weld[weld.index("[weld]") :]
    with TemporaryDirectory() as folder:
        file = Path(folder) / "ring.toml"
        file.write_text(text)
        return _weld_and_compare(file, keys, true, looks)


def _weld_and_compare(
    job: Path, keys: dict[str, Any], true: float, looks: LookSchedule
) -> ChainOutcome:
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        run_weld(WeldContext(read_weld_job(job, keys), job), run, arc=True, looks=looks)
        log = json.loads((run / WELD_LOG_FILE).read_text())
        file = run / "job.toml"
        weld = Weld.of_scan(WeldContext(read_weld_job(file), file), run)
        messages = list(_replay(weld, run))
    looked = [one for one in messages if isinstance(one, LookMessage)]
    stated = [
        (now.deviation - (true - before.offset)) / now.deviation_sigma
        for before, now in pairwise(looked)
        if now.deviation is not None and now.deviation_sigma is not None
    ]
    closed = weld.world.period > 0
    surface = SurfaceErrors.of_weld(weld.world.state, weld.order.cap_height, closed=closed)
    return ChainOutcome(
        surface, abs(looked[-1].offset - true), tuple(stated), numbers_without_source(log)
    )


CRAWL: Final = {
    "alignment": {"length_mm": 400},
    "weld": {"wps": str(EXAMPLES / "wps.toml"), "layers": [1, 2, 3, 4], "run_up_mm": 500},
    "pass": [{"feed_m_min": 9.0, "weave_mm": 1.5, "weave_period_s": 1, "dwell_s": 0.2}] * 10,
    "power": {"driver": "simulated"},
    "simulation": {
        "arc_points_percent": 10,
        "vehicle": {"start_mm": [-500, 5], "heading_deg": 0.86, "slip": {"ratio": 0.1}},
        "joint": {"width_mm": 26, "depth_mm": 17, "high_low_mm": 1.0},
        "weld": {
            "gain_percent": 3.0,
            "slip_percent": 3.0,
            "wander_mm": 0.3,
            "shrinkage_percent": 20.0,
        },
    },
}
"""Ten planned passes with faults; vehicle and guards are those of the example."""


@dataclass(frozen=True, slots=True)
class CrawlOutcome:
    """A crawl of planned passes against the truth.

    Parameters
    ----------
    passes : int
        That were welded whole.
    stopped : str
        Why it stopped before all were; empty if it did not.
    surface : SurfaceErrors
    offset_error : float
        Of the offset learnt, metres.
    deviations : tuple of float
        Errors of the wire's deviations that looks stated, in their standard deviations.
    torch : tuple of float
        Root mean square of the torch's way beside its planned path in each pass, metres.
    """

    passes: int
    stopped: str
    surface: SurfaceErrors
    offset_error: float
    deviations: tuple[float, ...]
    torch: tuple[float, ...]


@dataclass(slots=True)
class _CrawlJournal:
    """Notes what was planned, and how far from it the wire truly was while the arc burned."""

    cell: CrawlCell
    planned: dict[int, PlannedPass] = field(default_factory=dict)
    beside: dict[int, list[float]] = field(default_factory=dict)

    def record(self, message: object) -> None:
        """Take in a message of the crawl."""
        if isinstance(message, PlannedPass):
            self.planned[message.number] = message
        elif isinstance(message, CrawlCycle) and message.arc and self.cell.world is not None:
            along, right = self.cell.world.torch_beside_joint()
            self.beside.setdefault(message.number, []).append(
                right - self._swing(message) - float(self._path(message.number, along))
            )

    def _swing(self, cycle: CrawlCycle) -> float:
        """What the weave adds to the path now, metres."""
        return cycle.path - cycle.jog - float(self._path(cycle.number, cycle.travel))

    def _path(self, number: int, along: float) -> Any:
        return self.planned[number].table.at(np.array(along)).offset


def weld_crawl(seed: int, length: float) -> CrawlOutcome:
    """Crawl along a butt joint, and plan each of ten passes from the way back.

    Parameters
    ----------
    seed : int
        Of everything.
    length : float
        Of the weld, metres.
    """
    true = float(np.random.default_rng(seed).choice((-OFFSET, OFFSET)))
    tables = tomllib.loads((EXAMPLES / "crawl.toml").read_text())
    for table, keys in deepcopy(CRAWL).items():
        tables[table] = tables.get(table, {}) | keys if isinstance(keys, dict) else keys
    tables["weld"]["length_m"] = length
    tables["simulation"]["seed"] = seed
    tables["simulation"]["joint"]["length_m"] = length + 0.6
    tables["simulation"]["weld"]["offset_mm"] = 1e3 * true
    job = validate_table(CrawlJob, tables)
    context = CrawlContext(job, Path(), arc=True)
    cell, method = make_crawl_cell(job), context.make_method()
    journal, planner, stopped = _CrawlJournal(cell), context.make_planner(), ""
    assert cell.world is not None
    assert cell.world.metal is not None
    assert planner is not None
    with cell:
        try:
            make_crawler(context, cell, method, journal, planner=planner).run()
        except TjscanError as error:
            stopped = str(error)
    state = cell.world.metal.metal.state
    order = bead_order(job, read_wps(EXAMPLES / "wps.toml"))
    planned = [journal.planned[number] for number in sorted(journal.planned)]
    beside = {n: np.array(rows) for n, rows in journal.beside.items()}
    stated = tuple(
        (now.deviation - (true - before.torch_offset + float(beside[before.number].mean())))
        / now.deviation_sigma
        for before, now in pairwise(planned)
        if now.deviation is not None and now.deviation_sigma is not None
    )
    # Tracks slip: all beads lie a bit behind, and are a bit shorter, than was asked for.
    whole = [(begin, end) for begin, end in cell.world.welded if end - begin > 0.95 * length]
    begin = max((begin for begin, _ in whole), default=0.0)
    end = min((end for _, end in whole), default=length)
    return CrawlOutcome(
        len(whole),
        stopped,
        SurfaceErrors.of_weld(state.part((state.s >= begin) & (state.s <= end)), order.cap_height),
        abs(planned[-1].torch_offset - true),
        stated,
        tuple(float(np.sqrt(np.mean(rows**2))) for rows in beside.values()),
    )


def numbers_without_source(entry: Any) -> int:
    """Numbers in JSON that are not the value of an object with a source."""
    if isinstance(entry, list):
        return sum(map(numbers_without_source, entry))
    if not isinstance(entry, dict):
        return int(isinstance(entry, int | float) and not isinstance(entry, bool))
    sourced = entry.get("source") in set(NumberSource) and "value" in entry
    return sum(
        numbers_without_source(value)
        for key, value in entry.items()
        if not (sourced and key == "value")
    )


def _replay(weld: Weld, run: Path) -> Iterator[object]:
    """Let the metal of a recorded weld lie again, as it did."""
    for message in read_weld(run):
        weld.replay(message)
        yield message
