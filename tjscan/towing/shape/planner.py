"""From the vehicles' poses to the next ones: estimate, optimise, refuse. Suzuki et al., IV-A."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.area import LOOK_AHEAD, DiscObstacle, Floor, Obstacles
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.shape.estimate import BEND_DEVIATIONS, CableEstimate, HeldCable
from tjscan.towing.shape.limited import optimise_within_limits
from tjscan.towing.shape.limits import (
    BROKEN_LIMIT_TEXTS,
    LEAST_KEPT_MARGIN,
    LimitedProblem,
    LimitKind,
    LimitRows,
    format_figure,
    worst_margin,
)
from tjscan.towing.shape.plan import (
    PlanInputs,
    PlannerSettings,
    PlanTerms,
    TowingPlan,
)
from tjscan.towing.shape.problem import ShapeProblem, minimise_objective
from tjscan.towing.shape.start import start_shapes

POSE_TOLERANCE: Final = 1e-6
"""Metres and radians within which fixed links must have their poses."""

LEAST_POSE_MISS: Final = 1e-3
"""Metres of a missed pose below which a limit that is broken, too, shows better what is wrong."""

LEAST_RETREAT: Final = 1e-4
"""Metres by which a plan must lead away from what came too near: less is not worth a way."""

LONGEST_LINK_STEP: Final = 0.05
"""Metres that a link moves at most from one shape looked at to the next, on its way to the plan."""

LARGEST_OVERLAP: Final = 0.01
"""Metres by which the estimated cable may be nearer to a body, or to itself, than a plan may bring
it, and a body to a wall: the floor holds the cable back, and vehicles go too far."""

NEAR_BEND_LIMIT: Final = 0.7
"""Share of the joints' limit from which on it is found how well the angles are known."""

MOST_PROGRAMS: Final = 12
"""Quadratic programs of a plan; three are usual from the last plan's shape. What has not ended then
goes to and fro beside an obstacle that comes too quickly."""

LEAST_GROWTH: Final = 1e-4
"""Metres and radians by which a limit must be broken further until vehicles are held: less is no
way."""

NEAR_LIMIT: Final = 0.05
"""Metres to spare below which the estimated cable is near to a limit: some periods of a vehicle's
way."""

WAY_TO_PLAN: Final = ((1 / 3, 0, 0), (2 / 3, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1))
"""Steps in which it is found how the floor bends the cable on the way to a plan: the shares of that
way, of what vehicles then drive on, and turn on. What slides first depends on the way, and a single
step finds other bends; and vehicles that are stopped may turn on for longer than they drive on."""

DRIVEN_ON: Final = 0.1
"""Seconds for which vehicles drive on as they were sent, after a plan that stops them."""

NEWTON_ITERATIONS: Final = 60
"""Of Newton's method; four or five are usual."""

PERIOD_OF_START_PROBLEM: Final = 1e9
"""Seconds: a start has no step before it."""

NO_START_TEXT: Final = (
    "no shape of the cable was found that reaches the welder, bends within its limit and keeps its "
    "clearances: move the root, the seam or the held links, or allow less clearance"
)

GRADIENT_TOLERANCE: Final = 1e-4
"""Largest entry of the Lagrangian's gradient at which it ends."""


