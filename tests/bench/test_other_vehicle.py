"""The bench's vehicle of another make against closed forms, and against the product's pads."""

from math import cos, pi, radians, sin

import numpy as np
import pytest
from _other_vehicle import (
    GAUGE,
    GRIP,
    HALF_WIDTH,
    NAME,
    PADS,
    PITCH,
    STATE_SECONDS,
    Fault,
    Hull,
    OtherLaser,
    OtherVehicle,
    OtherWorld,
    PadTracks,
)

from tjscan.crawler.joint_tracking.memory import RememberingTracker
from tjscan.job.crawl.job import TORCH_DRIVERS
from tjscan.laser.drivers import LASER_DRIVERS
from tjscan.vehicle.drivers import VEHICLE_DRIVERS
from tjscan.vehicle.pad_plant import PadPlant, PadSettings
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist

AT_START = (0.0, 0.0, 0.0)


def test_pads_hold_the_weight_while_both_chains_run_alike() -> None:
    assert PadTracks(0.3).motion(0.01, 0.01, pi / 2, 0.0).tolist() == [0.01, 0.0, 0.0]


@pytest.mark.parametrize("down", [0.0, 0.7, pi / 2, pi, -2.0])
@pytest.mark.parametrize("difference", [1e-9, 1e-3, -1e-3])
def test_friction_weight_and_moments_balance(down: float, difference: float) -> None:
    friction, mean = 0.3, 0.01
    left, right = mean + difference / 2, mean - difference / 2
    u, v, w = PadTracks(friction).motion(left, right, down, 0.3)
    # Added up pad by pad, apart from the solver.
    force = np.array((981 * cos(down), 981 * sin(down), 0.03 * 981 * sin(down)))
    places = [PITCH * (k + 0.2) - PADS * PITCH / 2 for k in range(PADS)]
    squares = 2 * sum(x**2 for x in places), 2 * PADS * (GAUGE / 2) ** 2
    for y, belt in ((-GAUGE / 2, left), (GAUGE / 2, right)):
        for x in places:
            slide = np.array((u - w * y - belt, v + w * x))
            peel = 0.15 * 981 * (cos(down) * x / squares[0] + sin(down) * y / squares[1])
            fx, fy = -friction * (GRIP + peel) * slide / np.hypot(*slide)
            force += (fx, fy, x * fy - y * fx)
    assert np.abs(force).max() < 1e-3  # N and N m, of 981


def test_a_turn_agrees_with_the_pads_of_the_product_if_those_hardly_give_way() -> None:
    turning, mean = 2e-4, 0.01
    own = PadTracks(0.3).motion(mean + turning / 2, mean - turning / 2, pi / 2, 0.0)
    settings = PadSettings(friction=0.3, shear=1e-5, down=pi / 2, mass_height=0.0)
    plant = PadPlant(settings, TrackGeometry(gauge=GAUGE), np.zeros(3))
    for _ in range(50):
        plant.advance(mean + turning / 2, mean - turning / 2, 0.02)
    before = plant.pose_w[2]
    for _ in range(25):
        plant.advance(mean + turning / 2, mean - turning / 2, 0.02)
    assert (plant.pose_w[2] - before) / 0.5 == pytest.approx(own[2], rel=0.02)


def test_ripple_has_no_mean_and_its_amplitude() -> None:
    world = OtherWorld(Hull(ripple=0.005, lost=(0.0, 0.0)), AT_START, 1)
    shares = []
    for way in np.linspace(0, PITCH, 500, endpoint=False):
        world.way = np.array((way, way))
        shares.append(world._chain_shares())
    assert np.mean(shares, axis=0) == pytest.approx(1.0, abs=1e-5)
    assert np.ptp(shares, axis=0) == pytest.approx(0.01, rel=0.01)


@pytest.mark.parametrize("aside", [-0.008, 0.0, 0.002])
@pytest.mark.parametrize("heading", [0.0, 0.03])
def test_the_product_reads_the_joint_where_it_truly_is(aside: float, heading: float) -> None:
    world = OtherWorld(Hull(arc=0.0), (-0.8, aside, heading), 3)
    with OtherLaser(world) as laser:
        tracker = RememberingTracker()
        centres = [tracker.read(laser.capture(), 0.0).centre for _ in range(20)]
    across = aside + 0.5 * sin(heading)
    assert np.mean(centres) == pytest.approx(-across / cos(heading), abs=0.03e-3)


def test_a_profile_shows_hull_edges_and_root() -> None:
    profile = OtherWorld(Hull(), (-2.0, 0.0, 0.0), 1).profile()
    hull = np.abs(profile.x_s) > HALF_WIDTH + 1e-3
    sides = [profile.z_s[hull & (profile.x_s * side > 0)].mean() for side in (-1, 1)]
    assert sides[0] - sides[1] == pytest.approx(1e-3, abs=0.05e-3)  # high-low
    assert profile.z_s.max() - np.mean(sides) == pytest.approx(0.0205, abs=0.2e-3)  # on the left


def test_states_come_and_orders_act_one_late() -> None:
    world = OtherWorld(Hull(), AT_START, 1)
    with OtherVehicle(world) as vehicle:
        vehicle.command(Twist(0.01, 0.0))
        first = [vehicle.next_state() for _ in range(4)]
        assert [state.odometry.speed > 0 for state in first] == [False, False, True, True]
        assert first[3].time - first[2].time == pytest.approx(STATE_SECONDS)
        vehicle.stop()
        for _ in range(10):
            vehicle.next_state()
    assert not world.speeds.any()


@pytest.mark.parametrize(
    ("fault", "speed", "turn_rate"),
    [
        (Fault("dead", side=1), 0.5, 1 / GAUGE),
        (Fault("scaled", 0.8, side=0), 0.9, -0.2 / GAUGE),
    ],
)
def test_an_encoder_that_lies(fault: Fault, speed: float, turn_rate: float) -> None:
    world = OtherWorld(Hull(), AT_START, 1)
    with OtherVehicle(world) as vehicle:
        for _ in range(100):
            vehicle.command(Twist(0.02, 0.0))
            vehicle.next_state()
        world.break_now(fault)
        vehicle.next_state()
        odometry = vehicle.next_state().odometry
    assert odometry.speed / 0.02 == pytest.approx(speed, abs=0.01)
    assert odometry.turn_rate / 0.02 == pytest.approx(turn_rate, abs=0.02)


def test_a_frozen_laser_repeats_its_picture_but_for_a_micron() -> None:
    world = OtherWorld(Hull(), AT_START, 1)
    with OtherLaser(world) as laser:
        last = laser.capture()
        world.break_now(Fault("frozen"))
        world.pose = np.array((0.05, 0.004, radians(1)))
        off = laser.capture().z_s - last.z_s
    assert 0 < np.abs(off).max() < 6e-6


def test_a_knock_moves_the_vehicle_square_to_its_heading() -> None:
    world = OtherWorld(Hull(), (0.0, 0.0, 0.1), 1)
    world.break_now(Fault("knock", 5e-3))
    np.testing.assert_allclose(world.pose, (-5e-3 * sin(0.1), 5e-3 * cos(0.1), 0.1))


def test_its_drivers_are_found_as_those_of_an_installed_package() -> None:
    for registry in (VEHICLE_DRIVERS, LASER_DRIVERS, TORCH_DRIVERS):
        assert NAME in registry.names
