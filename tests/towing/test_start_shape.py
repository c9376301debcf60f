"""First shapes: what they keep, and what is found on either side of what stands there."""

import subprocess
import sys

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.towing.shape.area import Floor
from tjscan.towing.shape.cable import Cable, TowingTeam, equally_spaced_links
from tjscan.towing.shape.plan import PlanInputs
from tjscan.towing.shape.planner import TowingPlanner
from tjscan.towing.shape.start import start_shapes

OUTLINE = np.array([(0.0, -5.0), (2.6, -5.0), (2.6, 5.0), (0.0, 5.0)])


def found(planner: TowingPlanner, pose: Array) -> list[Array]:
    """All that `TowingPlanner.starts` chooses from."""
    return start_shapes(planner.start_problem(pose, ()), planner.area, pose)


@pytest.mark.parametrize(("links", "length", "vehicles"), [(100, 0.2, 20), (120, 0.5, 20)])
def test_a_long_cable_has_a_shape_in_a_yard_of_its_size(
    links: int, length: float, vehicles: int
) -> None:
    """20 and 60 m: at the welder's pose, within every limit, from root to tip."""
    scale = links * length / 6
    planner = TowingPlanner(
        Cable(links=links, link_length=length, least_bend_radius=1.33 * length),
        TowingTeam(equally_spaced_links(links, vehicles)),
        Floor(scale * OUTLINE),
    )
    pose = np.array((2.6 * scale, -1.5 * scale, np.pi / 2))

    plan = planner.starts(pose)[0]

    assert not plan.halt
    np.testing.assert_allclose(plan.held_poses[-1], pose, atol=1e-6)
    assert np.abs(plan.angles).max() <= planner.cable.joint_limit
    assert not planner.plan(PlanInputs(plan.held_poses, pose, 0.1, plan)).halt


def test_a_pillar_is_passed_on_either_side() -> None:
    """Two shapes at least, one north and one south of it, and the best one first."""
    pillar = np.array([(1.0, -0.9), (1.2, -0.9), (1.2, -0.7), (1.0, -0.7)])
    planner = TowingPlanner(Cable(), TowingTeam(), Floor(OUTLINE, [pillar]))

    pose = np.array((2.6, 0.0, np.pi / 2))
    shapes = found(planner, pose)

    sides = set()
    for shape in shapes:
        line = planner.cable.line(shape)
        x, y = (line - pillar.mean(axis=0)).T
        sight = np.unwrap(np.arctan2(y, x))
        sides.add(round((sight[-1] - sight[0]) / (2 * np.pi), 1))
    assert len(sides) >= 2
    terms = planner.start_problem(pose, ()).problem.terms
    costs = [terms(shape).total for shape in shapes]
    assert costs == sorted(costs)


def test_the_search_finds_the_same_twice() -> None:
    """To the last bit."""
    planner = TowingPlanner(Cable(), TowingTeam(), Floor(OUTLINE))
    pose = np.array((2.6, 3.0, np.pi / 2))
    first, second = planner.starts(pose)[0], planner.starts(pose)[0]
    np.testing.assert_array_equal(first.angles, second.angles)


def test_no_plan_of_a_tow_waits_for_what_is_compiled() -> None:
    """All that plans call, of all the types that they have, was loaded with the first shapes."""
    program = """
import sys
import numpy as np
from tjscan.towing.shape.area import Floor
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.shape.plan import PlanInputs
from tjscan.towing.shape.planner import TowingPlanner

def known():
    rooms = [m for name, m in sys.modules.items() if name.startswith("tjscan.towing.shape")]
    found = {f for room in rooms for f in vars(room).values() if hasattr(f, "signatures")}
    return sum(len(f.signatures) for f in found)

yard = Floor(np.array(((0, -2), (2, -2), (2, 2), (0, 2)), float))
planner, welder = TowingPlanner(Cable(links=20), TowingTeam((9, 19)), yard), np.array((1.4, 0, 0))
plan = planner.starts(welder)[0]
before = known()
for _ in range(3):
    plan = planner.plan(PlanInputs(plan.held_poses, welder, 0.1, plan))
print(before, known(), plan.halt)
"""
    said = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    assert int(said[0]) > 5
    assert said[0] == said[1]