class TowingPlanner:
    """The planner, a `plan.ShapePlanner`. It keeps nothing from one plan to the next.

    Parameters
    ----------
    cable : Cable
    team : TowingTeam
    area : Floor
    settings : PlannerSettings, optional
    """

    def __init__(
        self, cable: Cable, team: TowingTeam, area: Floor, settings: PlannerSettings | None = None
    ) -> None:
        self.cable, self.team, self.area = cable, team, area
        self.settings = settings or PlannerSettings()
        self._held = np.array(team.held_links, dtype=np.int64)
        self._floor = Obstacles.of_area(area)
        self._bend_limit = max(self.settings.bend_limit, cable.joint_limit)

    def plan(self, inputs: PlanInputs) -> TowingPlan:
        """Estimate the cable's shape, then the best one near it. See `plan.ShapePlanner`.

        The floor holds the cable back: on the way to the plan, a joint may bend further than it is
        planned to, or a link come nearer to something. Then the vehicle on one side of it stays
        where it was sent, or on both, or the one that comes too near, or all but one, or all, and
        the welder waits. If even the way to there breaks another limit than the clearance of a
        disc, all stop where they are.

        Raises
        ------
        ValueError
            A pose of the welder or a period that is no number.
        """
        last = inputs.last or self.starts(inputs.welder_pose, inputs.obstacles)[0]
        limits, now, plan = self._plan_shape(inputs, last)
        sent = last.held_poses
        if plan.halt or (astray := self._led_astray(limits, now, plan, sent)) is None:
            return plan
        row, words = astray
        words = f"{plan.retreat}; {words}" if plan.retreat else words
        towing = np.arange(len(self._held))
        piece, other = np.searchsorted(self._held, (row["link"], row["other"]))
        after, before = towing == piece, towing == piece - 1
        apart = (towing != other,) if row["other"] >= 0 else ()
        some = (~after, ~before, ~(after | before), *apart, *(towing == v for v in towing[:-1]))
        for moves in (*some, towing < 0):
            poses = np.where(moves[:, None], plan.held_poses, sent)
            tried = replace(plan, held_poses=poses, retreat=words)
            if (astray := self._led_astray(limits, now, tried, sent)) is None:
                return tried
            row, _ = astray
        links, angles = last.link_poses, last.angles
        if row["disc"] < 0:
            sent = np.where(np.isfinite(inputs.poses), inputs.poses, sent)
        return replace(plan, angles=angles, link_poses=links, held_poses=sent, retreat=words)

    def _led_astray(
        self, limits: LimitedProblem, now: CableEstimate, plan: TowingPlan, sent: Array
    ) -> tuple[np.void, str] | None:
        """What breaks a limit on the way to a plan, by more than now: a row of limits, and words.

        The way is that of the cable as it is estimated, as far as the floor lets the vehicles draw
        it, and as vehicles drive on for `DRIVEN_ON` after they are stopped. They can't come further
        than they drive and turn till then.
        """
        links, bent = self.cable.poses(now.angles), now.angles
        near = self._heeded_rows(limits, plan, bent, links, NEAR_LIMIT)
        if not len(near):
            return None
        led, held, trust = now, self._held, self.settings.trust
        drives, period = np.isin(held, limits.problem.paced), limits.problem.period
        steps = np.stack(
            (plan.held_poses - links[held], (plan.held_poses - sent) * drives[:, None])
        )
        steps[..., 2] -= 2 * np.pi * np.round(steps[..., 2] / (2 * np.pi))
        steps[1] *= min(1.0, DRIVEN_ON / period)
        reach = (period + DRIVEN_ON) * self.team.top_speed
        turn = reach / self.team.body_radius
        for share, on, turned in WAY_TO_PLAN:
            way = share * steps[0] + (on, on, turned) * steps[1]
            way[:, :2] *= np.minimum(1, reach / np.maximum(np.hypot(*way.T[:2]), reach))[:, None]
            way[:, 2] = np.clip(way[:, 2], -turn, turn)
            cable = HeldCable(self.cable, self.team.held_links, links[held] + way, trust)
            led = cable.estimate(led)
            bent = np.where(np.abs(led.angles) > np.abs(bent), led.angles, bent)
        rows = self._heeded_rows(limits, plan, bent, self.cable.poses(led.angles), 0.0)
        rows = _broken_further(rows, near, _apart_or_bent, LEAST_GROWTH)
        if not len(rows):
            return None
        row = rows[rows["margin"].argmin()]
        words, joint = limits.describe(row, BROKEN_LIMIT_TEXTS), int(row["link"])
        if row["kind"] == LimitKind.JOINT and plan.deviations is not None:
            doubt = BEND_DEVIATIONS * plan.deviations[joint]
            bend = f"{np.degrees(abs(bent[joint])):.1f}° ± {np.degrees(doubt):.1f}°"
            limit = f"{np.degrees(self._bend_limit):.1f}°"
            words = f"joint {joint} would be bent by {bend}, and its limit is {limit}"
        return row, f"the floor holds the cable back: {words}"

    def _heeded_rows(
        self, limits: LimitedProblem, plan: TowingPlan, angles: Array, links: Array, band: float
    ) -> LimitRows:
        """Rows of limits that are kept as the floor lets the cable go, with a margin below a band.

        A joint's margin is less by its doubt. Walls hold vehicles off alone: links lie along them.
        """
        rows = limits.rows(angles, band + LARGEST_OVERLAP, links)
        kind, disc, joint = rows["kind"], rows["disc"] >= 0, rows["kind"] == LimitKind.JOINT
        doubts = np.zeros(len(angles)) if plan.deviations is None else plan.deviations
        reserve = self._bend_limit - self.cable.joint_limit - BEND_DEVIATIONS * doubts[rows["link"]]
        overlap = np.where(disc | (kind == LimitKind.BODY_TO_BODY), 0.0, LARGEST_OVERLAP)
        rows["margin"] += np.where(joint, reserve, overlap)
        heeded = disc | ((kind > LimitKind.LINK_TO_OBSTACLE) & (kind < LimitKind.SPEED))
        heeded |= joint & (plan.deviations is not None)
        found: LimitRows = rows[heeded & (rows["margin"] < band)]
        return found

    def _plan_shape(
        self, inputs: PlanInputs, last: TowingPlan
    ) -> tuple[LimitedProblem, CableEstimate, TowingPlan]:
        """The problem, the estimate, and the best shape, as if the floor did not hold it back."""
        poses, welder_pose, period = inputs.poses, inputs.welder_pose, inputs.period
        if not (np.isfinite(welder_pose).all() and np.isfinite(period) and period > 0):
            raise ValueError(f"no plan for a welder at {welder_pose} in {period} s")
        held = HeldCable(self.cable, self.team.held_links, poses, self.settings.trust)
        rest = self.cable.poses(last.estimate)[:, :2] if last.rest is None else last.rest
        now = held.estimate(CableEstimate(last.estimate, rest))
        limits = self.limited_problem(now.angles, inputs)
        if self.settings.weights.pull and self.team.welder - 1 not in inputs.stopped:
            pull = held.pull_on_welder(now, (welder_pose - poses[-1])[:2])
            limits = replace(limits, problem=replace(limits.problem, pull=pull))
        shape, pressed, iterations = self._search_shape(limits, now.angles, last)
        halt = shape.objection(pressed)
        if halt:
            # The floor may hold the cable on the other side of an obstacle than it was planned.
            shape, pressed, more = self._search_shape(limits, now.angles, None)
            halt, iterations = shape.objection(pressed), iterations + more
        retreat = "" if halt or shape.is_feasible else shape.broken_limit(pressed)
        forces, tension = held.forces(now)
        is_near = np.abs(now.angles).max() > NEAR_BEND_LIMIT * self.cable.joint_limit
        plan = shape.plan(
            limits=pressed,
            iterations=iterations,
            halt=halt,
            retreat=retreat,
            rest=now.rest,
            deviations=held.angle_deviations(now, inputs.sigmas) if is_near else None,
            forces=forces,
            tension=tension,
        )
        return limits, now, plan

    def _search_shape(
        self, limits: LimitedProblem, estimate: Array, last: TowingPlan | None
    ) -> tuple[CheckedShape, tuple[str, ...], int]:
        """The best shape near the last plan's, or the estimate's; what presses it, and iterations.

        Limits are looked at first if they pressed the last plan.
        """
        start, iterations = estimate if last is None else last.angles, 0
        if last is None or not last.limits:
            angles, iterations = optimise_without_limits(limits.problem, start)
            shape = CheckedShape(limits, angles)
            if shape.is_feasible:
                return shape, (), iterations
        limited = optimise_within_limits(limits, start, most=MOST_PROGRAMS)
        pressed = tuple(limits.describe(row) for row in limited.pressed)
        return CheckedShape(limits, limited.angles), pressed, iterations + limited.iterations

    def starts(
        self, welder_pose: Array, obstacles: Sequence[DiscObstacle] = ()
    ) -> list[TowingPlan]:
        """Best shapes of many searches. See `plan.ShapePlanner`."""
        limits = self.start_problem(welder_pose, obstacles)
        plans, problem, resting = [], limits.problem, limits.problem.estimate
        for angles in start_shapes(limits, self.area, welder_pose):
            begun = replace(limits, problem=replace(problem, estimate=angles))
            shape = CheckedShape(begun, angles)
            if shape.is_feasible:
                plans.append(shape.plan())
        # Compiled functions are loaded before anything moves: no plan may have to wait for them.
        optimise_within_limits(limits, plans[0].angles if plans else resting, most=1)
        last = plans[0] if plans else None
        for _ in range(2 if last else 0):  # from the second plan on, friction is known
            last = self.plan(PlanInputs(plans[0].held_poses, welder_pose, 1.0, last))
        return plans or [CheckedShape(limits, resting).plan(halt=NO_START_TEXT)]

    def start_problem(
        self, welder_pose: Array, obstacles: Sequence[DiscObstacle]
    ) -> LimitedProblem:
        """The problem of a first shape, which has no shape before it to stay near to."""
        unknown = np.full((len(self._held), 3), np.nan)
        inputs = PlanInputs(unknown, welder_pose, PERIOD_OF_START_PROBLEM, None, obstacles)
        limits = self.limited_problem(np.zeros(self.cable.links), inputs)
        weights = replace(self.settings.weights, change=0.0, pace=0.0)
        return replace(limits, problem=replace(limits.problem, weights=weights))

    def limited_problem(self, estimate: Array, inputs: PlanInputs) -> LimitedProblem:
        """The problem of one period, and the limits that its solution must keep."""
        s, now, last = self.settings, self.cable.poses(estimate)[self._held], inputs.last
        still = [m for m in sorted(inputs.stopped) if m != self.team.welder]
        drives = [m for m in range(self.team.welder) if m not in still]
        begins = now if last is None or last.halt else last.held_poses
        floor = self._floor.with_discs(inputs.obstacles, LOOK_AHEAD)
        fixed, fixed_poses = [*still, self.team.welder], np.vstack((now[still], inputs.welder_pose))
        problem = ShapeProblem(
            *(self.cable, floor, s.weights, s.targets, estimate, self._held[fixed], fixed_poses),
            *(self._held[drives], begins[drives].copy(), inputs.period),
        )
        return LimitedProblem(problem, self.team, s.limits, tuple(d.name for d in inputs.obstacles))


