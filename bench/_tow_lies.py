"""Tows in a simulated world that is not as the program is told, and what it notices of that.

Each lie is made in the world itself, by means that the program's checks do not share: wheels that
drive another twist than commanded, a floor that carries vehicles, poses that are changed on their
way, obstacles that walk and stop where MuJoCo says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from _tows import EXAMPLES, seam_piece

from tjscan.core.errors import TowHalted, VehicleFault
from tjscan.core.frames import Array
from tjscan.job.tow.cell import TowCell, check_seam, make_shape_planner, make_tow_cell
from tjscan.job.tow.job import TowJob, read_tow_job
from tjscan.recording.journal import RunEvent
from tjscan.runs.tow.run import make_tow
from tjscan.runs.tow.study import InMemoryTowJournal
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.pose_disturbance import PoseFault
from tjscan.vehicle.simulated_body import STATE_PERIOD
from tjscan.vehicle.simulated_team import SimulatedLocalisation, SimulatedTeam

LIE_BEGINS: Final = 4.0
"""Seconds on the world's clock at which a lie begins."""

NOTICED_WITHIN: Final = 10.0
"""Seconds within which it is to be named."""

Spoil = Callable[[TowingWorld, SimulatedLocalisation, int], None]
"""Changes a world, or what is seen of it, for a vehicle from 0; called every 10 ms."""


class SpoiledTeam(SimulatedTeam):
    """A simulated team whose world is changed behind its back.

    Parameters
    ----------
    world : TowingWorld
    spoil : callable
        Called after the vehicles' orders and before the world goes on.
    """

    def __init__(self, world: TowingWorld, spoil: Callable[[], None]) -> None:
        super().__init__(world)
        self._spoil = spoil

    def advance(self) -> None:
        """Let the world go on by one period, spoiled."""
        for vehicle in self.vehicles:
            self.world.order(vehicle.which, vehicle.twist_to_drive())
        self._spoil()
        self.world.advance(STATE_PERIOD)
        for vehicle in self.vehicles:
            vehicle.store_world_state()


class EventJournal(InMemoryTowJournal):
    """Keeps cycles and, with their times, events."""

    def __init__(self, truth: Any) -> None:
        super().__init__(truth)
        self.events: list[tuple[float, str, str]] = []

    def record(self, message: object) -> None:
        """Keep a cycle or an event."""
        super().record(message)
        if isinstance(message, RunEvent):
            time = self.cycles[-1].time if self.cycles else 0.0
            self.events.append((time, message.name, message.detail))


@dataclass(frozen=True, slots=True)
class SpoiledTow:
    """What came of a tow.

    Parameters
    ----------
    job : TowJob
    journal : EventJournal
    ended : str
        Why it ended before the seam's end; empty if the whole seam was welded.
    """

    job: TowJob
    journal: EventJournal
    ended: str

    @property
    def bend_deg(self) -> float:
        """Largest true angle of a joint."""
        steps = np.diff(np.array([truth.line for truth in self.journal.truths]), axis=1)
        headings = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
        return float(np.degrees(np.abs(np.diff(headings, axis=1)).max()))

    @property
    def force_n(self) -> float:
        """Largest force of the cable on the welder."""
        return float(max(np.hypot(*truth.welder_force[:2]) for truth in self.journal.truths))

    @property
    def welder_off_mm(self) -> float:
        """Largest distance of the welder from the seam's line, which runs along y."""
        x = self.job.seam.points[0][0]
        return float(1e3 * max(abs(truth.poses[-1, 0] - x) for truth in self.journal.truths))


