"""Plans with the cost of the pull at the welder, which is stiff beside all others."""

from dataclasses import replace

import numpy as np
import pytest
from towed import shape_problem

from tjscan.towing.shape.area import Floor
from tjscan.towing.shape.cable import TowingTeam
from tjscan.towing.shape.limited import optimise_within_limits
from tjscan.towing.shape.limits import LimitedProblem
from tjscan.towing.shape.planner import optimise_without_limits
from tjscan.towing.shape.problem import ShapeProblem
from tjscan.towing.tables import LimitSettings

FIELD = Floor([(-20, -20), (20, -20), (20, 20), (-20, 20)])


def stiff_problem(seed: int) -> ShapeProblem:
    """A problem whose pull is that of a cable a hundred times as stiff."""
    problem = shape_problem(np.random.default_rng(seed), area=FIELD)
    assert problem.pull is not None
    pull = replace(problem.pull, stiffness=100 * problem.pull.stiffness)
    poses = problem.cable.poses(problem.estimate)[-1:] + np.array((1e-3, 0.0, 0.0))
    return replace(problem, pull=pull, fixed_poses=poses)


@pytest.mark.parametrize("seed", range(4))
def test_a_stiff_pull_is_weighed_and_the_welder_still_reached(seed: int) -> None:
    problem = stiff_problem(seed)
    angles, iterations = optimise_without_limits(problem)
    free, _ = optimise_without_limits(replace(problem, pull=None))
    assert iterations < 40
    assert np.abs(problem.constraint(angles)[0]).max() < 1e-6
    assert problem.terms(angles).total < problem.terms(free).total


@pytest.mark.parametrize("seed", range(3))
def test_the_search_with_limits_finds_the_same_shape_where_none_is_near(seed: int) -> None:
    problem = stiff_problem(seed)
    team = TowingTeam((9, 19, 29, 39, 49, 59), 0.01, 10.0)
    limits = LimitedProblem(problem, team, LimitSettings(link_clearance=0.02))
    angles, _ = optimise_without_limits(problem)
    assert limits.rows(angles)["margin"].min(initial=1.0) > 0
    found = optimise_within_limits(limits, problem.estimate)
    assert problem.terms(found.angles).total == pytest.approx(problem.terms(angles).total, rel=1e-5)
