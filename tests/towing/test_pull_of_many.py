"""Many vehicles on a long cable, each of which may only draw the piece before it so straight."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.towing.shape import limited
from tjscan.towing.shape.area import Floor
from tjscan.towing.shape.cable import Cable, TowingTeam, equally_spaced_links
from tjscan.towing.shape.limits import LimitedProblem, LimitKind
from tjscan.towing.shape.planner import TowingPlanner
from tjscan.towing.shape.start import search_shape

LINKS, VEHICLES = 200, 25
FIELD = Floor([(-30, -30), (30, -30), (30, 30), (-30, 30)])


@pytest.fixture(scope="module")
def limits() -> LimitedProblem:
    cable, team = Cable(links=LINKS), TowingTeam(equally_spaced_links(LINKS, VEHICLES), force=25.0)
    x, y, heading = cable.poses(np.full(LINKS, 0.5 / LINKS))[-1]
    return TowingPlanner(cable, team, FIELD).start_problem(
        np.array((0.9 * x, 0.9 * y, heading)), ()
    )


@pytest.fixture(scope="module")
def begun(limits: LimitedProblem) -> Array:
    """From a shape whose pieces are straight but for a thousandth."""
    shape = search_shape(limits, np.full(LINKS, 0.5 / LINKS))
    assert shape is not None
    return shape


def test_pieces_that_begin_nearly_straight_are_given_the_slack_that_pull_demands(
    limits: LimitedProblem, begun: Array
) -> None:
    ends = np.vstack(
        ((0.0, 0.0), limits.problem.cable.poses(begun)[list(limits.team.held_links), :2])
    )
    assert (np.hypot(*np.diff(ends, axis=0).T) <= limits.arrays.longest + 2e-6).all()


def test_a_step_with_many_active_rows_is_that_of_the_dense_solver(
    limits: LimitedProblem, begun: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = limits.problem.fixed_poses + np.array((0.02, 0.01, 0.0))
    moved = replace(limits, problem=replace(limits.problem, fixed_poses=poses))
    dense, fill, asked = limited._solve_program, limited._fill_quadratic_program, list[int]()

    def count(*given: Any) -> Any:
        asked.append(1)
        return dense(*given)

    monkeypatch.setattr(limited, "_solve_program", count)
    found = limited.optimise_within_limits(moved, begun, most=4)
    assert not asked
    assert (found.pressed["kind"] == LimitKind.TAUT).sum() > limited.MOST_ACTIVE_ROUNDS

    def find_nothing(*given: Any) -> Any:
        shift, _, step, z = fill(*given)
        return shift, False, step, z

    monkeypatch.setattr(limited, "_fill_quadratic_program", find_nothing)
    expected = limited.optimise_within_limits(moved, begun, most=4)
    assert len(asked) >= 3
    assert found.angles == pytest.approx(expected.angles, abs=1e-6)
    assert len(found.pressed) == len(expected.pressed)
