"""Tows in a simulated world that is not as the program is told, and what it notices of that.

Disturbances are made in the world itself, by means that the program's checks do not share: wheels
that drive another twist than commanded, a floor that carries vehicles, poses that are changed on
their way, obstacles that walk and stop as MuJoCo has them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from _other_cable import CableTruth, other_cable
from _tows import EXAMPLES, seam_piece
from numpy.random import Generator

from tjscan.core.errors import TowHalted, VehicleFault
from tjscan.core.frames import Array
from tjscan.job.tow.cell import TowCell, check_seam, make_shape_planner, make_tow_cell
from tjscan.job.tow.job import TowJob, read_tow_job
from tjscan.recording.journal import RunEvent
from tjscan.runs.tow.run import make_tow
from tjscan.runs.tow.study import InMemoryTowJournal
from tjscan.towing.loop import PLAN_PERIOD
from tjscan.towing.standstill import SHORTEST_JUDGED_WINDOW
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.pose_disturbance import PoseFault
from tjscan.vehicle.simulated_body import VEHICLE_STATE_PERIOD
from tjscan.vehicle.simulated_team import SimulatedLocalisation, SimulatedTeam

DISTURBANCE_BEGINS: Final = (3.0, 6.0)
"""Seconds on the world's clock between which it begins."""

NOTICED_WITHIN: Final = 10.0
"""Seconds within which it is to be named."""

MATTERING_WAY: Final = 0.02
"""Metres that a vehicle is commanded to go until what is wrong with its drives can matter: wheels
that are wrong by half have then brought it 10 mm off, twice what its place counts as reached."""

FLICKERING: Final = 5
"""Periods for which a touch may cease and be the same: cable that is pressed lightly trembles."""

CLEAR_START: Final = 300.0
"""Millimetres between an obstacle that comes and all vehicles and cable, at first."""

Disturb = Callable[[TowingWorld, SimulatedLocalisation, int], None]
"""Changes a world, or what is seen of it, for a vehicle from 0; called every 10 ms."""


class DisturbedTeam(SimulatedTeam):
    """A simulated team whose world is changed behind its back.

    Parameters
    ----------
    world : TowingWorld
    disturb : callable
        Called after the vehicles' orders, and before their states are read.
    """

    def __init__(self, world: TowingWorld, disturb: Callable[[], None]) -> None:
        super().__init__(world)
        self._disturb = disturb

    def advance(self) -> None:
        """Let the world go on by one period, disturbed."""
        for vehicle in self.vehicles:
            self.world.order(vehicle.which, vehicle.twist_to_drive())
        self._disturb()
        self.world.advance(VEHICLE_STATE_PERIOD)
        self._disturb()
        for vehicle in self.vehicles:
            vehicle.read_own_world_state()


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
class DisturbedTow:
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
        return self._largest_bend(len(self.journal.truths))

    @property
    def bend_until_halt_deg(self) -> float:
        """The same until the halt that ended it: a vehicle that heeds no command goes on."""
        going = [k for k, cycle in enumerate(self.journal.cycles) if not cycle.wait]
        return self._largest_bend(max(going, default=0) + 1) if self.ended else self.bend_deg

    def _largest_bend(self, count: int) -> float:
        steps = np.diff(np.array([truth.line for truth in self.journal.truths[:count]]), axis=1)
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


def tow_disturbed(
    job: TowJob,
    disturb: Callable[[TowingWorld, SimulatedLocalisation], None],
    truth: CableTruth | None = None,
) -> DisturbedTow:
    """Tow in a world that is disturbed, on the plant of another make."""
    planner = make_shape_planner(job)
    sweep = check_seam(job, planner)
    sweep.refuse_if_blocked()
    with other_cable(truth):
        cell = make_tow_cell(job, sweep.start.angles)
    world, seen = cell.world, cell.localisation
    assert world is not None
    assert isinstance(seen, SimulatedLocalisation)
    team: Any = DisturbedTeam(world, partial(disturb, world, seen))
    cell = TowCell(team, seen, cell.fixed_obstacles, cell.moving_names, world)
    assert cell.truth is not None
    journal, ended = EventJournal(cell.truth), ""
    try:
        with cell:
            make_tow(job, cell, planner, journal).run(0.0, sweep.start)
    except (TowHalted, VehicleFault) as error:
        ended = str(error)
    return DisturbedTow(job, journal, ended)