def tow_spoiled(
    job: TowJob, spoil: Callable[[TowingWorld, SimulatedLocalisation], None]
) -> SpoiledTow:
    """Tow in a world that is spoiled."""
    planner = make_shape_planner(job)
    sweep = check_seam(job, planner)
    sweep.refuse_if_blocked()
    cell = make_tow_cell(job, sweep.start.angles)
    world, seen = cell.world, cell.localisation
    assert world is not None
    assert isinstance(seen, SimulatedLocalisation)
    team: Any = SpoiledTeam(world, partial(spoil, world, seen))
    cell = TowCell(team, seen, cell.fixed_obstacles, cell.moving_names, world)
    assert cell.truth is not None
    journal, ended = EventJournal(cell.truth), ""
    try:
        with cell:
            make_tow(job, cell, planner, journal).run(0.0, sweep.start)
    except (TowHalted, VehicleFault) as error:
        ended = str(error)
    return SpoiledTow(job, journal, ended)


def _turned(world: TowingWorld, v: int) -> Array:
    """Speeds that a vehicle's wheels are controlled to, in frame w."""
    heading = world.plant.poses[v, 2]
    forward, sideways, turn = world._drives.wanted[v]
    c, s = np.cos(heading), np.sin(heading)
    return np.array((c * forward - s * sideways, s * forward + c * sideways, turn))


def _carry(velocity: Array, world: TowingWorld, v: int) -> None:
    world._pushed[v], world._push_ends[v] = velocity, np.inf


