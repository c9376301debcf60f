"""Simulated crawls whose joint is read with a stated noise, held against the truth."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from tjscan.core.config import validate_table
from tjscan.core.errors import GrooveNotFound, TjscanError
from tjscan.core.frames import Array
from tjscan.crawler.control_cycle import CrawlDevices
from tjscan.crawler.crawler import Crawler, CrawlPlan
from tjscan.crawler.guards import Guards, ProximityFilter, ProximitySensorPlaces
from tjscan.crawler.joint_tracking.memory import RememberingTracker
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.method import FollowingMethod
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import SlipEstimate
from tjscan.job.crawl.cell import CrawlCell, make_crawl_cell
from tjscan.job.crawl.job import CrawlJob
from tjscan.joint.hull import joint_line_pose, laser_offset
from tjscan.laser.profile import Profile
from tjscan.runs.crawl.run import AutomaticWeldOperator, CrawlContext

SHORT_CRAWL: Final = """
[vehicle]
id = "crawler-1"
[alignment]
length_mm = 50
longest_mm = 100
offset_mm = 20
offset_sigma_mm = 20
in_view_s = 0.1
return_speed_mm_s = 40
speed_mm_s = 40
[guards]
torch_sigma_mm = 20
[weld]
length_m = 0.03
run_up_mm = 30
procedure = "WPS-1"
[[pass]]
speed_mm_s = 20
[simulation.vehicle]
start_mm = [-30.0, 1.0]
[simulation.vehicle.slip]
ratio = 0.1
"""
"""A job of one short pass."""

SHIPPED: Final = tomllib.loads(
    (Path(__file__).parents[1] / "examples" / "crawl.toml").read_text(encoding="utf-8")
)
"""The job that is shipped: a crawl here has its guards."""

NO_PROFILE: Final = Profile(np.empty(0), np.empty(0))
UNEVENNESS: Final = 0.02e-3
"""Metres: standard deviation by which the plates' edges wander, which no reading states."""

EDGE_LENGTH: Final = 5e-3
"""Metres of the joint for which its edges are off alike."""

RUN_UP: Final = 0.4
"""Metres of each pass before the arc."""


@dataclass(frozen=True)
class Crawl:
    """What a bench asks of a crawl.

    Parameters
    ----------
    slip : float
        Ratio of the slip plant.
    method : str
    passes : int
    noise : float
        Of a reading of the joint, metres.
    dropouts : float
        Share of the time without readings, in runs of up to a second.
    radius : float or None
        Of the joint, metres; the job knows it to 2 %.
    encoder_noise : float
        Times that of the sheet.
    arc_points : float or None
        Share of the profiles' points that the arc blinds; readings without profiles where None.
    calibrated : bool
        Whether a shuttle went before.
    keys : dict
        Further tables of the job.
    """

    slip: float = 0.0
    method: str = "slip-aware"
    passes: int = 3
    noise: float = 0.015e-3
    dropouts: float = 0.0
    radius: float | None = None
    encoder_noise: float = 1.0
    arc_points: float | None = None
    calibrated: bool = False
    keys: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Crawled:
    """A crawl held against the truth, pass by pass, beyond the run-up.

    Parameters
    ----------
    vehicle, torch : dict of int to ndarray
        Offset of the vehicle from the joint, and of the torch after its axis, mm.
    nees : float
        Mean normalised error squared of offset and heading, over its dimension.
    stopped : str
        Why it stopped early; empty where it did not.
    """

    vehicle: dict[int, Array]
    torch: dict[int, Array]
    nees: float
    stopped: str = ""

    def rms(self, number: int, *, torch: bool = False) -> float:
        """Root mean square of a pass, mm; NaN where it was not welded."""
        off = (self.torch if torch else self.vehicle).get(number, np.array([np.nan]))
        return float(np.sqrt(np.mean(off**2)))

    def p95(self, number: int) -> float:
        """95th percentile of the vehicle's offset in a pass, mm."""
        return float(np.percentile(np.abs(self.vehicle.get(number, np.array([np.nan]))), 95))

    def largest(self, number: int) -> float:
        """Largest offset of the torch in a pass, mm."""
        return float(np.abs(self.torch.get(number, np.array([np.nan]))).max())

    def at_start(self, number: int, *, torch: bool = True) -> float:
        """Offset where the arc is struck, mm."""
        off = (self.torch if torch else self.vehicle).get(number, np.array([np.nan]))
        return float(np.abs(off[0]))


def job_of(crawl: Crawl, seed: int) -> CrawlJob:
    """Job of a crawl: 5 mm/s, design 2, 5 mm and 15 mrad off at the start."""
    tables: dict[str, Any] = {
        "method": crawl.method,
        "weld": {"length_m": 0.6, "run_up_mm": 1e3 * RUN_UP},
        "guards": SHIPPED["guards"],
        "pass": [{"speed_mm_s": 5.0}] * crawl.passes,
        "simulation": {
            "seed": seed,
            "arc_points_percent": 100 * (crawl.arc_points or 0.0),
            "vehicle": {
                "start_mm": [-1e3 * RUN_UP, 5.0],
                "heading_deg": float(np.degrees(15e-3)),
                "slip": {"ratio": crawl.slip},
                "encoder_noise_deg_s": float(np.degrees(2e-3)) * crawl.encoder_noise,
            },
        },
    }
    if crawl.radius is not None:
        known = crawl.radius * (1 + 0.02 * np.random.default_rng(seed).standard_normal())
        tables["course"] = {"radius_m": float(known)}
        tables["simulation"]["joint"] = {"radius_m": crawl.radius}
    for table, keys in crawl.keys.items():
        tables[table] = {**tables.get(table, {}), **keys}
    return validate_table(CrawlJob, tables)