def _wheel_velocity(world: TowingWorld, v: int) -> Array:
    """Speeds that a vehicle's wheels are controlled to, in frame w."""
    return _to_frame_w(world, v, world._drives.wanted[v])


def _to_frame_w(world: TowingWorld, v: int, velocity: Array) -> Array:
    heading = world.plant.poses[v, 2]
    c, s = np.cos(heading), np.sin(heading)
    forward, sideways, turn = velocity
    return np.array((c * forward - s * sideways, s * forward + c * sideways, turn))


def _drive_off(rng: Generator) -> Disturb:
    velocity = _draw_velocity(rng, 0.01, 0.03)

    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        world._commanded[v], world._braked[v] = velocity, False

    return disturb


def _drive_backwards(rng: Generator) -> Disturb:
    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        world._commanded[v] = -world._commanded[v]

    return disturb


def _drive_crooked(rng: Generator) -> Disturb:
    """Wheels that drive in another direction, 60° to 120° off."""
    angle = rng.choice((-1, 1)) * np.radians(rng.uniform(60, 120))
    turned = np.array(((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))))

    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        world._commanded[v, :2] = turned @ world._commanded[v, :2]

    return disturb


def _turn_on_the_spot(rng: Generator) -> Disturb:
    rate = rng.choice((-1, 1)) * np.radians(rng.uniform(3, 10))

    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        world._commanded[v, 2], world._braked[v] = rate, False

    return disturb


def _stand(rng: Generator) -> Disturb:
    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        world._braked[v] = True

    return disturb


def _jam(rng: Generator) -> Disturb:
    return lambda world, seen, v: world.set_jammed(v, True)


def _slip(least: float, most: float, rng: Generator) -> Disturb:
    share = rng.uniform(least, most)

    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        world._pushed[v], world._push_ends[v] = -share * _wheel_velocity(world, v), np.inf

    return disturb


def _carry_aside(rng: Generator) -> Disturb:
    velocity = np.array((0.0, rng.choice((-1, 1)) * rng.uniform(0.006, 0.012), 0.0))

    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        world._pushed[v], world._push_ends[v] = _to_frame_w(world, v, velocity), np.inf

    return disturb


def _push(rng: Generator) -> Disturb:
    x, y = rng.uniform(0.04, 0.08) * _draw_velocity(rng, 1.0, 1.0)[:2]

    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        if not world._pushed[v].any():
            world.push(v, x, y)

    return disturb


def _stop_encoders(rng: Generator) -> Disturb:
    """Wheels drive, and their encoders show a standstill."""

    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        world._drives.wheels[v] = 0.0

    return disturb


def _add_noise(rng: Generator) -> Disturb:
    """All poses scatter by 5 to 15 times what is stated."""
    times = rng.uniform(5, 15)
    noise = {"position_noise": 0.5e-3 * times, "heading_noise": float(np.radians(0.1 * times))}

    def disturb(world: TowingWorld, seen: SimulatedLocalisation, v: int) -> None:
        seen.poses.settings = replace(seen.poses.settings, **noise)

    return disturb


def _spoil_poses(fault: PoseFault, rng: Generator) -> Disturb:
    return lambda world, seen, v: seen.poses.faults.add((fault, v))


def _draw_velocity(rng: Generator, least: float, most: float) -> Array:
    angle = rng.uniform(-np.pi, np.pi)
    return np.array((*(rng.uniform(least, most) * np.array((np.cos(angle), np.sin(angle)))), 0.0))


NOISE_OF_ALL: Final = "all poses noisier than stated"

DISTURBANCES: Final[dict[str, tuple[Callable[[Generator], Disturb], set[str]]]] = {
    "drives off": (_drive_off, {"off plan"}),
    "drives backwards": (_drive_backwards, {"off plan"}),
    "drives crooked": (_drive_crooked, {"off plan"}),
    "turns on the spot": (_turn_on_the_spot, {"off plan"}),
    "does not move, and does not report it": (_stand, {"stopped"}),
    "jams, and reports it": (_jam, {"stopped"}),
    "slips by half": (partial(_slip, 0.35, 0.7), {"slips"}),
    "spins and does not move": (partial(_slip, 0.95, 1.0), {"slips", "stopped"}),
    "is carried aside": (_carry_aside, {"moved", "slips"}),
    "is pushed": (_push, {"moved"}),
    "encoders show a standstill": (_stop_encoders, {"moved"}),
    NOISE_OF_ALL: (_add_noise, {"noisy poses"}),
    "poses noisier than stated": (partial(_spoil_poses, PoseFault.NOISE), {"noisy poses"}),
    "poses jump": (partial(_spoil_poses, PoseFault.JUMP), {"jumped"}),
    "poses frozen": (partial(_spoil_poses, PoseFault.FROZEN), {"frozen"}),
    "poses lost": (partial(_spoil_poses, PoseFault.LOST), {"none comes"}),
    "poses swapped": (partial(_spoil_poses, PoseFault.SWAP), {"jumped"}),
}
"""What is wrong, and the names under which that may be noticed."""