def _what(row: np.void) -> tuple[int, int]:
    """What a row of limits holds apart: its kind, and the obstacle."""
    return int(row["kind"]), int(row["disc"])


def _apart_or_bent(row: np.void) -> tuple[int, int]:
    """Group of limits that make up for each other: links at obstacles; bodies; cable; a joint."""
    match kind := LimitKind(row["kind"]):
        case LimitKind.JOINT:
            return kind, int(row["link"])
        case LimitKind.BODY_TO_OBSTACLE | LimitKind.BODY_TO_BODY:
            return LimitKind.BODY_TO_BODY, -1
        case LimitKind.LINK_TO_BODY | LimitKind.LINK_TO_LINK:
            return LimitKind.LINK_TO_LINK, -1
    return kind, -1


def _broken_further(
    rows: LimitRows, before: LimitRows, group: Callable[[np.void], tuple[int, int]], growth: float
) -> LimitRows:
    """Rows that are broken by more, and by a growth, than any of their group was before."""
    worst: dict[tuple[int, int], float] = {}
    for row in before:
        worst[group(row)] = min(worst.get(group(row), 0.0), float(row["margin"]))
    allowed = np.array([worst.get(group(row), 0.0) for row in rows])
    broken: LimitRows = rows[rows["margin"] < allowed - growth]
    return broken