class _NoisyJoint:
    """A laser and its reader in one: where the joint truly is, with noise and drop-outs."""

    def __init__(self, cell: CrawlCell, crawl: Crawl, seed: int) -> None:
        assert cell.world is not None
        self._world, self._crawl = cell.world, crawl
        self._rng, self._seed = np.random.default_rng([seed, 9]), seed
        self._blind = 0

    def __enter__(self) -> Self:
        return self

    def capture(self) -> Profile:
        return NO_PROFILE

    def read(self, profile: Profile, travel: float) -> JointPlacement:
        if self._crawl.dropouts:
            if self._blind > 0:
                self._blind -= 1
            elif self._rng.random() < self._crawl.dropouts * 0.02:
                self._blind = int(self._rng.integers(1, 100))
            if self._blind:
                raise GrooveNotFound("dropout", "nothing is seen", np.empty((0, 2)))
        vehicle = self._world.job.vehicle
        place = self._world.pose_ahead(vehicle.laser_to_torch - vehicle.centre_to_torch)
        assert self._world.job.simulation is not None
        _, d = laser_offset(self._world.job.simulation.joint, *place)
        noise = self._crawl.noise
        edges = np.random.default_rng([self._seed, 10, int(place[0] // EDGE_LENGTH) % 2**32])
        off = UNEVENNESS * edges.standard_normal() + noise * self._rng.standard_normal()
        return JointPlacement(centre=-d + off, hull_z=0.0, roll=0.0, centre_sigma=noise)


class _Truth:
    """The journal that holds every cycle against where the torch truly is."""

    def __init__(self, cell: CrawlCell) -> None:
        assert cell.world is not None
        self._world = cell.world
        self.vehicle: dict[int, list[float]] = {}
        self.torch: dict[int, list[float]] = {}
        self.nees: list[float] = []

    def record(self, cycle: object) -> None:
        if not isinstance(cycle, CrawlCycle) or cycle.phase is Phase.MANUAL:
            return
        along, off = self._world.torch_place()
        if cycle.arc:
            self.vehicle.setdefault(cycle.number, []).append(1e3 * off)
            self.torch.setdefault(cycle.number, []).append(1e3 * (off + cycle.torch_y - cycle.path))
        if cycle.slip is not None and len(self.nees) % 10 == 0:
            assert self._world.job.simulation is not None
            heading = self._world.pose_ahead(0.0)[2]
            heading -= joint_line_pose(self._world.job.simulation.joint, along)[2]
            error = cycle.slip.x[:2] - (off, heading)
            self.nees.append(float(error @ np.linalg.solve(cycle.slip.P[:2, :2], error)) / 2)
        elif cycle.slip is not None:
            self.nees.append(np.nan)


def run(crawl: Crawl, seed: int, estimate: SlipEstimate | None = None) -> Crawled:
    """Crawl once."""
    if crawl.calibrated and estimate is None:
        estimate = shuttle(replace(crawl, calibrated=False), seed)
    job = job_of(crawl, seed)
    cell = make_crawl_cell(job)
    method = CrawlContext(job, Path()).make_method(estimate)
    truth, stopped = _Truth(cell), ""
    with cell:
        crawler = _crawler(cell, job, crawl, seed, method, truth)
        try:
            crawler.run()
        except TjscanError as error:
            stopped = str(error)
    return Crawled(
        {number: np.array(off) for number, off in truth.vehicle.items()},
        {number: np.array(off) for number, off in truth.torch.items()},
        float(np.nanmean(truth.nees)) if truth.nees else np.nan,
        stopped,
    )


def shuttle(crawl: Crawl, seed: int) -> SlipEstimate:
    """What a shuttle learns of slip."""
    job = job_of(crawl, seed)
    cell = make_crawl_cell(job)
    method = CrawlContext(job, Path()).make_method()
    with cell:
        _crawler(cell, job, crawl, seed + 1000, method, _Truth(cell)).shuttle(0.8, 3)
    assert method.slip is not None
    return method.slip.at_new_start(job.slip)


def _crawler(
    cell: CrawlCell,
    job: CrawlJob,
    crawl: Crawl,
    seed: int,
    method: FollowingMethod,
    truth: _Truth,
) -> Crawler:
    corners = ProximitySensorPlaces(job.vehicle.body_length, job.vehicle.body_width)
    joint = _NoisyJoint(cell, crawl, seed)
    whole = crawl.arc_points is not None
    devices = CrawlDevices(
        cell.vehicle,
        cell.laser if whole else joint,  # type: ignore[arg-type]
        cell.torch,
        RememberingTracker() if whole else joint,
    )
    return Crawler(
        devices,
        CrawlPlan(job.alignment, job.weld, job.passes),
        method,
        Guards(job.guards, ProximityFilter(job.proximity), corners),
        AutomaticWeldOperator(),
        truth,
    )
