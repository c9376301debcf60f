"""How simulated vehicles are seen: what the settings and faults say, and no otherwise."""

from math import radians

import numpy as np
import pytest

from tjscan.vehicle.localisation import VehiclePose
from tjscan.vehicle.pose_disturbance import (
    DisturbedPoses,
    LocalisationSimulationSettings,
    PoseFault,
)

EXACT = LocalisationSimulationSettings(position_noise=0.0, heading_noise=0.0)
TRUE = np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.1), (2.0, 0.0, 0.2)))


def given(
    settings: LocalisationSimulationSettings = EXACT,
    *faults: tuple[PoseFault, int | None],
    samples: int = 20,
    wait: float = 0.0,
) -> list[tuple[int, VehiclePose]]:
    """What comes of vehicles that go along y at 1 m/s, until the last sample and a wait later."""
    poses = DisturbedPoses(settings, seed=1)
    poses.faults.update(faults)
    out = []
    for number in range(samples):
        time = number * settings.period
        poses.observe_vehicles(time, TRUE + np.array((0.0, time, 0.0)))
        out += list(poses.poses_arrived_until(time))
    out += list(poses.poses_arrived_until(time + wait))
    return out


def of(vehicle: int, came: list[tuple[int, VehiclePose]]) -> list[VehiclePose]:
    return [pose for which, pose in came if which == vehicle]


def test_without_noise_it_sees_what_is_true() -> None:
    came = given()
    assert len(came) == 60
    for vehicle, pose in came:
        assert (pose.x, pose.y, pose.heading) == (vehicle, pose.time, TRUE[vehicle, 2])


def test_noise_is_as_large_as_told() -> None:
    settings = LocalisationSimulationSettings(position_noise=3e-3, heading_noise=radians(1.0))
    came = given(settings, samples=2000)
    errors = np.array([(p.x - v, p.y - p.time, p.heading - TRUE[v, 2]) for v, p in came])
    np.testing.assert_allclose(errors.std(axis=0), (3e-3, 3e-3, radians(1.0)), rtol=0.05)
    np.testing.assert_allclose(errors.mean(axis=0), 0, atol=3e-4)


def test_a_share_is_lost() -> None:
    settings = LocalisationSimulationSettings(lost=0.2)
    assert len(given(settings, samples=2000)) == pytest.approx(0.8 * 6000, rel=0.03)


def test_a_delay_holds_poses_up_and_loses_none() -> None:
    settings = LocalisationSimulationSettings(delay=0.3)
    assert len(given(settings)) == 3 * (20 - 6)
    assert len(given(settings, wait=0.3)) == 60


def test_faults_are_for_whom_they_are_ordered() -> None:
    for fault in PoseFault:
        came, well = given(EXACT, (fault, 1)), given()
        untouched = {0, 2} if fault is not PoseFault.SWAP else {2}
        for vehicle in untouched:
            assert of(vehicle, came) == of(vehicle, well)
        assert repr(of(1, came)) != repr(of(1, well))


def test_faults_do_what_they_say() -> None:
    assert of(1, given(EXACT, (PoseFault.LOST, None))) == []
    frozen = of(1, given(EXACT, (PoseFault.FROZEN, 1)))
    assert len({(p.x, p.y) for p in frozen}) == 1
    assert len({p.time for p in frozen}) == 20
    assert {round(p.x, 9) for p in of(1, given(EXACT, (PoseFault.JUMP, 1)))} == {1.5}
    assert len(of(1, given(EXACT, (PoseFault.LATE, 1)))) == 20 - 6
    times = [p.time for p in of(1, given(EXACT, (PoseFault.DISORDER, 1)))]
    assert times != sorted(times)
    assert all(np.isnan(p.x) for p in of(1, given(EXACT, (PoseFault.NAN, 1))))
    came = given(EXACT, (PoseFault.SWAP, 1))
    assert {p.x for p in of(1, came)} == {0.0}
    assert {p.x for p in of(0, came)} == {1.0}


def test_it_reads_a_world_in_order_and_drops_what_is_no_pose() -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'tjscan[towing]'")
    from tjscan.vehicle.cable.model import CableModel, PasserBy, TowingWorldModel
    from tjscan.vehicle.cable.world import TowingWorld
    from tjscan.vehicle.drivers import LOCALISATION_DRIVERS, LocalisationInputs
    from tjscan.vehicle.simulated_team import SimulatedLocalisation

    model = TowingWorldModel(
        cable=CableModel(links=10, held=(4, 9)),
        passers_by=(PasserBy(0.2, np.array(((0.0, 2.0), (1.0, 2.0))), speed=0.1),),
    )
    world = TowingWorld(model, np.zeros(10), settle=0.0)
    factory = LOCALISATION_DRIVERS.load("simulated")
    eyes = factory.make(
        LocalisationInputs(vehicles=2, seed=0, world=world, simulation=EXACT), factory.table()
    )
    assert isinstance(eyes, SimulatedLocalisation)
    events: list[str] = []
    eyes.report_events_to(lambda name, sentence: events.append(sentence))
    with eyes:
        assert eyes.read() == (None, None)
        for _ in range(10):
            world.advance(0.01)
        first, second = eyes.read()
        assert first is not None
        assert second is not None
        assert first.time == pytest.approx(0.06)
        assert (first.x, second.x) == pytest.approx((0.5, 1.0), abs=1e-4)
        assert eyes.read() == (None, None)
        assert eyes.read_passers_by()[0].x == pytest.approx(0.01)
        eyes.poses.faults.add((PoseFault.NAN, 0))
        for _ in range(10):
            world.advance(0.01)
        assert [pose is None for pose in eyes.read()] == [True, False]
        assert "NaN" in events[0]
        eyes.poses.faults = {(PoseFault.DISORDER, None)}
        times = [second.time]
        for _ in range(100):
            world.advance(0.01)
            pose = eyes.read()[1]
            if pose is not None:
                times.append(pose.time)
        assert times == sorted(set(times))
        assert eyes.dropped > 4
