"""Whether the crawler notices what is untrue, on a vehicle of another make (`_other_vehicle`).

The job is ``examples/crawl.toml`` with its guards as shipped; its vehicle, laser and torch are the
other maker's, and its passes are stringer beads. Sound rows crawl whole passes: torch off the
joint, and false stops. In their first pass processes fork off in which one thing each breaks, in
the weld or 60 mm before it. The torch may not be over 1 mm beside the joint with the arc burning
beyond 10 mm of travel after that, the vehicle has to be at rest in the end, and the stop to name
the cause.

Each row takes two seeds through whole profiles, and eight more by readings of the joint that are
as noisy, in half the time. ``--quick`` takes one by readings, and two faults of three;
``--only WORD`` takes the rows and faults whose names hold the word; ``--seeds N`` as many seeds,
``--first N`` from another one on, ``--profiles N`` of them through whole profiles.
"""

from __future__ import annotations

import os
import pickle
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from math import inf, nan, pi, radians
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from _other_vehicle import GAUGE, NAME, Fault, Hull, OtherWorld, plugged_in
from _table import Row, main

from tjscan.core.config import validate_table
from tjscan.core.errors import CrawlStopped, TjscanError
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.phases import Phase
from tjscan.crawler.torch_trace import LIKELY_SIGMAS, TorchTrace
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.job.crawl.job import CrawlJob
from tjscan.laser.profile import Profile
from tjscan.runs.crawl.run import CrawlContext, check_sizing, make_crawler

EXAMPLE: Final = Path(__file__).parents[1] / "examples" / "crawl.toml"
MOST_OFF, WAY_TO_NOTICE = 1e-3, 0.010
"""Metres: the torch's distance that no arc may have, and the travel in which a fault shows."""

HORIZON: Final = 0.150
"""Metres of weld after a fault, after which a crawl ends."""

REST_SPEED, REST_STATES = 1e-4, 50
"""m/s that are rest, and states after a stop in which it is reached."""

PROFILE_SEEDS, FULL_SEEDS = 2, 10
"""Seeds with whole profiles, and all of them. ``--quick`` takes one, without them where it can."""
HULLS_OF_A_FAULT: Final = 3
"""Sound rows of each seed on which each kind of fault happens; one fewer for ``--quick``."""


@dataclass(frozen=True)
class SoundRow:
    """A sound vehicle on a hull, and what its torch may be off.

    Parameters
    ----------
    hull : Hull
    limits : tuple of float
        Rms of the torch in each pass, mm.
    most : float, optional
        Largest offset, mm.
    radius : float, optional
        Of the joint as the job states it, metres; straight if left out.
    may_stop : bool, optional
        Whether a stop is as good as a weld.
    needs_profiles : bool, optional
        Whether what is rough shows in profiles alone.
    """

    hull: Hull
    limits: tuple[float, ...]
    most: float = MOST_OFF * 1e3
    radius: float | None = None
    may_stop: bool = False
    needs_profiles: bool = False


def slipping(ratio: float, *, sign: float = 1.0) -> Hull:
    """A hull on which tracks slip by a ratio, as studies of the product mean it.

    A tenth of it is lost of the way, by one track more (10 mrad/m), and the vehicle creeps aside
    by 50 mrad times the ratio; the yaw efficiency is that of the pads. With a negative sign
    drift and creep are the other way round: the vehicle creeps up the hull.
    """
    unlike = sign * 10e-3 * GAUGE / 2
    return Hull(lost=(ratio / 10 - unlike, ratio / 10 + unlike), creep=sign * 0.05 * ratio)