def optimise_without_limits(problem: ShapeProblem, start: Array | None = None) -> tuple[Array, int]:
    """Solution without limits, from a start or the estimate on; angles and iterations."""
    angles = np.array(problem.estimate if start is None else start)
    return angles, minimise_objective(angles, NEWTON_ITERATIONS, GRADIENT_TOLERANCE, *problem.plain)


class CheckedShape:
    """A shape compared with all that it must meet.

    Parameters
    ----------
    limits : LimitedProblem
        With their problem.
    angles : ndarray, shape (N,)
    """

    def __init__(self, limits: LimitedProblem, angles: Array) -> None:
        self.problem, self.limits, self.angles = limits.problem, limits, angles
        self._state = self.problem.evaluated(angles)
        self.off = float(np.abs(self._state.constraint).max())
        self.rows = limits.rows(angles)
        self.margin = worst_margin(self.rows)

    @property
    def is_feasible(self) -> bool:
        """Whether it has the poses it must have and keeps every limit."""
        return self.off < POSE_TOLERANCE and self.margin > LEAST_KEPT_MARGIN

    def objection(self, pressed: Sequence[str] = ()) -> str:
        """Why it may not be sent to vehicles whose cable is as estimated, or nothing.

        Parameters
        ----------
        pressed : sequence of str, optional
            Limits that hold the shape where it is.
        """
        begins = self.problem.cable.poses(self.problem.estimate)
        if not self.is_feasible and not self._leads_away_from_discs(begins):
            return self.broken_limit(pressed)
        way = self._state.links[:, :3] - begins
        steps = int(np.ceil(np.hypot(way[:, 0], way[:, 1]).max() / LONGEST_LINK_STEP))
        for k in range(1, steps):
            between = self._rows_of_places(begins + k / steps * way, -LONGEST_LINK_STEP)
            entered = self._rows_of_places(begins) if len(between) else between
            broken = _broken_further(between, entered, _what, 0.0)
            if len(broken):
                return f"on the way there, {self._worst_row(broken)}"
        return ""

    def _rows_of_places(self, links: Array, band: float = 0.0) -> LimitRows:
        """Rows of limits that a shape breaks by where it is, not by bends or ways of vehicles."""
        rows = self.limits.rows(self.angles, band, links)
        placed: LimitRows = rows[rows["kind"] < LimitKind.SPEED]
        return placed

    def _leads_away_from_discs(self, begins: Array) -> bool:
        """Whether it breaks only clearances of discs, and less than where the cable is.

        What comes may be quicker than vehicles can drive.
        """
        discs, here = self.rows["disc"] >= 0, self._rows_of_places(begins)
        return (
            self.off < POSE_TOLERANCE
            and worst_margin(self.rows[~discs]) > LEAST_KEPT_MARGIN
            and self.margin > worst_margin(here[here["disc"] >= 0]) + LEAST_RETREAT
        )

    def broken_limit(self, pressed: Sequence[str] = ()) -> str:
        """What it breaks, in words; see `objection`."""
        if self.margin < LEAST_KEPT_MARGIN and self.off < max(-self.margin, LEAST_POSE_MISS):
            return self._worst_row(self.rows)
        held = f"; what holds it: {', '.join(pressed[:3])}" if pressed else ""
        return (
            "the cable does not reach within its limits: it ends "
            f"{format_figure(1e3 * self.off)} mm short of the welder or of a vehicle that "
            f"does not move{held}"
        )

    def _worst_row(self, rows: LimitRows) -> str:
        return self.limits.describe(rows[rows["margin"].argmin()], BROKEN_LIMIT_TEXTS)

    def plan(self, **more: Any) -> TowingPlan:
        """The plan of this shape, with what else a `TowingPlan` states."""
        poses, terms = self._state.links[:, :3].copy(), PlanTerms(*self._state.terms.tolist())
        held_poses, estimate = poses[list(self.limits.team.held_links)], self.problem.estimate
        return TowingPlan(estimate, self.angles, poses, held_poses, terms, self.off, **more)
