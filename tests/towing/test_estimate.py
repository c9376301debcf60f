"""Where the cable lies between its vehicles, with a floor that holds it."""

import numpy as np
import pytest
from towed import bent_angles

from tjscan.core.frames import Array
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import (
    chain_gradient,
    chain_hessian,
    new_chain_derivatives,
    place_links,
)
from tjscan.towing.shape.compiled import Indices
from tjscan.towing.shape.estimate import (
    LEAST_ANGLE_DEVIATION,
    PRESLIDING_DISPLACEMENT,
    CableEstimate,
    EstimateArrays,
    HeldCable,
    cable_energy,
)
from tjscan.towing.shape.plan import PoseAccuracy

CABLE, HELD, TRUST = Cable(links=20), (9, 19), PoseAccuracy()


def energy(angles: Array, held: Indices, poses: Array, rest: Array) -> tuple[float, Array, Array]:
    """Of the estimate's problem, with gradient and Hessian."""
    n = len(angles)
    stiff = np.tile((1e4, 1e3), (len(held), 1))
    problem = EstimateArrays(np.zeros(3), 0.1, held, poses, stiff, rest, np.full(n, 0.5), 0.1)
    links, parts = np.empty((n, 5)), new_chain_derivatives(n)
    place_links(angles, problem.root, 0.1, links)
    value = cable_energy(angles, problem, links, parts)
    gradient, hessian = np.empty(n), np.empty((n, n))
    chain_gradient(parts, links, 0.1, gradient)
    chain_hessian(parts, links, 0.1, hessian)
    return value, gradient, hessian


@pytest.mark.parametrize(
    "off", [0.3 * PRESLIDING_DISPLACEMENT, 3 * PRESLIDING_DISPLACEMENT], ids=["held", "sliding"]
)
def test_derivatives_are_those_of_differences(off: float) -> None:
    rng = np.random.default_rng(1)
    angles = bent_angles(rng, 20)
    held = np.array(HELD)
    poses = CABLE.poses(angles)
    rest = poses[:, :2] + off * np.array((0.6, -0.8))
    poses = poses[held] + 1e-3
    _, gradient, hessian = energy(angles, held, poses, rest)
    for direction in rng.normal(size=(3, 20)):
        way = 1e-6 * direction / np.abs(direction).max()
        ahead, behind = (energy(angles + s * way, held, poses, rest) for s in (1, -1))
        assert (ahead[0] - behind[0]) / 2 == pytest.approx(gradient @ way, rel=1e-5)
        np.testing.assert_allclose(
            (ahead[1] - behind[1]) / 2, hessian @ way, rtol=1e-3, atol=1e-4 * np.abs(way).max()
        )


def tow(estimate: CableEstimate, poses: Array, way: Array, steps: int) -> CableEstimate:
    for k in range(steps):
        estimate = HeldCable(CABLE, HELD, poses + (k + 1) / steps * way, TRUST).estimate(estimate)
    return estimate


def test_a_cable_that_was_towed_there_and_back_lies_otherwise_and_then_stays() -> None:
    angles = bent_angles(np.random.default_rng(2), 20)
    begun = CableEstimate.without_floor_pull(CABLE, angles)
    poses, way = CABLE.poses(angles)[list(HELD)], np.array(((0.0, 0.0, 0.0), (-0.03, 0.02, 0.0)))
    begun = tow(begun, poses, 0 * way, 20)
    back = tow(tow(begun, poses, way, 30), poses + way, -way, 30)
    assert np.abs(back.angles - begun.angles).max() > 0.01
    stays = tow(back, poses, 0 * way, 100)
    np.testing.assert_allclose(stays.angles, back.angles, atol=1e-4)


def test_how_fast_it_was_towed_says_nothing() -> None:
    angles = bent_angles(np.random.default_rng(3), 20)
    begun = CableEstimate.without_floor_pull(CABLE, angles)
    poses, way = CABLE.poses(angles)[list(HELD)], np.array(((0.0, 0.0, 0.0), (-0.02, 0.04, 0.1)))
    quick, slow = (tow(begun, poses, way, steps) for steps in (40, 400))
    np.testing.assert_allclose(quick.angles, slow.angles, atol=3e-3)