SEEN_WHILE_DRIVING: Final = (
    "drives backwards",
    "drives crooked",
    "does not move, and does not report it",
    "slips by half",
    "spins and does not move",
    "encoders show a standstill",
    "poses frozen",
)
"""Disturbances that change nothing of a vehicle that is commanded to rest."""

OWN_NAMES: Final = ("off plan", "stopped", "slips", "moved", "noisy poses", "no pose")


def causes_named(tow: DisturbedTow, until: float) -> dict[str, set[str]]:
    """Causes named of each vehicle until a time, seconds."""
    found: dict[str, set[str]] = {}
    for time, name, detail in tow.journal.events:
        if name in OWN_NAMES and time < until:
            who = detail.partition(" was ")[0].partition(":")[0].removeprefix("of ")
            cause = detail.split(": ")[-1] if name == "no pose" else name
            found.setdefault(who, set()).add(cause)
    return found


def time_it_matters(tow: DisturbedTow, v: int, begins: float) -> float:
    """When a vehicle from 0 was commanded to go `MATTERING_WAY` since a time; inf if never."""
    way = 0.0
    for cycle in tow.journal.cycles:
        speed, _, sideways = cycle.asked[v]
        way += PLAN_PERIOD * float(np.hypot(speed, sideways)) * (cycle.time >= begins)
        if way >= MATTERING_WAY:
            return cycle.time
    return np.inf


def is_disturbance_named_right(seed: int) -> tuple[bool, str, DisturbedTow]:
    """Whether a drawn disturbance is named, and no other vehicle is blamed; and words.

    The kinds follow each other; vehicle, size, place on the seam, time and yard are drawn. What is
    wrong with drives that never matters need not be named, nor what matters within the last 3 s of
    a tow that is complete: no motion is judged sooner.
    """
    rng = np.random.default_rng([seed, 32])
    name = list(DISTURBANCES)[seed % len(DISTURBANCES)]
    draw, expected = DISTURBANCES[name]
    example = str(rng.choice(("tow-simulation", "tow-yard")))
    keys = seam_piece(example, rng.uniform(0.1, 0.9), 0.15)
    keys |= {"simulation.seed": seed, "following.patience_s": 6.0}
    job = read_tow_job(EXAMPLES / f"{example}.toml", keys)
    v, begins = int(rng.integers(job.vehicles.count)), rng.uniform(*DISTURBANCE_BEGINS)
    change = draw(rng)

    def when_due(world: TowingWorld, seen: SimulatedLocalisation) -> None:
        if world.time >= begins:
            change(world, seen, v)

    tow = tow_disturbed(job, when_due)
    matters = time_it_matters(tow, v, begins) if name in SEEN_WHILE_DRIVING else begins
    found = causes_named(tow, matters + NOTICED_WITHIN)
    blamed = {f"vehicle {v + 1}"}
    if name == NOISE_OF_ALL:
        blamed = {f"vehicle {number}" for number in range(1, job.vehicles.count + 1)}
    elif name == "poses swapped":
        blamed.add(f"vehicle {(v ^ 1) + 1}")
    left = tow.journal.cycles[-1].time - matters
    missed = blamed - set(found) if left > (0.0 if tow.ended else SHORTEST_JUDGED_WINDOW) else set()
    right = set(found) <= blamed and not missed
    right &= all(bool(causes & expected) for causes in found.values())
    when = f"matters after {matters - begins:.1f} s"
    words = f"{name}, {example}, vehicle {v + 1}, seed {seed}, {when}: {found}; {tow.ended}"
    return right, words, tow