SOUND: Final[dict[str, SoundRow]] = {
    "dry, horizontal": SoundRow(Hull(), (0.20, 0.20, 0.20)),
    "climb": SoundRow(Hull(down=pi), (0.25, 0.20)),
    "wet": SoundRow(Hull(friction=0.3), (0.25, 0.25)),
    "slip 10 %": SoundRow(slipping(0.1), (0.20, 0.20)),
    "slip 20 %, opposite": SoundRow(slipping(0.2, sign=-1.0), (0.30, 0.30)),
    "ripple 0.5 %": SoundRow(Hull(ripple=0.005), (0.25, 0.25), 0.5),
    "ripple 2 %": SoundRow(Hull(ripple=0.02), (0.4, 0.4), may_stop=True),
    "inclinometer damped by 0.3 s": SoundRow(Hull(damped=0.3), (0.20, 0.20)),
    "dry, encoders alone": SoundRow(Hull(inertial=False), (0.20, 0.20)),
    "wet, encoders alone": SoundRow(Hull(friction=0.3, inertial=False), (0.25, 0.25)),
    "radius 20 m": SoundRow(Hull(curvature=1 / 20), (0.3, 0.3), radius=20.0),
    "kink 3 mm in 100 mm": SoundRow(Hull(kink=3e-3), (0.3, 0.3)),
    "bead over one edge": SoundRow(Hull(capped=True), (0.3, 0.3), needs_profiles=True),
    "filled by a tack for 40 mm": SoundRow(
        Hull(tack=(0.2, 0.08, 0.02)), (0.3, 0.3), needs_profiles=True
    ),
}
"""The vehicle has a gyro and an inclinometer but where a row says otherwise. The last four are
joints on which a crawl should go on."""

KNOCK, WHEELS = ("knocked aside",), ("encoder", "slip")
FAULTS: Final[dict[str, tuple[str, tuple[float, float], tuple[str, ...]]]] = {
    "knocked 2-4 mm aside": ("knock", (2e-3, 4e-3), KNOCK),
    "knocked 4-10 mm aside": ("knock", (4e-3, 10e-3), KNOCK),
    "knocked round 0.3-1 deg": ("turn", (radians(0.3), radians(1.0)), KNOCK),
    "encoder dead": ("dead", (0.0, 0.0), WHEELS),
    "encoder stuck": ("stuck", (0.0, 0.0), WHEELS),
    "encoder scaled": ("scaled", (0.7, 0.95), WHEELS),
    "encoders swapped": ("swapped", (0.0, 0.0), WHEELS),
    "track spins": ("spins", (0.1, 1.0), WHEELS),
    "laser frozen with noise": ("frozen", (0.0, 0.0), ("laser frozen",)),
    "laser late": ("late", (5, 50), ("laser frozen", "slip", "joint bends")),
    "laser mirrored": ("mirrored", (0.0, 0.0), ("laser mirrored",)),
    "neighbour's joint": ("neighbour", (10e-3, 20e-3), ("joint jumped", "joint lost", *KNOCK)),
    "gyro dead": ("gyro dead", (0.0, 0.0), ("gyro",)),
    "gyro biased": ("gyro biased", (radians(0.1), radians(1.0)), ("gyro",)),
    "inclinometer off": ("level off", (radians(0.5), radians(3.0)), ("inclinometer",)),
}
"""Name, kind of `Fault`, range of its size, and the guards that name its cause."""


@dataclass
class Found:
    """What came of a crawl.

    Parameters
    ----------
    off, estimated, sigma : dict of int to list of float
        Of the torch in each pass: true distance from its path; the estimate of its zero less the
        truth, and the sigma stated for it; metres.
    stopped, guard : str
        Why it stopped and by which guard; empty if it did not.
    at_rest : bool
        Whether it was at rest in the end, the arc out.
    arc_way : float
        Metres of travel with the arc on and the torch beyond the limit, too long after a fault.
    worst : float
        Largest offset then, metres.
    weld_seconds : float
    inside : list of bool
        Whether the torch truly was within the 95 % that the log states, at each of its places.
    faults : list of (str, Found)
        Of the processes that forked off, by fault.
    """

    off: dict[int, list[float]] = field(default_factory=dict)
    estimated: dict[int, list[float]] = field(default_factory=dict)
    sigma: dict[int, list[float]] = field(default_factory=dict)
    stopped: str = ""
    guard: str = ""
    at_rest: bool = True
    arc_way: float = 0.0
    worst: float = 0.0
    weld_seconds: float = 0.0
    inside: list[bool] = field(default_factory=list)
    faults: list[tuple[str, Found]] = field(default_factory=list)

    def rms(self, number: int) -> float:
        """Of the torch in a pass, mm; infinite if it was not welded."""
        off = self.off.get(number, [inf])
        return 1e3 * float(np.sqrt(np.mean(np.square(off))))