def test_it_lies_where_the_simulated_cable_does() -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'tjscan[towing]'")
    from tjscan.vehicle.cable.model import CableModel, TowingVehicleModel, TowingWorldModel
    from tjscan.vehicle.cable.world import TowingWorld
    from tjscan.vehicle.vehicle import Twist

    model = TowingWorldModel(
        cable=CableModel(links=20, held=HELD), vehicle=TowingVehicleModel(encoder_noise=0.0)
    )
    begun = np.linspace(0.02, 0.12, 20)
    world, estimate = TowingWorld(model, begun), CableEstimate.without_floor_pull(CABLE, begun)
    frictionless = estimate
    # The second vehicle goes sideways to and fro beside the first one, which stands.
    for k in range(160):
        heading, side = world.truth().poses[1, 2], -1.0 if k < 100 else 1.0
        speed = 0.02 * side
        world.order(0, Twist(0.0, 0.0, 0.0))
        world.order(1, Twist(speed * np.cos(heading), 0.0, -speed * np.sin(heading)))
        world.advance(0.1)
        poses = world.truth().poses
        estimate = HeldCable(CABLE, HELD, poses, TRUST).estimate(estimate)
        frictionless = HeldCable(FREE, HELD, poses, TRUST).estimate(frictionless)
    off = np.abs(estimate.angles - world.truth().angles)
    assert off.mean() < np.radians(0.5)
    assert off.mean() < 0.3 * np.abs(frictionless.angles - world.truth().angles).mean()


def test_a_cable_that_is_pushed_together_lies_where_its_energy_is_least() -> None:
    trust = PoseAccuracy(5e-4, 1e-3)
    lies = CableEstimate.without_floor_pull(CABLE, np.full(20, 1e-3))
    poses = CABLE.poses(lies.angles)[list(HELD)]
    for _ in range(20):
        poses[1, 0] -= 1e-3
        before, lies = lies, HeldCable(CABLE, HELD, poses, trust).estimate(lies)
        begun = CableEstimate(lies.angles, before.rest)
        again = HeldCable(CABLE, HELD, poses, trust).estimate(begun)
        np.testing.assert_allclose(again.angles, lies.angles, atol=1e-4)


FREE = Cable(links=20, friction=0.0)
BENT_POSES = np.array(((0.9, 0.25, 0.2), (1.55, 0.75, 1.2)))
"""Of vehicles between which the cable is slack."""


def free_shape(poses: Array, trust: PoseAccuracy) -> CableEstimate:
    """Of a cable without friction, from the shape between poses that are hardly known on."""
    lies = CableEstimate.without_floor_pull(FREE, np.zeros(20))
    for known in (PoseAccuracy(2e-3, 0.01), trust):
        lies = HeldCable(FREE, HELD, poses, known).estimate(lies)
    return lies


def test_deviations_of_angles_are_those_of_estimates_from_scattered_poses() -> None:
    """Without friction, whose doubt no scatter shows."""
    trust, rng = PoseAccuracy(2e-3, 0.01), np.random.default_rng(4)
    mean = free_shape(BENT_POSES, trust)
    noise = rng.normal(size=(200, 2, 3)) * (2e-3, 2e-3, 0.01)
    scattered = [
        HeldCable(FREE, HELD, BENT_POSES + one, trust).estimate(mean).angles for one in noise
    ]
    stated = HeldCable(FREE, HELD, BENT_POSES, trust).angle_deviations(mean)
    stated = np.sqrt(stated**2 - LEAST_ANGLE_DEVIATION**2)
    np.testing.assert_allclose(stated, np.std(scattered, axis=0), rtol=0.25)
    halves = np.tile((1e-3, 0.005), (2, 1))
    filtered = HeldCable(FREE, HELD, BENT_POSES, trust).angle_deviations(mean, halves)
    np.testing.assert_allclose(
        np.sqrt(filtered**2 - LEAST_ANGLE_DEVIATION**2), stated / 2, rtol=1e-6
    )


def test_the_force_on_a_vehicle_is_the_slope_of_the_cables_energy() -> None:
    trust = PoseAccuracy(1e-4, 1e-3)

    def bending_energy(x: float, y: float) -> float:
        poses = BENT_POSES + np.array(((0.0, 0.0, 0.0), (x, y, 0.0)))
        angles = free_shape(poses, trust).angles
        return float(FREE.bending_stiffness * angles @ angles / 2)

    lies = free_shape(BENT_POSES, trust)
    forces, tension = HeldCable(FREE, HELD, BENT_POSES, trust).forces(lies)
    step = 1e-3
    slope = [
        (bending_energy(step * x, step * y) - bending_energy(-step * x, -step * y)) / (2 * step)
        for x, y in ((1, 0), (0, 1))
    ]
    np.testing.assert_allclose(forces[1], -np.array(slope), rtol=0.05, atol=0.05)
    heading = FREE.headings(lies.angles)[-1]
    along = np.array((np.cos(heading), np.sin(heading)))
    assert tension[-1] == pytest.approx(-forces[1] @ along, rel=1e-3, abs=1e-3)