def is_sound_tow_quiet(keys: dict[str, Any], example: str) -> tuple[bool, str]:
    """Whether a sound tow goes through without a cause named."""
    tow = tow_disturbed(read_tow_job(EXAMPLES / f"{example}.toml", keys), lambda world, seen: None)
    named = [event for event in tow.journal.events if event[1] not in ("start", "welded")]
    return not named and not tow.ended, f"{example}: {named[:3]} {tow.ended}"


def _passer_by_touches(truth: Any) -> set[str]:
    return {one for one in truth.touches if "passer-by" in one}


def _met_by_passer_by(job: TowJob, truth: Any) -> set[str]:
    """What the passer-by touches, and the links beside: pressed cable passes it from link to link.

    The plant's contacts are of the ends of links, and are looked for now and then: by distances, a
    link is met before its ends are.
    """
    met = _passer_by_touches(truth)
    middle, begin, way = truth.passers_by[0, :2], truth.line[:-1], np.diff(truth.line, axis=0)
    share = np.clip(((middle - begin) * way).sum(axis=1) / (way**2).sum(axis=1), 0.0, 1.0)
    links = np.hypot(*(begin + share[:, None] * way - middle).T) - job.cable.radius
    bodies = np.hypot(*(truth.poses[:, :2] - middle).T) - job.vehicles.radius
    reach = truth.passers_by[0, 2]
    met |= {f"link {k} and passer-by 1" for k in np.flatnonzero(links < reach)}
    met |= {f"passer-by 1 and vehicle {v + 1}" for v in np.flatnonzero(bodies < reach)}
    beside = [one.split(" ", 2) for one in met if one.startswith("link")]
    return met | {f"link {int(k) + by} {with_}" for _, k, with_ in beside for by in (-1, 1)}


def visiting_obstacle_keys(seed: int) -> dict[str, Any]:
    """Keys of a job in which an obstacle comes onto seam or cable, stands there, and leaves.

    Every other one comes from beyond the wall onto the seam ahead of the welder, the others onto
    the cable from where it bulges to. It begins well clear of the first shape.
    """
    rng = np.random.default_rng(seed)
    speed, radius = rng.uniform(0.03, 0.2), rng.uniform(0.05, 0.2)
    piece = seam_piece("tow-simulation", 0.3 + 0.4 * rng.random(), 0.2)
    x, y = piece["seam.points_mm"][0]
    if seed % 2:
        stop = np.array((x, y + rng.uniform(150, 250) + 1e3 * radius + 170))
        away = np.array((rng.uniform(-300, 300), 700.0))
    else:
        stop = np.array((rng.uniform(0.3, 0.7) * x, y - rng.uniform(300, 1200)))
        away = 900.0 * np.array((rng.uniform(-0.5, 0.5), -1.0))
    job = read_tow_job(EXAMPLES / "tow-simulation.toml", piece)
    links = 1e3 * check_seam(job, make_shape_planner(job)).start.link_poses[:, :2]
    begin = stop + away
    while np.hypot(*(links - begin).T).min() < 1e3 * (radius + job.vehicles.radius) + CLEAR_START:
        begin += 0.05 * away
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


def tow_past_visiting_obstacle(seed: int) -> tuple[int, bool, str, DisturbedTow]:
    """Touches caused by our motion, whether the tow was gone on with, words, and the tow."""
    job = read_tow_job(EXAMPLES / "tow-simulation.toml", visiting_obstacle_keys(seed))
    (hold,) = job.simulation.faults
    until = hold.at + (hold.seconds or 0.0)

    def hold_obstacle(world: TowingWorld, seen: SimulatedLocalisation) -> None:
        world.hold_passer_by(0, hold.at <= world.time < until)
        if world.time >= until and world._walked[0] < hold.at:  # the cable was in its way
            world._walked[0] = 2 * hold.at - world._walked[0]  # the same place, on its way back

    tow = tow_disturbed(job, hold_obstacle)
    ours, before = 0, deque[set[str]](maxlen=FLICKERING)
    for last, truth in zip(tow.journal.truths, tow.journal.truths[1:], strict=False):
        rests = bool((last.passers_by == truth.passers_by).all())
        before.append(_met_by_passer_by(job, last))
        ours += rests and bool(_passer_by_touches(truth).difference(*before))
    ours += sum(any("passer-by" not in one for one in t.touches) for t in tow.journal.truths)
    waits = [event for event in tow.journal.events if event[1] == "waits"]
    words = f"seed {seed}: {ours} touches, {tow.ended or 'welded'}, {[w[2] for w in waits][:2]}"
    return ours, not tow.ended, words, tow
