"""How hard the cable pulls at a vehicle: as the wheels push, where drives report that."""

import numpy as np
from kinematic_team import RowPlanner

from tjscan.core.frames import Array
from tjscan.towing.grip import FORCE_WINDOW, PUSHED_PERIODS, SURE_PERIODS, GripWatch


def watch_pushes(pushes: Array) -> GripWatch:
    plan = RowPlanner(33, 1.0, 3, lambda tip: "").start(np.array((3.0, 0.0, 0.0)))
    watch = GripWatch(3, 20.0)
    for _ in range(FORCE_WINDOW + SURE_PERIODS):
        watch.update(plan, pushes)
        pull = watch.count_hard_pull()
    assert (pull is not None) == bool(np.hypot(*pushes.T).max() > 16.0)
    return watch


def test_a_vehicle_that_has_to_push_hard_is_noticed_and_gives_way_to_the_cable() -> None:
    hard = watch_pushes(np.array(((0.0, 0.0), (17.0, 0.0), (1.0, 0.0))))
    np.testing.assert_allclose(hard.forces[1], (-17.0, 0.0))
    np.testing.assert_allclose(hard.give_way(), ((0, 0), (-0.014, 0), (0, 0)), atol=1e-9)


def test_wheels_that_push_hard_for_three_periods_are_noticed_and_a_jerk_is_not() -> None:
    plan = RowPlanner(33, 1.0, 3, lambda tip: "").start(np.array((3.0, 0.0, 0.0)))
    watch, calm = GripWatch(3, 20.0), np.zeros((3, 2))
    hard = np.array(((0.0, 0.0), (0.0, 0.0), (0.0, -18.0)))
    found = []
    for pushes in (*[calm] * 5, hard, calm, *[hard] * PUSHED_PERIODS):
        watch.update(plan, pushes)
        found.append(watch.count_hard_pull())
    assert found[-1] == (18.0, 2)
    assert set(found[:-1]) == {None}


def test_one_that_pushes_little_is_left_alone() -> None:
    assert not watch_pushes(np.array(((5.0, 0.0), (0.0, 9.0), (1.0, 0.0)))).give_way().any()


def test_without_reports_and_without_an_estimate_nothing_is_known() -> None:
    assert not watch_pushes(np.full((3, 2), np.nan)).forces.any()
