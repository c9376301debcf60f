"""What every plan keeps, and what makes one halt."""

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest
import shapely
from towed import YARD, bent_angles, margin_gradients, objective_gradient, objective_hessian

from tjscan.core.frames import Array
from tjscan.towing.shape.area import DiscObstacle, Floor
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.shape.estimate import CableEstimate, HeldCable
from tjscan.towing.shape.limited import optimise_within_limits
from tjscan.towing.shape.limits import BROKEN_LIMIT_TEXTS, LimitKind
from tjscan.towing.shape.paper_planner import PaperPlanner
from tjscan.towing.shape.plan import PlanInputs, PlannerSettings, PoseAccuracy, TowingPlan
from tjscan.towing.shape.planner import CheckedShape, TowingPlanner, optimise_without_limits
from tjscan.towing.tables import LimitSettings, WeightSettings

CABLE, TEAM, TRUST = Cable(), TowingTeam(), PoseAccuracy()
HELD = list(TEAM.held_links)
WELDER = np.array((2.6, -3.0, pi / 2))
STEP = np.array((0.0, 0.001, 0.0))


def planner(vehicle_clearance: float = 0.02) -> TowingPlanner:
    limits = LimitSettings(link_clearance=0.02, vehicle_clearance=vehicle_clearance)
    accuracy = PoseAccuracy(0.5e-3, np.radians(0.1))
    return TowingPlanner(CABLE, TEAM, YARD, PlannerSettings(limits=limits, trust=accuracy))


@pytest.fixture(scope="module")
def begun() -> TowingPlan:
    """A plan to go on from, with the welder at the yard's long wall."""
    ours, two = planner(), np.array([(1.3, -1.0, -pi / 2), WELDER])
    free = replace(CABLE, friction=0.0)
    laid = CableEstimate.without_floor_pull(free, ours.starts(WELDER)[0].angles)
    start = HeldCable(free, [19, 59], two, TRUST).estimate(laid).angles
    limits = ours.limited_problem(start, PlanInputs(np.zeros((6, 3)), WELDER, 1.0))
    problem = replace(limits.problem, weights=WeightSettings(change=0, pace=0))
    angles, _ = optimise_without_limits(problem)
    plan = CheckedShape(replace(limits, problem=problem), angles).plan()
    for _ in range(20):
        plan = ours.plan(PlanInputs(plan.held_poses, WELDER, 0.1, plan))
    assert not plan.halt
    return plan


def next_inputs(plan: TowingPlan) -> PlanInputs:
    return PlanInputs(plan.held_poses, WELDER + STEP, 0.1, plan)


def clearance(plan: TowingPlan) -> tuple[float, float, float]:
    """Of links and vehicles to the yard's walls, and between vehicles, by shapely."""
    yard = shapely.Polygon(YARD.outline)
    line = CABLE.line(plan.angles)
    middle = shapely.LineString(line[3:-3])
    bodies = shapely.points(plan.held_poses[:, :2])
    apart = shapely.distance(bodies[:, None], bodies[None])[~np.eye(len(bodies), dtype=bool)]
    assert yard.contains(middle)
    return (
        float(yard.exterior.distance(middle)),
        float(shapely.distance(yard.exterior, bodies[:-1]).min()),
        float(apart.min()),
    )


def follow(
    ours: TowingPlanner, plan: TowingPlan, steps: int, stopped: tuple[int, ...] = ()
) -> list[TowingPlan]:
    plans = [plan]
    for k in range(steps):
        now = plans[-1]
        pose = WELDER + (k + 1) * STEP
        plans.append(ours.plan(PlanInputs(now.held_poses, pose, 0.1, now, stopped=stopped)))
    return plans


def test_the_tip_is_where_the_welder_will_be_and_vehicles_hardly_move(begun: TowingPlan) -> None:
    before, *plans = follow(planner(), begun, 10)
    for k, plan in enumerate(plans):
        assert not plan.halt
        np.testing.assert_allclose(plan.held_poses[-1], WELDER + (k + 1) * STEP, atol=1e-6)
        steps = np.hypot(*(plan.held_poses - before.held_poses)[:-1, :2].T)
        assert steps.max() < 1.5 * 0.001
        before = plan