def _runs_off(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
    world._commanded[v], world._braked[v] = (0.0, 0.02, 0.0), False


def _drives_back(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
    world._commanded[v] = -world._commanded[v]


def _stands(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
    world._braked[v] = True


def _slips(share: float, world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
    _carry(-share * _turned(world, v), world, v)


def _drifts(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
    heading = world.plant.poses[v, 2]
    _carry(0.008 * np.array((-np.sin(heading), np.cos(heading), 0.0)), world, v)


def _is_pushed(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
    if not world._pushed[v].any():
        world.push(v, 0.06, 0.0)


def _is_noisy(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
    noise = {"position_noise": 5e-3, "heading_noise": float(np.radians(1.0))}
    seen.poses.settings = replace(seen.poses.settings, **noise)


def _has_pose_fault(
    fault: PoseFault, world: TowingWorld, seen: SimulatedLocalisation, v: int
) -> None:
    seen.poses.faults.add((fault, v))


LIES: Final[dict[str, tuple[Spoil, set[str]]]] = {
    "runs off at 20 mm/s": (_runs_off, {"off plan"}),
    "drives backwards": (_drives_back, {"off plan"}),
    "stands, and does not report it": (_stands, {"stands"}),
    "slips by half": (partial(_slips, 0.5), {"slips"}),
    "spins and does not move": (partial(_slips, 1.0), {"slips", "stands"}),
    "is carried aside": (_drifts, {"moved", "slips"}),
    "is pushed by 60 mm": (_is_pushed, {"moved"}),
    "noise ten times what is stated": (_is_noisy, {"noisy poses"}),
    "poses jump": (partial(_has_pose_fault, PoseFault.JUMP), {"jumped"}),
    "poses frozen": (partial(_has_pose_fault, PoseFault.FROZEN), {"frozen"}),
    "poses lost": (partial(_has_pose_fault, PoseFault.LOST), {"none comes"}),
}
"""What is untrue, and the names under which that may be noticed."""

OWN_NAMES: Final = ("off plan", "stands", "slips", "moved", "noisy poses", "no pose")


def names_noticed(tow: SpoiledTow) -> dict[str, set[str]]:
    """Causes named of each vehicle within `NOTICED_WITHIN`."""
    found: dict[str, set[str]] = {}
    for time, name, detail in tow.journal.events:
        if name in OWN_NAMES and time < LIE_BEGINS + NOTICED_WITHIN:
            who = detail.split(":")[0].removeprefix("of ")
            cause = detail.split(": ")[-1] if name == "no pose" else name
            found.setdefault(who, set()).add(cause)
    return found


def lie_is_named_right(name: str, v: int, seed: int) -> tuple[bool, str, SpoiledTow]:
    """Whether a lie about a vehicle, from 0, is named, and nobody else is blamed; and words."""
    spoil, expected = LIES[name]
    keys = seam_piece("tow-simulation", 0.3 + 0.1 * (seed % 5), 0.15)
    keys |= {"simulation.seed": seed, "following.patience_s": 6.0}
    job = read_tow_job(EXAMPLES / "tow-simulation.toml", keys)

    def when_due(world: TowingWorld, seen: SimulatedLocalisation) -> None:
        if world.time >= LIE_BEGINS:
            spoil(world, seen, v)

    tow = tow_spoiled(job, when_due)
    found = names_noticed(tow)
    blamed = {f"vehicle {v + 1}"}
    if spoil is _is_noisy:
        blamed = {f"vehicle {number}" for number in range(1, job.vehicles.count + 1)}
    right = set(found) == blamed and all(bool(causes & expected) for causes in found.values())
    return right, f"{name}, vehicle {v + 1}, seed {seed}: {found}", tow


def no_lie_is_named(keys: dict[str, Any], example: str) -> tuple[bool, str]:
    """Whether a sound tow goes through without a cause named."""
    tow = tow_spoiled(read_tow_job(EXAMPLES / f"{example}.toml", keys), lambda world, seen: None)
    named = [event for event in tow.journal.events if event[1] not in ("start", "welded")]
    return not named and not tow.ended, f"{example}: {named[:3]} {tow.ended}"


def obstacle_case(seed: int) -> dict[str, Any]:
    """Keys of a job in which an obstacle comes onto seam or cable, stands there, and leaves.

    Every other one comes from beyond the wall onto the seam ahead of the welder, the others onto
    the cable from where it bulges to.
    """
    rng = np.random.default_rng(seed)
    speed, radius = rng.uniform(0.03, 0.2), rng.uniform(0.05, 0.2)
    piece = seam_piece("tow-simulation", 0.3 + 0.4 * rng.random(), 0.2)
    x, y = piece["seam.points_mm"][0]
    if seed % 2:
        stop = np.array((x, y + rng.uniform(150, 250) + 1e3 * radius + 170))
        begin = stop + np.array((rng.uniform(-300, 300), 700.0))
    else:
        stop = np.array((rng.uniform(0.3, 0.7) * x, y - rng.uniform(300, 1200)))
        begin = stop + 900.0 * np.array((rng.uniform(-0.5, 0.5), -1.0))
    walked = float(np.linalg.norm(stop - begin)) / 1e3 / speed
    obstacle = {
        "name": "trolley",
        "points_mm": np.array((begin, stop, begin)).round(3).tolist(),
        "radius_mm": round(1e3 * radius, 1),
        "speed_mm_min": round(6e4 * speed, 1),
        "start_s": 2.0,
    }
    holds = {"kind": "passer-by-stands", "vehicle": 1, "at_s": 2.0 + walked, "for_s": 12.0}
    return {
        **piece,
        "obstacles": [obstacle],
        "simulation.seed": seed,
        "simulation.faults": [holds],
        "following.patience_s": 60.0,
    }


def obstacle_comes_and_goes(seed: int) -> tuple[int, bool, str]:
    """Touches caused by our motion, whether the tow was gone on with, and words."""
    job = read_tow_job(EXAMPLES / "tow-simulation.toml", obstacle_case(seed))
    (hold,) = job.simulation.faults
    until = hold.at + (hold.seconds or 0.0)

    def hold_obstacle(world: TowingWorld, seen: SimulatedLocalisation) -> None:
        world.hold_passer_by(0, hold.at <= world.time < until)

    tow = tow_spoiled(job, hold_obstacle)
    ours = 0
    before: tuple[str, ...] = ()
    for last, truth in zip(tow.journal.truths, tow.journal.truths[1:], strict=False):
        touches = tuple(one for one in truth.touches if "passer-by" in one)
        rests = bool((last.passers_by == truth.passers_by).all())
        ours += rests and any(one not in before for one in touches)
        before = touches
    ours += sum(any("passer-by" not in one for one in t.touches) for t in tow.journal.truths)
    waits = [event for event in tow.journal.events if event[1] == "waits"]
    words = f"seed {seed}: {ours} touches, {tow.ended or 'welded'}, {[w[2] for w in waits][:2]}"
    return ours, not tow.ended, words
