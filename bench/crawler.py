"""How well the crawler follows a joint, and whether anything makes it move where it must not.

The vehicle is `SlipPlant` unless a row says pads; starts 5 mm and 15 mrad off; 5 mm/s. Each row is
the median of eight seeds. ``--quick`` takes two seeds, and one shorter crawl where whole profiles
are read.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from shutil import which
from statistics import median
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from _crawls import Crawl, Crawled, job_of, run
from _lost_passes import BROKEN, passes_lost
from _stops import Break, seconds_until_rest
from _stopwatch import Stopwatch
from _table import Row, main

from tjscan.core.errors import CrawlStopped
from tjscan.core.frames import Array
from tjscan.crawler.guards import Guards, ProximityFilter, ProximitySensorPlaces, ProximitySettings
from tjscan.crawler.joint_tracking.memory import RememberingTracker
from tjscan.crawler.plan import GuardSettings
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.runs.crawl.run import CrawlContext
from tjscan.vehicle.simulated import SimulatedVehicle
from tjscan.vehicle.simulated_body import (
    ProximitySensors,
    SimulatedBody,
    SteelArea,
    VehicleSimulationSettings,
)
from tjscan.vehicle.simulated_body import ProximitySettings as SensorSettings
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist
from tjscan_loopback.broker import MosquittoProcess
from tjscan_loopback.process import VehicleLoopbackProcess

SEEDS: Final = range(1, 9)
QUICK_SEEDS: Final = range(1, 3)
APPROACHES: Final = 200
LINK_FAULTS: Final = 100
QUICK_LINK_FAULTS: Final = 10
BROKEN_CRAWLS: Final = 100
QUICK_BROKEN_CRAWLS: Final = len(BROKEN)
BODY: Final = ProximitySensorPlaces(0.8, 0.5)
FIRST_PAD: Final = 0.35
"""Metres from the middle to the end of a track: a pad beyond the edge holds no more."""

PADS: Final = Crawl(
    keys={
        "simulation": {
            "vehicle": {"start_mm": [-700.0, 5.0], "heading_deg": 0.86, "plant": "pads"}
        },
        "weld": {"length_m": 0.6, "run_up_mm": 700.0},
    }
)
"""Its run-up is as long as the contact of the tracks: after it no foot remembers the reversal."""

RADII: Final = 0.5e-3
"""By which share one track's radius is greater: by 25 µm. The paper's integral is for that."""

PAPER: Final = Crawl(
    method="paper",
    passes=1,
    noise=0.08e-3,
    keys={"weld": {"length_m": 0.1, "run_up_mm": 0.0}, "alignment": {"return_speed_mm_s": 40.0}},
)
UNEQUAL: Final = replace(
    PAPER,
    keys={
        **PAPER.keys,
        "simulation": {
            "vehicle": {
                "start_mm": [-400.0, 5.0],
                "heading_deg": 0.86,
                "slip": {"yaw_drift_deg_per_m": float(np.degrees(RADII / TrackGeometry().gauge))},
            }
        },
    },
)
INITIAL: Final = replace(
    UNEQUAL,
    keys={
        **UNEQUAL.keys,
        "vehicle": {"centre_to_torch_mm": 350.0},
        "paper": {"laser_to_centre_mm": 50.0},
    },
)
"""The paper's first design, whose filter starts with a third of the laser's distance."""

TEN_PASSES: Final = Crawl(0.1, passes=10, keys={"weld": {"length_m": 1.0, "run_up_mm": 400.0}})

CRAWLS: Final[dict[str, Crawl]] = {
    "slip 0": Crawl(),
    "slip 10 %": Crawl(0.1),
    "slip 20 %": Crawl(0.2),
    "calibrated": Crawl(0.1, passes=1, calibrated=True),
    "drop-outs": Crawl(0.1, dropouts=0.1),
    "20 % arc points": Crawl(0.1, arc_points=0.2),
    "40 % arc points": Crawl(0.1, arc_points=0.4),
    "radius 50 m": Crawl(0.1, radius=50.0),
    "radius 20 m": Crawl(0.1, radius=20.0),
    "encoder noise x 5": Crawl(0.1, encoder_noise=5.0),
    "paper, no slip": PAPER,
    "paper, no slip, unequal radii": UNEQUAL,
    "paper, initial design": INITIAL,
    "ten passes over 1 m": TEN_PASSES,
    "paper, slip 10 %": replace(Crawl(0.1), method="paper", noise=0.08e-3),
    "pads, dry": PADS,
}


def crawl(name: str, seed: int, *, quick: bool) -> Crawled:
    """Crawl once, as a row asks."""
    asked = CRAWLS[name]
    if quick and asked.arc_points is not None:
        asked = replace(asked, keys={"weld": {"length_m": 0.1, "run_up_mm": 400.0}}, passes=2)
    return run(asked, seed)


def measure(*, quick: bool) -> Sequence[Row]:
    """Every row."""
    seeds = QUICK_SEEDS if quick else SEEDS
    asked = [
        (name, seed)
        for name, one in CRAWLS.items()
        for seed in (
            seeds[:1] if one is TEN_PASSES or (quick and one.arc_points is not None) else seeds
        )
    ]
    asked.sort(key=lambda key: CRAWLS[key[0]].arc_points is None)  # what takes longest goes first
    with ProcessPoolExecutor(2) as pool:
        every = list(pool.map(partial(_crawl, quick=quick), asked))
    found: dict[str, list[Crawled]] = {}
    for (name, _), one in zip(asked, every, strict=True):
        found.setdefault(name, []).append(one)

    def mid(name: str, value: Callable[[Crawled], float]) -> float:
        return median(value(one) for one in found[name])

    rows = [
        Row(
            f"paper's method, no slip, {name}: torch at weld start",
            mid(key, lambda c: c.at_start(1, torch=False)),
            1.0,
            "mm",
            at_least=least,
        )
        for name, key, least in (
            ("ideal tracks", "paper, no slip", -inf),
            ("radii 0.05 % apart", "paper, no slip, unequal radii", 0.2),
        )
    ]
    rows += [
        Row(
            f"paper's method, unequal radii, {name} design: torch at the end over at the start",
            mid(key, lambda c: abs(float(c.vehicle[1][-1])) / c.at_start(1, torch=False)),
            limit,
            at_least=least,
        )
        for name, key, least, limit in (
            ("final", "paper, no slip, unequal radii", 0.0, 1.0),
            ("initial", "paper, initial design", 1.0, inf),
        )
    ]
    for slip, rms, p95 in (("0", 0.20, 0.35), ("10 %", 0.30, 0.50), ("20 %", 0.25, 0.40)):
        name = f"slip {slip}"
        rows += [
            Row(f"vehicle, pass 3, {name}: rms", mid(name, lambda c: c.rms(3)), rms, "mm"),
            Row(f"vehicle, pass 3, {name}: p95", mid(name, lambda c: c.p95(3)), p95, "mm"),
        ]
    last = 2 if quick else 3
    ratio = mid("paper, slip 10 %", lambda c: c.rms(3)) / mid("slip 10 %", lambda c: c.rms(3))
    rows += [
        Row(
            "ten passes over 1 m: torch rms, worst pass",
            mid("ten passes over 1 m", lambda c: max(c.rms(k, torch=True) for k in range(1, 11))),
            0.30,
            "mm",
        ),
        Row("torch, pass 3, slip 20 %: rms", mid("slip 20 %", _torch(3)), 0.20, "mm"),
        Row("torch, pass 3, slip 20 %: max", mid("slip 20 %", lambda c: c.largest(3)), 0.45, "mm"),
        Row("calibrated, pass 1, slip 10 %: torch rms", mid("calibrated", _torch(1)), 0.20, "mm"),
        Row(
            "calibrated, pass 1, slip 10 %: torch at arc start",
            mid("calibrated", lambda c: c.at_start(1)),
            0.30,
            "mm",
        ),
        Row("drop-outs to 1 s: vehicle p95", mid("drop-outs", lambda c: c.p95(3)), 0.40, "mm"),
        *(
            Row(f"{name}: vehicle p95", mid(name, lambda c: c.p95(last)), limit, "mm")
            for name, limit in (("20 % arc points", 0.50), ("40 % arc points", 0.60))
        ),
        Row("radius 50 m: torch rms", mid("radius 50 m", _torch(3)), 0.30, "mm"),
        Row("radius 20 m: torch rms", mid("radius 20 m", _torch(3)), 0.30, "mm"),
        Row("encoder noise x 5: torch rms", mid("encoder noise x 5", _torch(3)), 0.50, "mm"),
        Row(
            "NEES / dimension of offset and heading, slip 20 %",
            mid("slip 20 %", lambda c: c.nees),
            1.5,
            at_least=0.7,
        ),
        Row("paper's rms / ours, slip 10 %", ratio, inf, at_least=20.0),
        Row("pads, dry, horizontal: vehicle rms", mid("pads, dry", lambda c: c.rms(3)), 0.80, "mm"),
        Row("pads, dry, horizontal: torch rms", mid("pads, dry", _torch(3)), 0.25, "mm"),
        *wet_rows(seeds),
        cycle_time(),
        Row(f"{APPROACHES} approaches to an edge: falls", float(falls()), 0),
        Row("false stops in an hour of arc", float(false_stops()), 0),
    ]
    if which("mosquitto"):
        faults = QUICK_LINK_FAULTS if quick else LINK_FAULTS
        broken = QUICK_BROKEN_CRAWLS if quick else BROKEN_CRAWLS
        rows += [
            Row(
                f"{faults} link cuts, kills, drive faults: moving after 0.6 s",
                float(late_stops(faults)),
                0,
            ),
            Row(
                f"{broken} crawls cut off by those while welding, resumed: passes lost",
                float(lost_passes(broken)),
                0,
            ),
        ]
    return rows


def _crawl(key: tuple[str, int], *, quick: bool) -> Crawled:
    return crawl(*key, quick=quick)


def _torch(number: int) -> Callable[[Crawled], float]:
    return lambda c: c.rms(number, torch=True)


def wet_rows(seeds: Sequence[int]) -> list[Row]:
    """On wet pads the vehicle may stop, but not weld beside the joint."""
    world = {**PADS.keys["simulation"]["vehicle"], "pads": {"friction": 0.3}}
    keys = {**PADS.keys, "simulation": {"vehicle": world}}
    wet = replace(PADS, passes=1, keys=keys)
    crawled = [run(wet, seed) for seed in seeds]
    off = [
        float(np.abs(one.torch[1]).max()) for one in crawled if 1 in one.torch and len(one.torch[1])
    ]
    return [Row("pads, wet: torch off the joint while it welds, max", max(off, default=0), 1, "mm")]


def cycle_time() -> Row:
    """From a profile with 20 % arc points to the next command."""
    job = job_of(Crawl(0.1, arc_points=0.2), 1)
    cell = make_crawl_cell(job)
    method = CrawlContext(job, Path()).make_method()
    reader, watch = RememberingTracker(), Stopwatch()
    cell.torch.set_arc(burning=True)
    with cell:
        reader.read(cell.laser.capture(), 0.0)
        for _ in range(1000):
            state = cell.vehicle.next_state()
            profile = cell.laser.capture()
            with watch:
                method.move(state, 0.01, Twist(0.0, 0.0))
                reading = reader.read(profile, 0.0)
                method.read(-reading.centre, reading.centre_sigma)
                method.turn_rate(0.005)
    return watch.row("from profile to command, 99th percentile", _percentile_99, 5.0)


def _percentile_99(seconds: Sequence[float]) -> float:
    return float(np.percentile(seconds, 99))


def falls() -> int:
    """Approaches at 0.1 m/s to an edge at any angle in which a pad leaves the steel."""
    fallen = 0
    for seed in range(APPROACHES):
        rng = np.random.default_rng(seed)
        angle, way = rng.uniform(-0.7, 0.7), rng.choice([-1.0, 1.0])
        distance = rng.uniform(0.8, 1.2)
        across = np.array([np.sin(angle), np.cos(angle)])
        along = np.array([np.cos(angle), -np.sin(angle)]) * way
        corners = [along * distance + across * 9, along * distance - across * 9]
        corners += [corners[1] - along * 20, corners[0] - along * 20]
        outline = tuple((float(x), float(y)) for x, y in corners)
        settings = VehicleSimulationSettings(steel=outline)
        body = SimulatedBody(TrackGeometry(), settings, seed=seed)
        body.arc_burning = True
        guards = Guards(GuardSettings(), ProximityFilter(ProximitySettings()), BODY)
        with SimulatedVehicle(body) as vehicle:
            for _ in range(60):
                guards.watch_vehicle(vehicle.next_state())
            try:
                for _ in range(2000):
                    twist = Twist(0.1 * way, 0.0)
                    guards.check_command(twist)
                    vehicle.command(twist)
                    guards.watch_vehicle(vehicle.next_state())
            except CrawlStopped:
                vehicle.stop()
            for _ in range(100):
                vehicle.next_state()
            fallen += not body.steel.covers_points(_track_ends(body.plant.pose_w)).all()
    return fallen


def _track_ends(pose_w: Array) -> Array:
    """Ends of both tracks at x, y and heading, shape (4, 2)."""
    c, s = np.cos(pose_w[2]), np.sin(pose_w[2])
    ends = np.array([(x, y) for x in (-FIRST_PAD, FIRST_PAD) for y in (-0.2, 0.2)])
    return np.asarray(pose_w[:2] + ends @ np.array([(c, s), (-s, c)]))


def false_stops() -> int:
    """Corners that are taken for missing in an hour over steel while the arc burns."""
    sensors = ProximitySensors(SensorSettings(), SteelArea(), 1)
    found = ProximityFilter(ProximitySettings())
    stops = 0
    for k in range(36_000):
        found.add_sample(sensors.read(np.zeros(3), arc_burning=True))
        stops += k > 10 and bool(found.missing_corners)
    return stops


def late_stops(count: int) -> int:
    """Faults over the broker after which the vehicle still moves 0.6 s later."""
    late = 0
    with MosquittoProcess() as broker, VehicleLoopbackProcess(broker.address) as vehicles:
        for k in range(count):
            what = tuple(Break)[k % len(Break)]
            late += seconds_until_rest(what, broker, vehicles) > 0.6
    return late


def lost_passes(count: int) -> int:
    """Passes that are missing or too short after a crawl was cut off, and resumed."""
    lost = 0
    with MosquittoProcess() as broker:
        for k in range(count):
            with TemporaryDirectory() as directory:
                lost += passes_lost(BROKEN[k % len(BROKEN)], broker, Path(directory))
    return lost


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    sys.exit(main("Crawler", partial(measure, quick=len(words) < len(sys.argv) - 1), words))