class HorizonReached(Exception):
    """A crawl with a fault went on to its horizon."""


class Observer:
    """The journal that holds every cycle against the truth, and forks processes for faults."""

    def __init__(self, world: OtherWorld, faults: Sequence[tuple[float, str, Fault]]) -> None:
        self._world, self._to_come = world, sorted(faults, key=lambda one: one[0])
        self._began: float | None = None
        self._travel = 0.0
        self._pipe: int | None = None
        self._burning: list[tuple[float, float]] = []
        self.found = Found()

    @property
    def is_faulty(self) -> bool:
        """Whether this is a process that forked off."""
        return self._pipe is not None

    def record(self, cycle: object) -> None:
        """See `tjscan.recording.journal.Journal`."""
        if isinstance(cycle, TorchTrace) and not self.is_faulty:
            places, offs = np.transpose(self._burning)
            true = np.interp(cycle.travel, places, offs)
            self.found.inside += (np.abs(cycle.off - true) < LIKELY_SIGMAS * cycle.sigma).tolist()
            self._burning = []
        if not isinstance(cycle, CrawlCycle):
            return
        welds = cycle.phase is Phase.WELDING
        while welds and self._to_come and cycle.travel >= self._to_come[0][0]:
            self._fork(*self._to_come.pop(0)[1:])
        along, off = self._world.beside_joint(0.0, self._world.torch_y)
        _, zero = self._world.beside_joint(0.0)
        off -= cycle.path
        if self._began is None and self.is_faulty:
            self._began = along
        way, self._travel = along - self._travel, along
        if self._began is not None:
            beyond = along - self._began
            if cycle.arc and abs(off) > MOST_OFF and beyond > WAY_TO_NOTICE:
                self.found.arc_way += way
                self.found.worst = max(self.found.worst, abs(off))
            if along > HORIZON + max(self._began, 0.0):
                raise HorizonReached
        elif cycle.arc:
            self.found.weld_seconds += 0.02
            self._burning.append((cycle.travel, off))
            self.found.off.setdefault(cycle.number, []).append(off)
            self.found.estimated.setdefault(cycle.number, []).append(cycle.torch.offset - zero)
            self.found.sigma.setdefault(cycle.number, []).append(cycle.torch.sigma)

    def _fork(self, name: str, fault: Fault) -> None:
        """Let a fault happen in a process of its own, which knows of no other."""
        reading, writing = os.pipe()
        if os.fork() == 0:
            os.close(reading)
            self._pipe, self._to_come, self.found = writing, [], Found()
            self._world.break_now(fault)
            return
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            self.found.faults.append((name, pickle.load(pipe)))
        os.wait()

    def answer(self) -> None:
        """End a process that forked off, with what it found."""
        assert self._pipe is not None
        with os.fdopen(self._pipe, "wb") as pipe:
            pickle.dump(self.found, pipe)
        os._exit(0)


class ReadingsOfWorld:
    """A `JointReader` of a world without profiles."""

    def __init__(self, world: OtherWorld) -> None:
        self._world = world

    def read(self, profile: Profile, travel: float) -> JointPlacement:
        """Read the joint; see `JointReader.read`."""
        return self._world.reading()


