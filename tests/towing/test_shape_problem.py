"""Derivatives against differences, and what must not depend on where the yard lies."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from towed import (
    NOTCHED,
    PASSER_BY,
    YARD,
    bent_angles,
    objective_gradient,
    objective_hessian,
    obstacle_distances,
    shape_problem,
    turned,
)

from tjscan.core.frames import Array
from tjscan.towing.shape.area import DiscObstacle, Floor, Obstacles
from tjscan.towing.shape.estimate import CablePull
from tjscan.towing.shape.problem import ShapeProblem, one_minus_falling_loss, rising_loss

STEP = 1e-6


def differences(function: object, x: Array) -> Array:
    columns = []
    for i in range(len(x)):
        up, down = x.copy(), x.copy()
        up[i] += STEP
        down[i] -= STEP
        columns.append((function(up) - function(down)) / (2 * STEP))  # type: ignore[operator]
    return np.stack(columns, axis=-1)


@given(st.floats(0, 5), st.floats(0.1, 2))
def test_a_loss_stays_between_its_limits_and_has_the_derivatives_it_gives(
    f: float, target: float
) -> None:
    for loss in (rising_loss, one_minus_falling_loss):
        value, first, second = loss(f, target)
        assert -1e-12 <= value <= 1 + 1e-12
        assert first >= 0
        d = 1e-5 * target
        low, high = loss(f - d, target), loss(f + d, target)
        assert first == pytest.approx((high[0] - low[0]) / (2 * d), abs=1e-6 / target)
        assert second == pytest.approx((high[1] - low[1]) / (2 * d), abs=1e-4 / target**2)


def test_losses_reach_their_limits_and_turn_at_the_target() -> None:
    assert rising_loss(0.0, 0.6)[0] == pytest.approx(0, abs=1e-15)
    assert rising_loss(60.0, 0.6)[0] == pytest.approx(1, abs=1e-12)
    assert one_minus_falling_loss(-30.0, 0.3)[0] == pytest.approx(0, abs=1e-12)
    assert one_minus_falling_loss(30.0, 0.3)[0] == pytest.approx(1, abs=1e-12)
    assert rising_loss(0.6, 0.6)[2] == pytest.approx(0, abs=1e-12)
    assert one_minus_falling_loss(0.3, 0.3)[2] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_and_hessian_are_those_of_the_objective(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = shape_problem(rng)
    angles = problem.estimate + bent_angles(rng, most=0.1)
    total = differences(lambda x: np.array(problem.terms(x).total), angles)
    np.testing.assert_allclose(
        objective_gradient(problem, angles), total, atol=1e-6 * np.abs(total).max()
    )
    hessian = objective_hessian(problem, angles)
    by_gradient = differences(lambda x: objective_gradient(problem, x), angles)
    np.testing.assert_allclose(hessian, by_gradient, atol=1e-6 * np.abs(hessian).max())
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-12)


def test_constraints_and_their_curvature_are_those_of_the_poses() -> None:
    problem = shape_problem(np.random.default_rng(3))
    poses = problem.cable.poses(problem.estimate)
    problem = replace(problem, fixed=np.array([19, 59]), fixed_poses=poses[[19, 59]] + 0.1)
    angles = problem.estimate
    c, rows = problem.constraint(angles)
    np.testing.assert_allclose(c, -0.1, atol=1e-12)
    np.testing.assert_allclose(
        rows, differences(lambda x: problem.constraint(x)[0], angles), atol=1e-7
    )
    y = np.array((3.0, -2.0, 5.0, 1.0, 4.0, -1.0))
    curved = objective_hessian(problem, angles, y) - objective_hessian(problem, angles)
    by_rows = differences(lambda x: problem.constraint(x)[1].T @ y, angles)
    np.testing.assert_allclose(curved, by_rows, atol=1e-6 * np.abs(curved).max())


def test_a_whole_turn_more_at_the_welder_is_the_same_pose() -> None:
    problem = shape_problem(np.random.default_rng(3))
    turn = replace(problem, fixed_poses=problem.fixed_poses + np.array((0, 0, 2 * np.pi)))
    for ours, theirs in zip(
        problem.constraint(problem.estimate), turn.constraint(problem.estimate), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


def moved(problem: ShapeProblem, angle: float, shift: Array, area: Floor) -> ShapeProblem:
    """The same problem in a yard that lies elsewhere."""

    def place(points: Array) -> Array:
        return turned(points, angle) + shift

    x, y = place(PASSER_BY_AT)
    vx, vy = turned(np.array(PASSER_BY.velocity), angle)
    disc = DiscObstacle(x, y, PASSER_BY.radius, (vx, vy))
    there = Floor(place(area.outline), [place(pillar) for pillar in area.pillars])
    root = problem.cable.root
    cable = replace(problem.cable, root=(*place(np.array(root[:2])), root[2] + angle))
    return replace(
        problem,
        cable=cable,
        obstacles=Obstacles.of_area(there).with_discs([disc], 1.0),
        pace_from=np.c_[place(problem.pace_from[:, :2]), problem.pace_from[:, 2] + angle],
        pull=pulled_elsewhere(problem, place, lambda points: turned(points, angle)),
    )


def pulled_elsewhere(
    problem: ShapeProblem, place: Callable[[Array], Array], turn: Callable[[Array], Array]
) -> CablePull:
    """The pull at a welder that stands elsewhere."""
    pull = problem.pull
    assert pull is not None
    stiffness = turn(turn(pull.stiffness).T).T
    return replace(pull, force=turn(pull.force), stiffness=stiffness, place=place(pull.place))


PASSER_BY_AT = np.array((PASSER_BY.x, PASSER_BY.y))


@given(st.floats(-3, 3), st.floats(-10, 10), st.integers(0, 100))
def test_the_objective_does_not_care_where_the_yard_lies(
    angle: float, shift: float, seed: int
) -> None:
    problem = shape_problem(np.random.default_rng(seed))
    there = moved(problem, angle, np.array((shift, 1.0)), NOTCHED)
    angles = problem.estimate + 0.01
    assert there.terms(angles).total == pytest.approx(problem.terms(angles).total, rel=1e-9)


@given(st.integers(0, 100))
def test_a_mirror_image_costs_the_same(seed: int) -> None:
    flip = np.array((1.0, -1.0))
    problem = shape_problem(np.random.default_rng(seed), area=YARD)
    here = replace(problem, obstacles=Obstacles.of_area(YARD))
    x, y, heading = here.cable.root
    there = replace(
        here,
        cable=replace(here.cable, root=(x, -y, -heading)),
        estimate=-here.estimate,
        pace_from=here.pace_from * (1.0, -1.0, -1.0),
        pull=pulled_elsewhere(here, lambda points: points * flip, lambda points: points * flip),
    )
    angles = here.estimate + 0.01
    assert there.terms(-angles).total == pytest.approx(here.terms(angles).total, rel=1e-12)
    np.testing.assert_allclose(
        objective_gradient(there, -angles), -objective_gradient(here, angles), atol=1e-9
    )


def test_finer_links_of_a_smooth_cable_approach_one_value() -> None:
    """N→∞ at one length: the obstacle term of a circle becomes an integral."""
    values = []
    for links in (60, 240, 960):
        problem = shape_problem(np.random.default_rng(0), links=60)
        cable = replace(problem.cable, links=links, link_length=6.0 / links, root=(0.0, 0.0, 0.0))
        angles = np.full(links, np.pi / 2 / links)
        problem = replace(problem, cable=cable, estimate=angles)
        values.append(problem.terms(angles).obstacle)
    assert abs(values[2] - values[1]) < 0.3 * abs(values[1] - values[0])


@given(st.floats(-2, 4), st.floats(-6, 6))
def test_distances_are_those_of_shapely_and_their_derivatives_fit(x: float, y: float) -> None:
    import shapely

    obstacles = Obstacles.of_area(NOTCHED).with_discs([PASSER_BY], 1.0)
    point = np.array([(x, y)])
    d, gradient, hessian = obstacle_distances(point, obstacles)
    outline = shapely.Polygon(NOTCHED.outline)
    at = shapely.Point(x, y)
    outside = d[0, :-2].min()
    if outline.contains(at):
        assert outside == pytest.approx(outline.exterior.distance(at), abs=1e-9)
    else:
        assert outside <= 1e-9
    pillar = shapely.Polygon(NOTCHED.pillars[0])
    inside = -pillar.exterior.distance(at) if pillar.contains(at) else pillar.distance(at)
    assert d[0, -2] == pytest.approx(inside, abs=1e-9)
    px, py, (vx, vy) = PASSER_BY.x, PASSER_BY.y, PASSER_BY.velocity
    swept = shapely.LineString([(px, py), (px + vx, py + vy)])
    assert d[0, -1] == pytest.approx(swept.distance(at) - PASSER_BY.radius, abs=1e-9)
    np.testing.assert_allclose(np.hypot(*gradient[0].T), 1, atol=1e-12)
    ahead = obstacle_distances(point + 1e-7 * gradient[0, -1], obstacles)
    assert ahead[0][0, -1] - d[0, -1] == pytest.approx(1e-7, rel=1e-4)
    across = 1e-6 * np.array((-gradient[0, -1, 1], gradient[0, -1, 0]))
    bent = hessian[0, -1, [0, 1, 1, 2]].reshape(2, 2) @ across
    turned_by = obstacle_distances(point + across, obstacles)[1][0, -1] - gradient[0, -1]
    np.testing.assert_allclose(turned_by, bent, atol=1e-8 + 1e-3 * float(np.abs(bent).max()))