def test_the_end_meets_the_conditions_of_an_optimum(begun: TowingPlan) -> None:
    ours = planner()
    problem = ours.limited_problem(begun.estimate, next_inputs(begun)).problem
    angles, _ = optimise_without_limits(problem)
    _, rows = problem.constraint(angles)
    gradient = objective_gradient(problem, angles)
    y: Array = np.asarray(np.linalg.lstsq(rows.T, -gradient, rcond=None)[0], dtype=float)
    assert np.abs(gradient + rows.T @ y).max() < 1e-3
    along = np.linalg.svd(rows)[2][3:]
    assert np.linalg.eigvalsh(along @ objective_hessian(problem, angles, y) @ along.T).min() > 0


def test_limits_that_press_are_kept_to_the_last_micrometre(begun: TowingPlan) -> None:
    _, walls, _ = clearance(begun)
    asked = walls - TEAM.body_radius + 0.01
    plans = follow(planner(vehicle_clearance=asked), begun, 40)
    plan = plans[-1]
    assert not plan.halt
    assert any("to obstacle" in name for name in plan.limits)
    assert clearance(plan)[1] >= TEAM.body_radius + asked
    assert clearance(plan)[1] == pytest.approx(TEAM.body_radius + asked, abs=1e-4)


def test_a_limited_shape_is_no_better_than_a_free_one_and_no_gradient_is_left(
    begun: TowingPlan,
) -> None:
    _, walls, _ = clearance(begun)
    ours = planner(vehicle_clearance=walls - TEAM.body_radius + 5e-3)
    limits = ours.limited_problem(begun.estimate, next_inputs(begun))
    problem, shape = limits.problem, optimise_within_limits(limits, begun.estimate)
    free, _ = optimise_without_limits(problem)
    assert len(shape.pressed) > 0
    assert problem.terms(shape.angles).total > problem.terms(free).total
    _, rows = problem.constraint(shape.angles)
    A = np.vstack((rows, margin_gradients(limits, shape.pressed, shape.angles)))
    gradient = objective_gradient(problem, shape.angles)
    y = np.linalg.lstsq(A.T, -gradient, rcond=None)[0]
    assert np.abs(gradient + A.T @ y).max() < 1e-2 * np.abs(gradient).max()
    assert (y[3:] < 0).all()


def test_out_of_reach_halts_and_says_so(begun: TowingPlan) -> None:
    plan = planner().plan(PlanInputs(begun.held_poses, WELDER - (0, 7, 0), 0.1, begun))
    assert "does not reach" in plan.halt


def test_a_vehicle_that_stands_keeps_its_place(begun: TowingPlan) -> None:
    for plan in follow(planner(), begun, 20, stopped=(2,))[1:]:
        assert not plan.halt
        np.testing.assert_allclose(plan.held_poses[2], begun.held_poses[2], atol=1e-3)


def test_a_welder_beyond_reach_of_one_that_stands_halts_and_says_so(begun: TowingPlan) -> None:
    """Programs without a solution are given up after so many steps."""
    for ahead in (0.15, 0.3):
        tip = WELDER + np.array((0.0, ahead, 0.0))
        plan = planner().plan(PlanInputs(begun.held_poses, tip, 0.1, begun, stopped=(4,)))
        assert "does not reach" in plan.halt


def test_what_is_where_a_link_must_go_makes_the_welder_wait(begun: TowingPlan) -> None:
    """The cable can neither stay nor be away in time: it leads away as vehicles can drive."""
    x, y, _ = begun.link_poses[25]
    there = [DiscObstacle(x, y, 0.3, name="crate")]
    plan = planner().plan(PlanInputs(begun.held_poses, WELDER, 0.1, begun, there))
    assert "too near to crate" in plan.halt + plan.retreat
    steps = np.hypot(*(plan.held_poses - begun.held_poses)[:-1, :2].T)
    assert plan.halt or steps.max() <= 0.1 * TEAM.top_speed + 1e-6


