"""The cable's force on the welder, and how it changes as the vehicle before it moves."""

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.estimate import (
    PULL_RELIEF_SPEED,
    CableEstimate,
    CablePull,
    HeldCable,
)
from tjscan.towing.shape.plan import PoseAccuracy

CABLE, HELD, TRUST = Cable(links=20), (9, 19), PoseAccuracy(5e-4, 1e-3)
BENT = np.linspace(0.02, 0.12, 20)
POSES = CABLE.poses(BENT)[list(HELD)]


def tow(way: Array) -> tuple[CableEstimate, Array]:
    """The cable once the welder has gone a way, and the poses then."""
    lies = CableEstimate.without_floor_pull(CABLE, BENT)
    for share in np.linspace(0, 1, 30):
        poses = POSES + share * np.array(((0.0, 0.0, 0.0), (*way, 0.0)))
        lies = HeldCable(CABLE, HELD, poses, TRUST).estimate(lies)
    return lies, poses


def pull(lies: CableEstimate, poses: Array) -> CablePull:
    found = HeldCable(CABLE, HELD, poses, TRUST).pull_on_welder(lies, np.zeros(2))
    assert found is not None
    return found


def test_the_stiffness_is_what_a_step_of_the_vehicle_changes() -> None:
    lies, poses = tow(np.array((-3e-4, 1e-4)))  # no link slides yet
    here = pull(lies, poses)
    for axis in (0, 1):
        forces = []
        for step in (1e-6, -1e-6):
            stepped = poses.copy()
            stepped[0, axis] += step
            there = HeldCable(CABLE, HELD, stepped, TRUST).estimate(lies)
            forces.append(pull(there, stepped).force)
        change = (forces[0] - forces[1]) / 2e-6
        np.testing.assert_allclose(
            here.stiffness[:, axis], change, atol=0.01 * np.abs(here.stiffness).max()
        )


def test_it_pulls_as_the_simulated_cable_does() -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'tjscan[towing]'")
    from tjscan.vehicle.cable.model import CableModel, TowingVehicleModel, TowingWorldModel
    from tjscan.vehicle.cable.world import TowingWorld
    from tjscan.vehicle.vehicle import Twist

    model = TowingWorldModel(
        cable=CableModel(links=20, held=HELD), vehicle=TowingVehicleModel(encoder_noise=0.0)
    )
    world, lies = TowingWorld(model, BENT), CableEstimate.without_floor_pull(CABLE, BENT)
    world.order(0, Twist(0.0, 0.0, 0.0))
    for _ in range(60):
        heading = world.truth().poses[1, 2]
        world.order(1, Twist(-0.01 * np.cos(heading), 0.0, 0.01 * np.sin(heading)))
        world.order(0, Twist(0.0, 0.0, 0.0))
        world.truth()
        world.advance(0.1)
        truth = world.truth()
        lies = HeldCable(CABLE, HELD, truth.poses, TRUST).estimate(lies)
    force = pull(lies, truth.poses).force
    np.testing.assert_allclose(force, truth.forces[1, :2], atol=0.1 * np.abs(force).max())


def test_a_force_costs_its_square_where_it_is_small_and_its_amount_where_it_is_large() -> None:
    def cost(newton: float) -> float:
        soft = CablePull(np.array((newton, 0.0)), np.zeros((2, 2)), 9, np.zeros(2), 0.0)
        return float(soft.cost(1.0, 3.0, 0.1)[3])

    assert cost(0.0) == 0.0
    assert cost(0.2) == pytest.approx((0.2 / 3) ** 2, rel=0.01)
    assert cost(200.0) - cost(100.0) == pytest.approx(2 * 100 / 3, rel=0.01)


def best_step(pull: CablePull, period: float) -> Array:
    """What way of the vehicle costs least."""
    gx, gy, xx, xy, yy = pull.cost(1.0, 3.0, period)[4:]
    return -np.linalg.solve(np.array(((xx, xy), (xy, yy))), np.array((gx, gy)))


def test_where_the_cable_is_stiff_the_force_is_relieved_by_its_share_a_plan() -> None:
    stiffness = 1e5 * np.array(((300.0, 80.0), (50.0, 900.0)))
    stiff = CablePull(np.array((2.0, -4.0)), stiffness, 9, np.zeros(2), 0.0)
    for period, share in ((0.1, 0.5), (0.2, 1.0), (1.0, 1.0)):
        step = best_step(stiff, period)
        np.testing.assert_allclose(stiffness @ step, -share * stiff.force, rtol=0.05)


def test_where_it_is_soft_the_vehicle_still_gives_way_slowly() -> None:
    stiffness = np.array(((30.0, 8.0), (5.0, 90.0)))
    soft = CablePull(np.array((2.0, -4.0)), stiffness, 9, np.zeros(2), 0.0)
    step = best_step(soft, 0.1)
    assert 0.5 * PULL_RELIEF_SPEED * 0.1 < np.hypot(*step) <= PULL_RELIEF_SPEED * 0.1
    assert soft.force @ stiffness @ step < 0


def test_it_gives_way_as_slowly_where_the_force_goes_through_zero() -> None:
    def curvature(newton: float, doubt: float) -> float:
        force, stiffness = np.array((newton, 0.0)), 300.0 * np.eye(2)
        return float(CablePull(force, stiffness, 9, np.zeros(2), doubt).cost(1.0, 3.0, 0.1)[6])

    assert curvature(0.0, 5e-4) > 0.5 * curvature(0.15, 5e-4)
    assert curvature(5.0, 5e-4) == pytest.approx(curvature(5.0, 0.0), rel=0.01)


def test_where_a_pose_is_not_known_no_force_is() -> None:
    lies, poses = tow(np.zeros(2))
    for gone in (0, 1):
        unknown = poses.copy()
        unknown[gone] = np.nan
        assert HeldCable(CABLE, HELD, unknown, TRUST).pull_on_welder(lies, np.zeros(2)) is None