def job_of(row: SoundRow) -> CrawlJob:
    """The shipped job with the other maker's devices and stringer beads."""
    tables: dict[str, Any] = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    del tables["simulation"]
    for device in ("vehicle", "laser", "torch"):
        tables[device] = {**tables.get(device, {}), "driver": NAME}
    if row.radius is not None:
        tables["course"] = {"radius_m": row.radius}
    tables["weld"]["length_m"] = 0.4 if row.hull.kink else 0.2
    heights = (-18, -12, -6)[: len(row.limits)]
    tables["pass"] = [{"speed_mm_s": 8.0, "height_mm": height} for height in heights]
    return validate_table(CrawlJob, tables)


def crawl(name: str, seed: int, faults: tuple[str, ...], *, has_profiles: bool = True) -> Found:
    """Crawl a sound row, with processes for faults."""
    rng = np.random.default_rng([seed, *name.encode()])
    row = SOUND[name]
    job = job_of(row)
    start = -job.weld.run_up, rng.uniform(-5e-3, 5e-3), rng.uniform(-15e-3, 15e-3)
    world = OtherWorld(row.hull, start, seed, has_profiles=has_profiles)
    world.pose += (0.0, world.joint_y(start[0]), start[0] * row.hull.curvature)
    broken = []
    for fault in faults:
        kind, (least, most), _ = FAULTS[fault]
        size = rng.uniform(least, most) * (rng.choice([-1, 1]) if kind in SIGNED else 1)
        before = -0.3 if kind in LASER_FAULTS else -0.06
        at = rng.uniform(*((0.01, 0.05) if rng.random() < 0.5 else (before, 0.0)))
        broken.append((at, fault, Fault(kind, float(size), int(rng.integers(2)))))
    observer = Observer(world, broken)
    with plugged_in(world):
        cell = make_crawl_cell(job)
    context = CrawlContext(job, EXAMPLE)
    check_sizing(job)
    with cell:
        try:
            reader = None if has_profiles else ReadingsOfWorld(world)
            make_crawler(context, cell, context.make_method(), observer, reader).run()
        except HorizonReached:
            pass
        except TjscanError as error:
            observer.found.stopped = str(error)
            observer.found.guard = error.guard if isinstance(error, CrawlStopped) else "device"
            for _ in range(REST_STATES):
                cell.vehicle.next_state()
            moving = float(np.abs(world.speeds).max()) > REST_SPEED
            observer.found.at_rest = not (moving or world.arc)
        except BaseException as error:
            if not observer.is_faulty:
                raise
            observer.found.stopped = observer.found.guard = f"{type(error).__name__}: {error}"
        if observer.is_faulty:
            observer.answer()
    return observer.found


SIGNED: Final = ("knock", "turn", "neighbour", "gyro biased", "level off")
INERTIAL_FAULTS: Final = ("gyro dead", "gyro biased", "inclinometer off")
LASER_FAULTS: Final = ("frozen", "late", "mirrored")
PICTURE_FAULTS: Final = (
    "laser frozen with noise", "laser late", "laser mirrored", "neighbour's joint"
)  # fmt: skip