def test_a_cable_that_the_floor_holds_across_itself_is_drawn_no_further_unless_that_frees_it(
    begun: TowingPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cable of 60 links lies nearly in a circle, or in more than one, across itself."""
    team = TowingTeam(TEAM.held_links, body_radius=1e-3)
    ours, plan = TowingPlanner(CABLE, team, Floor([(-9, -9), (9, -9), (9, 9), (-9, 9)])), begun
    limits = ours.limited_problem(begun.angles, PlanInputs(begun.held_poses, WELDER, 0.1, begun))
    free, worse = (CableEstimate.without_floor_pull(CABLE, np.full(60, a)) for a in (0.1035, 0.13))
    for now, led, words in ((free, worse, "too near"), (worse, free, "")):
        monkeypatch.setattr(HeldCable, "estimate", lambda *_, led=led: led)
        astray = ours._led_astray(limits, now, plan, begun.held_poses)
        assert (astray is not None) == bool(words)
        assert astray is None or words in astray[1]


def test_vehicles_go_straight_to_a_shape_that_bulges_to_the_other_side(
    begun: TowingPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first vehicle does not move at all: what is ahead of it is not in its way."""
    headings = np.where(np.arange(60) < 5, 0.8, np.where(np.arange(60) < 10, -0.8, -pi / 2))
    left = np.diff(headings, prepend=0.0)
    right = np.diff(np.where(np.arange(60) < 10, -headings, headings), prepend=0.0)
    x, y, _ = CABLE.poses(left)[9]
    post = DiscObstacle(x + 0.3, y, 0.1, name="post")
    monkeypatch.setattr(CheckedShape, "is_feasible", True)
    inputs = PlanInputs(begun.held_poses, WELDER, 0.1, begun, [post])
    shape = CheckedShape(planner().limited_problem(left, inputs), right)
    assert "post" not in shape.objection()


def test_a_step_that_is_not_the_solvers_is_not_taken(
    begun: TowingPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is solved again with nearly dependent rows may be any step."""
    x, y, _ = begun.held_poses[2]
    disc = DiscObstacle(x + 0.3, y + 0.1, 0.2, name="trolley")
    inputs = PlanInputs(begun.held_poses, WELDER, 0.1, begun, [disc])
    solve, spoilt = np.linalg.solve, list[Array]()

    def solve_wrongly(matrix: Array, right: Array) -> Array:
        spoilt.append(right)
        return np.asarray(solve(matrix, right) + 0.1)

    limits = planner().limited_problem(begun.angles, inputs)
    sound = optimise_within_limits(limits, begun.angles, most=1)
    monkeypatch.setattr(np.linalg, "solve", solve_wrongly)
    found = optimise_within_limits(limits, begun.angles, most=1)
    assert found.angles == pytest.approx(sound.angles, abs=1e-4)
    assert spoilt


def test_the_cable_makes_way_for_who_passes_by(begun: TowingPlan) -> None:
    """A disc comes at the bulge with 50 mm/s: vehicles may do 100."""
    ours = planner()
    plan, at = begun, begun.link_poses[24]
    away = np.array((-np.sin(at[2]), np.cos(at[2])))
    away *= -np.sign(away @ (at[:2] - (1.3, 0)))
    centre = at[:2] + 0.7 * away
    for k in range(60):
        x, y = centre - 0.005 * k * away
        disc = DiscObstacle(x, y, 0.2, (-0.05 * away[0], -0.05 * away[1]))
        plan = ours.plan(PlanInputs(plan.held_poses, WELDER, 0.1, plan, [disc]))
        assert not plan.halt
        line = shapely.LineString(CABLE.line(plan.angles))
        assert line.distance(shapely.Point(x, y)) > 0.2 + 0.02


def test_vehicles_that_make_way_do_not_bend_the_cable_that_the_floor_holds_too_far(
    begun: TowingPlan,
) -> None:
    """A trolley drives at vehicle 4. Without a look at the floor's hold a joint is bent by 53°."""
    ours, bends, retreats = planner(), dict[bool, float](), list[str]()
    for heeds_floor in (False, True):
        plan, angles = begun, []
        for k in range(36):
            x, y = begun.held_poses[3, :2] + (0.45 - 0.015 * k, 0.0)
            disc = DiscObstacle(x, y, 0.15, (-0.15, 0.0), name="trolley")
            inputs = PlanInputs(plan.held_poses, WELDER, 0.1, plan, [disc])
            found = ours.plan(inputs) if heeds_floor else ours._plan_shape(inputs, plan)[-1]
            stays = replace(plan, estimate=found.estimate, rest=found.rest)
            plan = stays if found.halt else found
            angles.append(np.abs(found.estimate).max())
            retreats += [found.retreat] * heeds_floor
        bends[heeds_floor] = float(np.max(angles))
    assert bends[True] < CABLE.joint_limit < bends[False] - 0.05
    assert any("the floor holds the cable back" in words for words in retreats)


def test_estimates_come_back_from_their_own_poses() -> None:
    free, angles = replace(CABLE, friction=0.0), bent_angles(np.random.default_rng(0))
    bent = CABLE.poses(angles)
    lies = CableEstimate.without_floor_pull(free, angles)
    shape = HeldCable(free, HELD, bent[HELD], TRUST).estimate(lies)
    again = HeldCable(CABLE, HELD, CABLE.poses(shape.angles)[HELD], TRUST).estimate(shape)
    np.testing.assert_allclose(again.angles, shape.angles, atol=2e-3)
    np.testing.assert_allclose(CABLE.poses(shape.angles)[HELD, :2], bent[HELD, :2], atol=2e-3)


def noisy(poses: Array, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return poses + rng.normal(size=poses.shape) * (3e-3, 3e-3, np.radians(1))


def test_noise_that_stretches_the_cable_still_gives_a_shape(begun: TowingPlan) -> None:
    straight = CABLE.poses(np.zeros(60))[HELD]
    lies = CableEstimate.without_floor_pull(CABLE, np.zeros(60))
    for seed in range(5):
        poses = noisy(straight, seed) * (1.002, 1.0, 1.0)
        shape = HeldCable(CABLE, HELD, poses, TRUST).estimate(lies).angles
        assert np.abs(CABLE.poses(shape)[HELD, :2] - poses[:, :2]).max() < 0.02
        assert np.abs(shape).max() < 0.2


def test_a_pose_unknown_is_a_pose_less_and_not_a_fault(begun: TowingPlan) -> None:
    poses = begun.held_poses.copy()
    poses[1:3] = np.nan
    last = CableEstimate.without_floor_pull(CABLE, begun.angles)
    shape = HeldCable(CABLE, HELD, poses, TRUST).estimate(last).angles
    assert np.hypot(*(CABLE.poses(shape) - begun.link_poses)[:, :2].T).max() < 0.05


def test_what_is_no_number_is_refused(begun: TowingPlan) -> None:
    with pytest.raises(ValueError, match="no plan"):
        planner().plan(PlanInputs(begun.held_poses, WELDER * np.nan, 0.1, begun))
    with pytest.raises(ValueError, match="place must be finite"):
        DiscObstacle(np.nan, 0.0, 0.1)


def test_a_start_keeps_every_limit_and_is_found_at_the_far_end_too() -> None:
    ours = planner()
    plan = ours.starts(np.array((2.6, -4.8, pi / 2)))[0]
    assert not plan.halt
    walls, bodies, apart = clearance(plan)
    assert walls >= 0.02
    assert bodies >= TEAM.body_radius + 0.02
    assert apart >= 2 * TEAM.body_radius + 0.05
    assert np.abs(plan.angles).max() <= CABLE.joint_limit
    np.testing.assert_allclose(plan.held_poses[-1], (2.6, -4.8, pi / 2), atol=1e-6)
    assert "no shape" in ours.starts(np.array((2.6, -7.8, pi / 2)))[0].halt


def test_the_papers_method_agrees_where_its_problem_is_ours(begun: TowingPlan) -> None:
    """Far from corners the nearest wall is nearly all of the noisy-or; nothing is at a limit."""
    paper = PaperPlanner(CABLE, TEAM, YARD)
    plan = paper.plan(next_inputs(begun))
    assert not plan.halt
    assert plan.constraint < 1e-6
    inputs = PlanInputs(begun.held_poses, WELDER + STEP, 0.1)
    problem = planner().limited_problem(plan.estimate, inputs).problem
    ours = replace(problem, weights=replace(problem.weights, pace=0.0))
    free, _ = optimise_without_limits(ours)
    assert ours.terms(free).paper <= ours.terms(plan.angles).paper + 1e-9
    assert (
        paper.objective(free, plan.estimate, problem.obstacles)[0].paper >= plan.terms.paper - 0.02
    )
    away = plan.angles + bent_angles(np.random.default_rng(2), most=0.05)
    low, here, high = (
        paper.objective(away + d, plan.estimate, problem.obstacles) for d in (-1e-6, 0.0, 1e-6)
    )
    assert (high[1] - low[1]) / 2e-6 == pytest.approx(here[2].sum(), rel=1e-4)


@pytest.mark.parametrize("link", [1, 58])
def test_links_that_need_no_clearance_from_walls_keep_clear_of_discs_and_name_them(
    begun: TowingPlan, link: int
) -> None:
    """All but what is below the welder's body, which has a check of its own."""
    x, y, heading = begun.link_poses[link]
    aside = 0.06 * np.array((-np.sin(heading), np.cos(heading)))
    beside = DiscObstacle(x + aside[0], y + aside[1], 0.05, name="jack")
    inputs = next_inputs(begun)
    limits = planner().limited_problem(begun.angles, replace(inputs, obstacles=[beside]))
    rows = limits.rows(begun.angles)
    row = next(one for one in rows if one["link"] == link and one["kind"] == 0)
    assert row["margin"] == pytest.approx(0.06 - 0.05 - 0.02, abs=2e-6)
    text = limits.describe(row, BROKEN_LIMIT_TEXTS)
    assert f"link {link} would be 10 mm too near to jack" in text


def test_a_plan_within_limits_does_not_depend_on_where_memory_is(begun: TowingPlan) -> None:
    x, y, _ = begun.held_poses[2]
    disc = DiscObstacle(x + 0.3, y + 0.1, 0.2, name="trolley")
    inputs, kept, found = PlanInputs(begun.held_poses, WELDER, 0.1, begun, [disc]), [], set()
    for size in range(16, 272, 16):
        kept.append(bytearray(size))
        found.add(planner().plan(inputs).angles.tobytes())
    assert len(found) == 1


def test_a_way_through_one_obstacle_is_not_free_because_the_cable_is_within_another(
    begun: TowingPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cable leads away from the crate that it is deep in, and not through the post."""
    turned = begun.angles + np.where(np.arange(60) == 10, -0.2, 0.0)
    x, y, _ = begun.link_poses[25]
    crate = DiscObstacle(x, y, 0.3, name="crate")
    x, y, _ = CABLE.poses((begun.angles + turned) / 2)[40]
    post = DiscObstacle(x, y, 0.1, name="post")
    monkeypatch.setattr(CheckedShape, "is_feasible", True)
    for discs, objection in (([crate], ""), ([crate, post], "too near to post")):
        inputs = PlanInputs(begun.held_poses, WELDER, 0.1, begun, discs)
        shape = CheckedShape(planner().limited_problem(begun.angles, inputs), turned)
        found = shape.objection()
        assert objection in found if objection else not found


@pytest.mark.parametrize("digit", range(8))
def test_vehicles_lead_away_from_what_came_quicker_than_they_drive(
    begun: TowingPlan, digit: int
) -> None:
    """It is 60 mm nearer to vehicle 3 than it may be: all that a plan can do is to lead away.

    Where it stands differs by nanometres: no plan may hinge on last digits.
    """
    x, y = begun.held_poses[2, :2] + 1e-9 * digit
    disc = DiscObstacle(x + 0.3, y + 0.1, 0.1, name="trolley")
    before = np.hypot(0.3, 0.1)
    disc = replace(disc, radius=before - TEAM.body_radius - 0.02 + 0.06)
    plan, gaps = begun, [before]
    for _ in range(12):
        plan = planner().plan(PlanInputs(plan.held_poses, WELDER, 0.1, plan, [disc]))
        assert not plan.halt, plan.halt
        gaps.append(float(np.hypot(*(plan.held_poses[2, :2] - (disc.x, disc.y)))))
        if not plan.retreat:
            break
        assert "vehicle 3 would be" in plan.retreat or "too near to trolley" in plan.retreat
        assert clearance(plan)[2] > 2 * TEAM.body_radius + 0.05
    steps = np.diff(gaps)
    assert not plan.retreat
    assert gaps[-1] == pytest.approx(before + 0.06, abs=0.02)
    assert steps.max() <= 0.1 * TEAM.top_speed + 1e-6
    assert steps[:5].min() > 0.5 * 0.1 * TEAM.top_speed


def test_no_vehicle_is_sent_to_a_heading_that_it_cannot_turn_to(begun: TowingPlan) -> None:
    """A trolley drives at vehicle 4, which is to turn out of its way."""
    ours, plan, turns = planner(), begun, []
    for k in range(36):
        x, y = begun.held_poses[3, :2] + (0.45 - 0.015 * k, 0.0)
        disc = DiscObstacle(x, y, 0.15, (-0.15, 0.0), name="trolley")
        found = ours.plan(PlanInputs(plan.held_poses, WELDER, 0.1, plan, [disc]))
        turns.append(np.abs(found.held_poses - plan.held_poses)[:-1, 2].max())
        plan = plan if found.halt else found
    assert max(turns) == pytest.approx(0.1 * TEAM.top_speed / TEAM.body_radius, abs=1e-4)


def test_whole_turns_of_where_vehicles_were_sent_change_nothing(begun: TowingPlan) -> None:
    """A localisation may count headings from 0 to 2π, and vehicles that stopped are sent there."""
    ours, plan, turn, rows = planner(), begun, np.array((0.0, 0.0, 2 * pi)), []
    for k in range(36):
        x, y = begun.held_poses[3, :2] + (0.45 - 0.015 * k, 0.0)
        disc = DiscObstacle(x, y, 0.15, (-0.15, 0.0), name="trolley")
        inputs = PlanInputs(plan.held_poses, WELDER, 0.1, plan, [disc])
        known = ours._plan_shape(inputs, plan)
        row, same = (
            ours._led_astray(*known, sent) for sent in (plan.held_poses, plan.held_poses - turn)
        )
        assert (row is None) == (same is None)
        if row is not None and same is not None:
            assert same[0]["margin"] == pytest.approx(row[0]["margin"], abs=1e-6)
            rows.append(row)
        found = ours.plan(inputs)
        plan = plan if found.halt else found
    assert rows


def test_a_vehicle_that_stands_is_not_led_back(begun: TowingPlan) -> None:
    """It jammed 20 mm short of where it was sent, and others go on."""
    ours, seen = planner(), []
    sent = begun.held_poses + np.array((0.02, 0.0, 0.0)) * (np.arange(6) == 2)[:, None]
    last = replace(begun, held_poses=sent)
    inputs = PlanInputs(begun.held_poses, WELDER, 0.1, last, stopped=(2,))
    limits, now, plan = ours._plan_shape(inputs, last)

    def remember(*given: Any) -> HeldCable:
        seen.append(given[2])
        return HeldCable(*given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tjscan.towing.shape.planner.HeldCable", remember)
        patch.setattr("tjscan.towing.shape.planner.NEAR_LIMIT", 10.0)
        ours._led_astray(limits, now, plan, sent)
    way = np.array(seen)
    np.testing.assert_allclose(way[:, 2], np.tile(plan.held_poses[2], (5, 1)), atol=1e-3)
    np.testing.assert_array_equal(way[3, :, :2], way[2, :, :2])  # stopped, they turn on at first
    np.testing.assert_array_equal(way[4, :, 2], way[3, :, 2])
    assert (way[3, :, 2] != way[2, :, 2]).any()


def test_margins_of_turns_change_as_their_gradients_say(begun: TowingPlan) -> None:
    """Whole turns do not count, and a heading is linear in the angles."""
    ours = planner()
    inputs = PlanInputs(begun.held_poses, WELDER, 0.1, begun)
    limits = ours.limited_problem(begun.angles, inputs)
    began = limits.problem.pace_from + np.array((0.0, 0.0, 2 * pi))
    limits = replace(limits, problem=replace(limits.problem, pace_from=began))
    step = np.random.default_rng(3).normal(0, 2e-4, CABLE.links)
    found = [
        rows[rows["kind"] == LimitKind.TURN]
        for rows in (limits.rows(begun.angles + share * step, 1.0) for share in (1.0, 2.0))
    ]
    assert len(found[0]) == len(HELD) - 1
    changes = margin_gradients(limits, found[0], begun.angles + step) @ step
    np.testing.assert_allclose(found[1]["margin"] - found[0]["margin"], changes, atol=1e-12)
    assert np.abs(changes).max() > 1e-4


def test_weak_vehicles_draw_no_piece_straighter_than_they_could_drag_it(begun: TowingPlan) -> None:
    weak = TowingPlanner(CABLE, replace(TEAM, force=15.0), YARD, planner().settings)
    plan = begun
    for _ in range(40):
        plan = weak.plan(PlanInputs(plan.held_poses, WELDER, 0.1, plan))
    assert not plan.halt
    ends = np.vstack((CABLE.root[:2], plan.held_poses[:, :2]))
    chords = np.hypot(*np.diff(ends, axis=0).T)
    # A rope's tension at its ends: drag a metre, times the square of its length, over 8 sags.
    sags = np.sqrt(3 / 8 * (1.0 - np.minimum(chords, 1.0)))
    pulls = 10 * CABLE.friction / (8 * np.maximum(sags, 1e-9))
    assert pulls.max() <= 0.4 * 15.0 * (1 + 1e-3)
    free = np.hypot(*np.diff(np.vstack((CABLE.root[:2], begun.held_poses[:, :2])), axis=0).T)
    assert free.max() > chords.max()


def test_a_link_comes_no_nearer_to_something_because_a_vehicle_is_nearer_still(
    begun: TowingPlan,
) -> None:
    ours, sent = planner(), begun.held_poses
    led = sent + np.array((0.0, 0.02, 0.0)) * (np.arange(6) == 2)[:, None]
    _, now, _ = ours._plan_shape(PlanInputs(sent, WELDER, 0.1, begun), begun)
    links = CABLE.poses(now.angles)[:, :2]
    after = HeldCable(CABLE, TEAM.held_links, led, ours.settings.trust).estimate(now)
    drawn = CABLE.poses(after.angles)[:, :2]
    free = np.linalg.norm(links[:, None] - sent[:, :2], axis=2).min(axis=1) > 0.35
    link = int((np.linalg.norm(drawn - links, axis=1) * free).argmax())
    side = (drawn - links)[link] / np.linalg.norm((drawn - links)[link])
    x, y = links[link] + side * (0.05 + 0.0305)
    post = DiscObstacle(x, y, 0.05, name="post")
    across = np.array((-np.sin(sent[4, 2]), np.cos(sent[4, 2])))
    x, y = sent[4, :2] + TEAM.body_radius * across
    trolley = DiscObstacle(x, y, 0.05, name="trolley")
    for obstacles in ([post], [post, trolley]):
        inputs = PlanInputs(sent, WELDER, 0.1, begun, obstacles)
        limits, now, plan = ours._plan_shape(inputs, begun)
        astray = ours._led_astray(limits, now, replace(plan, held_poses=led), sent)
        assert astray is not None
        assert "too near to post" in astray[1]
