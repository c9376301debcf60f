"""Laws of the simulated cable and of the vehicles that hold it; another make than the planner."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, solve_bvp

pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'tjscan[towing]'")

from tjscan.core.frames import Array
from tjscan.vehicle.cable.model import (
    CableModel,
    PasserBy,
    TowingVehicleModel,
    TowingWorldModel,
)
from tjscan.vehicle.cable.plant import CablePlant
from tjscan.vehicle.cable.world import TowingWorld
from tjscan.vehicle.pad_plant import GRAVITY_M_S2
from tjscan.vehicle.vehicle import Twist

QUIET = TowingVehicleModel(encoder_noise=0.0)
SHORT = CableModel(links=20, held=(9, 19))
SLIPPERY = CableModel(links=20, held=(19,), friction=0.0)


def world(cable: CableModel, angles: Array | float = 0.0, **more: object) -> TowingWorld:
    settle = more.pop("settle", 0.0)
    step = more.pop("step", 0.005)
    return TowingWorld(
        TowingWorldModel(cable=cable, vehicle=QUIET, **more),  # type: ignore[arg-type]
        np.full(cable.links, angles),
        settle=settle,  # type: ignore[arg-type]
        step=step,  # type: ignore[arg-type]
    )


def drive(driven: TowingWorld, twists: list[Twist | None], seconds: float) -> None:
    for which, twist in enumerate(twists):
        driven.order(which, twist)
    driven.advance(seconds)


def test_what_lies_straight_stays_where_it_lies() -> None:
    lying = world(SHORT)
    before = lying.truth().points
    lying.advance(5.0)
    # It sinks into the floor by 0.8 mm between those that hold it, and so grows shorter.
    assert np.abs(lying.truth().points - before).max() < 2e-5


def test_a_bent_cable_is_held_by_friction() -> None:
    lying = world(SHORT, 0.05, settle=2.0)
    before = lying.truth().points
    lying.advance(5.0)
    creep = np.abs(lying.truth().points - before).max() / 5.0
    assert creep < 5e-5  # m/s: see docs/vehicles.md


def test_a_cable_dragged_straight_pulls_with_its_weight_times_friction() -> None:
    cable = CableModel(links=20, held=(19,), root=None)
    dragging = world(cable)
    drive(dragging, [Twist(0.01, 0.0)], 2.0)
    dragging.truth()
    dragging.advance(1.0)
    # The vehicle carries the link that it holds.
    expected = cable.friction * cable.link_mass * GRAVITY_M_S2 * (cable.links - 1)
    fx, fy, moment = dragging.truth().forces[0]
    assert fx == pytest.approx(-expected, rel=0.03)
    assert (fy, moment) == pytest.approx((0, 0), abs=1e-3)


def elastica_end_load(cable: CableModel, tip: Array, guessed: Array) -> Array:
    """Force and moment with which a rod, clamped at both ends, pushes what holds its tip.

    EI φ'' = Fx sin φ − Fy cos φ, solved as a boundary value problem. The joint of a chain stands
    for the half links at its sides, so the rod is shifted back by half a link.
    """
    length, stiffness = cable.links * cable.link_length, cable.stiffness * cable.link_length
    half = cable.link_length / 2

    def slope(s: Array, y: Array, p: Array) -> Array:
        _, _, phi, curvature = y
        bend = (p[0] * np.sin(phi) - p[1] * np.cos(phi)) / stiffness
        return np.vstack((np.cos(phi), np.sin(phi), curvature, bend))

    end = np.array((tip[0] - half * np.cos(tip[2]), tip[1] - half * np.sin(tip[2]), tip[2]))

    def ends(a: Array, b: Array, p: Array) -> Array:
        return np.array((a[0] + half, a[1], a[2], *(b[:3] - end)))

    # Where to begin: the headings of the chain choose one of the shapes that a rod may have.
    s = np.linspace(0, length, cable.links)
    guess = np.zeros((4, cable.links))
    guess[2], guess[3] = guessed, np.gradient(guessed, s)
    guess[0], guess[1] = cumulative_simpson(
        np.array((np.cos(guessed), np.sin(guessed))), x=s, initial=0
    )
    solved = solve_bvp(slope, ends, s, guess, p=np.zeros(2), tol=1e-8)
    assert solved.success
    assert solved.p is not None
    (fx, fy), curvature = solved.p, solved.y[3, -1]
    # The rod pushes back; its moment acts half a link behind the tip.
    moment = stiffness * curvature - half * (np.cos(tip[2]) * fy - np.sin(tip[2]) * fx)
    return -np.array((fx, fy, moment))


@pytest.mark.parametrize(
    ("tip", "angles"),
    [((1.8, 0.6, 0.9), 0.045), ((1.2, 1.2, 1.6), 0.08)],
)
def test_a_bent_rod_pushes_as_the_elastica_does(
    tip: tuple[float, float, float], angles: float
) -> None:
    cable = SLIPPERY
    bent = world(cable, angles)
    towards = np.array(tip)
    for _ in range(700):
        pose = bent.plant.poses[0]
        w = 2.0 * (towards - pose)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        drive(bent, [Twist(c * w[0] + s * w[1], w[2], c * w[1] - s * w[0])], 0.01)
    bent.truth()
    bent.advance(1.0)
    truth = bent.truth()
    expected = elastica_end_load(cable, truth.poses[0], bent.plant.headings)
    np.testing.assert_allclose(truth.poses[0], tip, atol=1e-3)
    np.testing.assert_allclose(truth.forces[0], expected, atol=0.04 * np.abs(expected).max())


def test_energy_does_not_grow() -> None:
    plant = CablePlant(TowingWorldModel(cable=SHORT, vehicle=QUIET), np.full(20, 0.1))
    energies = []
    for _ in range(600):
        plant.advance(np.zeros((2, 3)))
        energies.append(plant.energy)
    drops = -np.diff(energies)
    assert drops.min() > -1e-5 * energies[0]
    assert energies[0] - energies[-1] > 0.2 * (20 * 1.7 * 0.1**2 / 2)  # of what the bends held


def test_the_motion_converges_with_the_step() -> None:
    def end(step: float) -> tuple[Array, Array]:
        towed = world(SHORT, 0.05, step=step)
        drive(towed, [Twist(0.02, 0.0, 0.01), Twist(0.03, 0.05, 0.0)], 1.5)
        towed.truth()
        towed.advance(0.5)
        truth = towed.truth()
        return truth.points, truth.forces

    finest, forces = end(0.00125)
    errors = [np.abs(end(step)[0] - finest).max() for step in (0.01, 0.005, 0.0025)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[1] < 1e-3
    assert np.abs(end(0.005)[1] - forces).max() < 0.05 * np.abs(forces).max()


def test_a_mirrored_world_moves_as_the_mirror_shows() -> None:
    ends = []
    for side in (1, -1):
        towed = world(SHORT, side * 0.06)
        drive(towed, [Twist(0.02, 0.0, side * 0.02), Twist(0.0, side * 0.1, side * 0.02)], 3.0)
        truth = towed.truth()
        ends.append((truth.points * (1, side), truth.forces * (1, side, side)))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-6)
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-2)


def test_the_same_orders_give_the_same_motion() -> None:
    ends = []
    for _ in range(2):
        towed = world(SHORT, 0.05)
        drive(towed, [Twist(0.02, 0.0), Twist(0.0, 0.1, 0.02)], 2.0)
        ends.append(towed.truth().points)
    assert np.array_equal(ends[0], ends[1])


def test_vehicles_drive_as_told() -> None:
    cable = CableModel(links=20, held=(19,), root=None, friction=0.0)
    driven = world(cable)
    start = driven.truth().poses[0]
    drive(driven, [Twist(0.1, 0.0, -0.05)], 1.0)
    before = driven.truth().poses[0]
    driven.advance(1.0)
    np.testing.assert_allclose(driven.truth().poses[0] - before, (0.1, -0.05, 0), atol=5e-3)
    assert driven.state(0).odometry.speed == pytest.approx(0.1, abs=5e-3)
    drive(driven, [None], 1.0)
    assert driven.is_at_rest(0)
    assert start[2] == 0.0


def test_wheels_spin_where_the_cable_holds_more_than_their_grip() -> None:
    taut = world(SHORT)
    start = taut.truth().poses
    drive(taut, [Twist(0.0, 0.0), Twist(0.1, 0.0)], 3.0)
    truth = taut.truth()
    model = taut.model.vehicle
    assert truth.drive_forces[1] == pytest.approx(model.grip * model.mass * GRAVITY_M_S2)
    assert np.abs(truth.poses - start).max() < 0.02
    assert taut.state(1).odometry.speed == pytest.approx(0.1, rel=0.01)


def test_a_push_moves_the_vehicle_unseen_by_its_wheels() -> None:
    pushed = world(SHORT, 0.05)
    start = pushed.truth().poses[1]
    towards = pushed.truth().poses[0, :2] - start[:2]
    pushed.push(1, *(0.2 * towards / np.hypot(*towards)).tolist())
    speeds = []
    for _ in range(100):
        pushed.advance(0.01)
        speeds.append(pushed.state(1).odometry)
    moved = pushed.truth().poses[1] - start
    assert 0.15 < np.hypot(*moved[:2]) <= 0.205
    assert sum(abs(s.speed) + abs(s.sideways) for s in speeds) * 0.01 < 0.05


def test_a_jammed_vehicle_stays_and_says_so() -> None:
    jammed = world(SHORT, 0.05)
    jammed.set_jammed(0, True)
    start = jammed.truth().poses
    drive(jammed, [Twist(0.02, 0.0), Twist(0.02, 0.0)], 1.0)
    moved = np.abs(jammed.truth().poses - start)
    assert moved[0].max() < 2e-3 < moved[1].max()
    assert jammed.state(0).fault
    assert not jammed.state(1).fault


def test_walls_stop_vehicles_and_links_and_are_told() -> None:
    outline = np.array(((-1.0, -1.0), (3.0, -1.0), (3.0, 0.4), (-1.0, 0.4)))
    walled = world(SHORT, walls=(outline,))
    drive(walled, [Twist(0.0, 0.0, 0.2), None], 3.0)
    truth = walled.truth()
    assert any("wall 3" in touch for touch in truth.touches)
    assert truth.poses[0, 1] < 0.4 - 0.15 + 0.01
    drive(walled, [Twist(0.0, 0.0, -0.2), None], 1.0)
    walled.truth()
    walled.advance(0.1)
    assert walled.truth().touches == ()


def test_a_passer_by_walks_stands_and_is_told_when_it_touches() -> None:
    passer_by = PasserBy(0.1, np.array(((1.0, 1.0), (1.0, 0.05))), speed=0.5)
    passed = world(SHORT, passers_by=(passer_by,))
    passed.advance(1.0)
    truth = passed.truth()
    np.testing.assert_allclose(truth.passers_by[0], (1.0, 0.5, 0.1, 0.0, -0.5), atol=0.01)
    assert truth.touches == ()
    passed.hold_passer_by(0, True)
    passed.advance(1.0)
    np.testing.assert_allclose(passed.truth().passers_by[0], (1.0, 0.5, 0.1, 0, 0), atol=0.01)
    passed.hold_passer_by(0, False)
    passed.advance(1.0)
    touches = passed.truth().touches
    assert touches
    assert all("passer-by 1" in touch for touch in touches)
    passed.advance(1.0)
    assert passed.passers_by[0, 1] > 0.05  # it stands where it met the cable
    np.testing.assert_array_equal(passed.passers_by[0, 3:], 0.0)


def test_a_passer_by_that_touches_the_cable_may_walk_away_from_it() -> None:
    back_and_forth = np.array(((1.0, 0.5), (1.0, 0.1), (1.0, 0.5)))
    passed = world(SHORT, passers_by=(PasserBy(0.1, back_and_forth, speed=0.5),))
    passed.advance(0.85)
    assert passed.truth().touches
    passed.advance(0.5)
    assert passed.passers_by[0, 1] > 0.2


@pytest.mark.parametrize(
    "wrong",
    [
        {"link_length": 0.0},
        {"stiffness": -1.0},
        {"held": (59, 9)},
        {"held": ()},
        {"held": (9, 19)},
        {"friction": float("nan")},
    ],
)
def test_a_cable_that_can_not_be_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"cable|vehicles|welder"):
        CableModel(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(4))
def test_no_driving_breaks_it(seed: int) -> None:
    """Rough driving, pushes, jams, walls and a passer-by: all stays finite and in one piece."""
    random = np.random.default_rng(seed)
    cable = CableModel(links=18, held=(5, 11, 17))
    outline = np.array(((-0.3, -1.0), (1.6, -1.0), (1.6, 1.0), (-0.3, 1.0)))
    passer_by = PasserBy(0.2, random.uniform(-1, 2, (3, 2)), speed=0.3)
    rough = world(cable, random.normal(0.1, 0.1, 18), walls=(outline,), passers_by=(passer_by,))
    for _ in range(10):
        for which in range(3):
            rough.order(which, Twist(*random.uniform(-0.3, 0.3, 3)))
        rough.push(int(random.integers(3)), *random.uniform(-0.2, 0.2, 2).tolist())
        if random.random() < 0.1:
            rough.set_jammed(int(random.integers(3)), True)
        rough.advance(0.3)
    truth = rough.truth()
    np.testing.assert_allclose(truth.points[[6, 12, 18]], truth.poses[:, :2], atol=1e-6)
    lengths = np.hypot(*np.diff(truth.points, axis=0).T)
    assert (lengths < cable.link_length + 5e-3).all()
    assert rough.plant.points[:, 2].max() < 0.1
    assert np.abs(truth.forces).max() < 1e3
