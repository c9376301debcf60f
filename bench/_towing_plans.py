"""How fast and how good the towed cable's plans are, without a plant: rows for `towing.py`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf, pi
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np
from _stopwatch import USUAL, Stopwatch
from _table import Row

from tjscan.core.frames import Array
from tjscan.towing.shape.area import DiscObstacle, Floor, Obstacles
from tjscan.towing.shape.cable import Cable, TowingTeam, equally_spaced_links
from tjscan.towing.shape.limited import optimise_within_limits
from tjscan.towing.shape.limits import LimitedProblem
from tjscan.towing.shape.plan import PlanInputs, PlannerSettings, PoseAccuracy, TowingPlan
from tjscan.towing.shape.planner import TowingPlanner, optimise_without_limits
from tjscan.towing.shape.problem import ShapeProblem
from tjscan.towing.shape.start import search_shape, start_shapes
from tjscan.towing.tables import LimitSettings, TargetSettings, WeightSettings

OPTIMA: Final = Path(__file__).with_name("towing-optima.json")
"""Best shapes of 30 problems, by `_towing_optima.py`."""

DT, STEP = 0.1, 0.001
"""Of V-C: plans at 10 Hz, the welder at 600 mm/min."""

YARD: Final = Floor([(0, -5), (2.6, -5), (2.6, 5), (0, 5)])
WIDE: Final = Floor([(-10, -10), (10, -10), (10, 10), (-10, 10)])

BLOCK: Final = 20
"""Plans that are timed together."""

COLD_STARTS: Final = 20
"""Random shapes from which the best first shape is sought."""

PRESSED: Final = 0.12
"""Metres by which walls are wanted farther off than free plans keep: all then lie against a limit,
and all have a shape within it."""


@dataclass(frozen=True, slots=True)
class Tow:
    """A welder that goes along a wall, and a planner.

    Parameters
    ----------
    planner : TowingPlanner
    x, y : float
        Where the welder begins, metres.
    step : float
        From plan to plan, metres.
    """

    planner: TowingPlanner
    x: float = 2.6
    y: float = -4.8
    step: float = STEP

    def pose(self, k: int) -> Array:
        """Of the welder at the k-th plan."""
        return np.array((self.x, self.y + k * self.step, pi / 2))

    def plans(self, count: int, settle: int = 60) -> Iterator[TowingPlan]:
        """Plans along the wall, of vehicles that go where they are sent; then a halt, if any."""
        last = self.planner.starts(self.pose(0))[0]
        if not last.halt:
            for k in range(-settle, count):
                last = self.next(last, max(k, 0))
                if last.halt:
                    break
                if k >= 0:
                    yield last
        if last.halt:
            yield last

    def next(self, last: TowingPlan, k: int) -> TowingPlan:
        """The k-th plan."""
        return self.planner.plan(PlanInputs(last.held_poses, self.pose(k), DT, last))

    def timed(self, count: int) -> tuple[Stopwatch, list[TowingPlan]]:
        """Plans in blocks, each timed."""
        *_, last = self.plans(1)
        watch, plans = Stopwatch(), []
        for first in range(0, count, BLOCK):
            with watch:
                for k in range(first, first + BLOCK):
                    last = self.next(last, k + 1)
                    plans.append(last)
        return watch, plans


def is_stopped(plan: TowingPlan) -> bool:
    """Whether the welder waits: the plan halts, or only leads away from what came too near."""
    return bool(plan.halt or plan.retreat)


def rate_row(name: str, watch: Stopwatch, least_hz: float) -> Row:
    """A rate, held as the time of a plan, as on the usual machine."""
    taken = 1e3 * sum(watch.seconds) / (BLOCK * len(watch.seconds))
    at_least = f": {least_hz:g} Hz" if least_hz else ""
    limit = 1e3 / least_hz if least_hz else inf
    return Row(f"{name}{at_least}", taken, limit, "ms", slowdown=watch.slowdown)


def rate_rows() -> list[Row]:
    """Plans with no limit near, and pressed against one all the way."""
    free, plans = Tow(TowingPlanner(Cable(), TowingTeam(), YARD), y=-1.5).timed(400)
    bound = sum(bool(plan.limits) or is_stopped(plan) for plan in plans)
    nearest = min(
        float(min(p.held_poses[:-1, 0].min(), 2.6 - p.held_poses[:-1, 0].max())) for p in plans
    )
    near = LimitSettings(link_clearance=0.02, vehicle_clearance=nearest - 0.15 + PRESSED)
    tight = PlannerSettings(limits=near, trust=PoseAccuracy(0.5e-3, float(np.radians(0.1))))
    pressed, tight_plans = Tow(
        TowingPlanner(Cable(friction=0.0), TowingTeam(), YARD, tight), y=-1.5
    ).timed(200)
    share = 100 * float(np.mean([bool(p.limits) and not is_stopped(p) for p in tight_plans]))
    return [
        Row("reference task in the same run", 1e3 * USUAL * free.slowdown, inf, "ms"),
        rate_row("plan, mean of 400", free, 1500),
        Row("of them at a limit or halted", bound, 0),
        rate_row("plan with a hard limit active, mean of 200", pressed, 400),
        Row("of them at a limit", share, 100, "%", at_least=95),
    ]


def optimum_rows() -> list[Row]:
    """The 30 problems, from the estimate on, against the best of another solver."""
    gaps, off = [], 0.0
    for given in json.loads(OPTIMA.read_text(encoding="utf-8"))["problems"]:
        limits = made(given)
        problem = limits.problem
        angles, _ = optimise_without_limits(problem)
        if np.abs(angles).max() > problem.cable.joint_limit:
            angles = optimise_within_limits(limits, problem.estimate).angles
        gaps.append(100 * (problem.terms(angles).paper / given["f"] - 1))
        off = max(off, float(np.abs(problem.constraint(angles)[0]).max()))
    name = f"optimality gap, {len(gaps)} problems"
    return [
        Row(f"{name}: median", median(gaps), 0.1, "%"),
        Row(f"{name}: 90 %", float(np.percentile(gaps, 90)), 1.0, "%"),
        Row(f"{name}: largest", max(gaps), inf, "%"),
        Row(f"{name}: smallest", min(gaps), inf, "%"),
        Row("constraint, largest of them", off, 1e-6, "m or rad"),
    ]


def made(given: dict[str, list[float]]) -> LimitedProblem:
    """A problem of the file; of its limits only that of the joints holds."""
    (x, y), (far_x, far_y) = given["low"], given["high"]
    cable = Cable(least_bend_radius=0.05 / np.sin(0.385))
    cx, cy, radius = given["disc"]
    yard = Obstacles.of_area(Floor([(x, y), (far_x, y), (far_x, far_y), (x, far_y)]))
    floor = yard._replace(discs=np.array([(cx, cy, cx, cy, radius)]))
    bend, obstacle, change = given["weights"]
    weights = WeightSettings(bending=bend, distance=obstacle, change=change, pace=0.0)
    none, nowhere = np.zeros(0, dtype=np.int64), np.zeros((0, 2))
    problem = ShapeProblem(
        cable, floor, weights, TargetSettings(),
        np.array(given["estimate"]), np.array([59]), np.array([given["pose"]]), none, nowhere, DT,
    )  # fmt: skip
    off = LimitSettings(
        link_clearance=-100.0, vehicle_clearance=-100.0, vehicle_gap=-100.0, cable_gap=-100.0
    )
    return LimitedProblem(problem, TowingTeam(), off)


def cold_start_rows(which: slice = slice(None)) -> list[Row]:
    """First shapes of the problems, against the best of random starts and of another solver."""
    excess, rng = [], np.random.default_rng(20)
    for given in json.loads(OPTIMA.read_text(encoding="utf-8"))["problems"][which]:
        (x, y), (far_x, far_y) = given["low"], given["high"]
        pose = np.array(given["pose"]) - (0.0, 0.01, 0.0)  # at which `estimate` is best
        limits = made({**given, "pose": list(pose)})
        weights = replace(limits.problem.weights, change=0.0)
        limits = replace(limits, problem=replace(limits.problem, weights=weights))
        area = Floor([(x, y), (far_x, y), (far_x, far_y), (x, far_y)])
        guesses = [random_shape(rng) for _ in range(COLD_STARTS)]
        found = (search_shape(limits, guess) for guess in guesses)
        others = [np.array(given["estimate"]), *(shape for shape in found if shape is not None)]
        best = min(limits.problem.terms(shape).total for shape in others)
        first = limits.problem.terms(start_shapes(limits, area, pose)[0]).total
        excess.append(100 * (first / best - 1))
    name = f"cold start, {len(excess)} problems: objective over the best of {COLD_STARTS} starts"
    return [
        Row(f"{name}, largest", max(excess), 1.0, "%"),
        Row(f"{name}, smallest", min(excess), inf, "%"),
    ]


def random_shape(rng: np.random.Generator) -> Array:
    """Angles of three waves along the cable, radians."""
    along = np.linspace(0, 1, 60)
    waves = np.sin(rng.uniform(1, 9, (3, 1)) * along + rng.uniform(0, 6, (3, 1)))
    return np.asarray(0.08 * (rng.normal(size=(3, 1)) * waves).sum(axis=0))


def weight_rows() -> list[Row]:
    """V-B: how far the shape goes from where it was for a point beside it, by the printed weights.

    It was the best one without that point. The paper shows shapes, and states no figures: with no
    weight of change the shape goes far, with a weight of 1 it stays near.
    """
    pose, away = np.array((5.0, 0.0, -pi / 4)), [DiscObstacle(4.2, 1.0, 1e-3)]
    free = LimitSettings(link_clearance=0.0, vehicle_clearance=0.0)
    ways = []
    for change in (0.0, 1.0):
        weights = WeightSettings(bending=24, distance=75, change=change, pace=0.0)
        planner = TowingPlanner(Cable(), TowingTeam(), WIDE, PlannerSettings(weights, limits=free))
        before = planner.starts(pose)[0]
        problem = planner.limited_problem(
            before.angles, PlanInputs(before.held_poses, pose, DT, None, away)
        ).problem
        angles, _ = optimise_without_limits(problem)
        step = (problem.cable.poses(angles) - before.link_poses)[:, :2]
        ways.append(1e3 * float(np.hypot(*step.T).mean()))
    name = "V-B, links moved by a point beside them, mean: weights 24, 75"
    return [
        Row(f"{name}, 0", ways[0], inf, "mm"),
        Row(f"{name}, 1: less", ways[1], ways[0], "mm"),
    ]


def seam_rows() -> list[Row]:
    """V-C whole, quasi-static: what is asked of the towing vehicles, and the limits."""
    cable, team, limits = Cable(), TowingTeam(), PlannerSettings().limits
    speed, broken, bend, walls, bodies, gap, count, f = 0.0, 0, 0.0, inf, inf, inf, 0, []
    before = None
    for plan in Tow(TowingPlanner(cable, team, YARD)).plans(9600):
        count, broken = count + 1, broken + is_stopped(plan)
        links, held = plan.link_poses[3:-3, :2], plan.held_poses[:, :2]
        if before is not None:
            steps = held[:-1] - before.held_poses[:-1, :2]
            speed = max(speed, float(np.hypot(steps[:, 0], steps[:, 1]).max()) / DT)
        walls = min(walls, *(_to_walls(links)))
        bodies = min(bodies, *(_to_walls(held[:-1]) - team.body_radius))
        apart = np.hypot(*(held[:, None] - held[None]).T)[~np.eye(len(held), dtype=bool)]
        gap = min(gap, float(apart.min()) - 2 * team.body_radius)
        bend = max(bend, float(np.abs(plan.angles).max()))
        f.append(plan.terms.paper)
        before = plan
    return [
        Row("V-C, 9,600 plans: made and not halted", count - broken, inf, at_least=9600),
        Row("V-C: speed asked of a towing vehicle, largest", 1e3 * speed, 15, "mm/s"),
        Row("V-C: links to walls", 1e3 * walls, inf, "mm", at_least=1e3 * limits.link_clearance),
        Row(
            "V-C: bodies to walls", 1e3 * bodies, inf, "mm", at_least=1e3 * limits.vehicle_clearance
        ),
        Row("V-C: gap of two bodies", 1e3 * gap, inf, "mm", at_least=1e3 * limits.vehicle_gap),
        Row("V-C: joint angle", bend, cable.joint_limit, "rad"),
        Row(
            "V-C: objective, mean (the paper: 3.5, with losses of its own)", float(np.mean(f)), inf
        ),
    ]


def _to_walls(points: Array) -> Array:
    return np.concatenate((points[:, 0], 2.6 - points[:, 0], points[:, 1] + 5, 5 - points[:, 1]))


def link_rows() -> list[Row]:
    """How a plan's time grows with the links, each vehicle with ten to twenty of them.

    Vehicles have a force, so that the cable's pull is a limit, as in every job.
    """
    rows, taken = [], []
    for links, vehicles, limit in ((60, 6, 0.6), (400, 20, 5.0), (1000, 50, 15.0)):
        width, height = 2.6 * links / 60, 10.0 * links / 60
        yard = Floor([(0, -height / 2), (width, -height / 2), (width, height / 2), (0, height / 2)])
        team = TowingTeam(equally_spaced_links(links, vehicles), force=49.0)
        tow = Tow(TowingPlanner(Cable(links=links), team, yard), x=width, y=-0.15 * height)
        watch, plans = tow.timed(60)
        mean = sum(watch.seconds) / (BLOCK * len(watch.seconds))
        taken.append(mean)
        name = f"{links} links, {vehicles} vehicles: plan, mean of 60"
        rows.append(Row(name, 1e3 * mean, limit, "ms", slowdown=watch.slowdown))
        rows.append(Row(f"{links} links: plans halted", sum(map(is_stopped, plans)), 0))
    exponent = float(np.log(taken[2] / taken[0]) / np.log(1000 / 60))
    return [*rows, Row("a plan's time over the links, exponent", exponent, 1.2)]


def size_rows() -> list[Row]:
    """Other numbers of vehicles, other lengths of cable.

    Yards grow with the cable; the last is a hall in which 60 m lie in a meander.
    """
    rows = []
    for vehicles, links, length, least_hz, width, height in (
        (2, 60, 0.1, 0, 2.6, 10),
        (6, 60, 0.1, 0, 2.6, 10),
        (6, 100, 0.2, 0, 8.7, 33),
        (20, 100, 0.2, 0, 8.7, 33),
        (20, 120, 0.5, 10, 26, 100),
        (20, 120, 0.5, 10, 12, 24),
    ):
        low, high = -height / 2, height / 2
        cable = Cable(links=links, link_length=length, least_bend_radius=1.33 * length)
        team = TowingTeam(equally_spaced_links(links, vehicles), top_speed=0.1)
        yard = Floor([(0, low), (width, low), (width, high), (0, high)])
        tow = Tow(TowingPlanner(cable, team, yard), x=width, y=-0.15 * height)
        watch, plans = tow.timed(40)
        name = (
            f"{vehicles} vehicles, {links * length:g} m in {links} links, {width:g} × {height:g} m"
        )
        rows += [
            rate_row(f"{name}: plan, mean of 40", watch, least_hz),
            Row(f"{name}: plans halted", sum(map(is_stopped, plans)), 0),
        ]
    return rows


def plan_rows() -> list[Row]:
    """All of them."""
    return [
        *rate_rows(),
        *optimum_rows(),
        *cold_start_rows(),
        *weight_rows(),
        *seam_rows(),
        *link_rows(),
        *size_rows(),
    ]