def measure(*, quick: bool, seeds: int, first: int, profile_seeds: int, only: str) -> Iterator[Row]:
    """Every row."""
    faults = tuple(name for name in FAULTS if only in name)
    names = [name for name in SOUND if faults or only in name]
    hulls = HULLS_OF_A_FAULT - quick

    def has_profiles(name: str, seed: int) -> bool:
        return seed < first + profile_seeds or SOUND[name].needs_profiles

    asked = [
        (
            name,
            seed,
            tuple(
                fault
                for i, fault in enumerate(faults)
                if (i + seed - k) % len(names) < hulls
                and (SOUND[name].hull.inertial or fault not in INERTIAL_FAULTS)
                and (has_profiles(name, seed) or fault not in PICTURE_FAULTS)
            ),
            has_profiles(name, seed),
        )
        for seed in range(first, first + seeds)
        for k, name in enumerate(names)
    ]
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(_crawl, asked))
    rows: dict[str, list[Found]] = {}
    broken: dict[str, list[Found]] = {name: [] for name in faults}
    for (name, *_), one in zip(asked, found, strict=True):
        rows.setdefault(name, []).append(one)
        for fault, came in one.faults:
            broken[fault].append(came)
    for name, every in rows.items():
        yield from _sound_rows(name, every)
    for fault, every in broken.items():
        yield from _fault_rows(fault, every)
    every = [one for some in broken.values() for one in some]
    if every:
        beside = sum(one.arc_way > 0 for one in every)
        yield Row(f"{len(every)} faults: torch over 1 mm beside the joint, arc on", beside, 0)
        yield Row(f"{len(every)} faults: not at rest in the end", _count_moving(every), 0)
    inside = [is_inside for one in found for is_inside in one.inside]
    name = "torch within the 95 % that the log states, sound rows"
    yield Row(name, 100 * float(np.mean(inside or nan)), 98, "%", at_least=92)
    stops = [
        one
        for (name, *_), one in zip(asked, found, strict=True)
        if one.stopped and not SOUND[name].may_stop
    ]
    hours = sum(one.weld_seconds for one in found) / 3600
    for cause, count in Counter(one.stopped for one in stops).items():
        print(f"    false stop, {count} x: {cause}", file=sys.stderr)
    yield Row(f"false stops in {60 * hours:.0f} min of arc, sound rows", float(len(stops)), 0)


def _crawl(key: tuple[str, int, tuple[str, ...], bool]) -> Found:
    return crawl(*key[:3], has_profiles=key[3])


def _sound_rows(name: str, every: Sequence[Found]) -> Iterator[Row]:
    row = SOUND[name]
    if row.may_stop:
        every = [one for one in every if not one.stopped]
        if not every:
            return
    for number, limit in enumerate(row.limits, start=1):
        found = [one.rms(number) for one in every]
        name_of_row = f"{name}: torch rms, pass {number}, median (worst {max(found):.2f})"
        yield Row(name_of_row, median(found), limit, "mm")
    off = [abs(x) for one in every for some in one.off.values() for x in some]
    yield Row(f"{name}: torch, largest", 1e3 * max(off, default=nan), row.most, "mm")
    error = np.array([x for one in every for some in one.estimated.values() for x in some])
    sigma = np.array([x for one in every for some in one.sigma.values() for x in some])
    ratio = float(np.mean((error / sigma) ** 2)) if len(error) else nan
    yield Row(f"{name}: error² over stated variance", ratio, 1.5, at_least=0.5)


def _fault_rows(fault: str, every: Sequence[Found]) -> Iterator[Row]:
    right = FAULTS[fault][2]
    beside = [one for one in every if one.arc_way > 0]
    worst = 1e3 * max((one.worst for one in beside), default=0.0)
    way = 1e3 * max((one.arc_way for one in beside), default=0.0)
    off = f" ({worst:.1f} mm, for {way:.0f} mm)" if beside else ""
    yield Row(f"{fault}, {len(every)}: torch over 1 mm off, arc on{off}", len(beside), 0)
    stops = [one for one in every if one.stopped]
    wrong = [one for one in stops if one.guard not in right]
    named = dict(Counter(one.guard for one in wrong))
    name = f"{fault}: {len(stops)} stop, of another cause {named or ''}"
    yield Row(name.rstrip(), len(wrong), 0)


def _count_moving(every: Sequence[Found]) -> int:
    return sum(not one.at_rest for one in every)


def _option(words: list[str], name: str, otherwise: str) -> str:
    """Take an option with its value out of a command line."""
    if name not in words:
        return otherwise
    k = words.index(name)
    value = words[k + 1]
    del words[k : k + 2]
    return value


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    quick = len(words) < len(sys.argv) - 1
    seeds = int(_option(words, "--seeds", str(1 if quick else FULL_SEEDS)))
    asked = partial(
        measure,
        quick=quick,
        seeds=seeds,
        first=int(_option(words, "--first", "1")),
        profile_seeds=int(_option(words, "--profiles", str(0 if quick else PROFILE_SEEDS))),
        only=_option(words, "--only", ""),
    )
    sys.exit(main("Crawler with faults", asked, words))
