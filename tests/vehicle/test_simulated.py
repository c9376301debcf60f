"""The simulated vehicle and the replayed one, behind the protocol."""

import threading
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.errors import ConfigurationError, VehicleFault, VehicleLinkLost, VehicleStopped
from tjscan.vehicle.drivers import VEHICLE_DRIVERS, VehicleDriverInputs
from tjscan.vehicle.pad_plant import PadSettings
from tjscan.vehicle.replay import ReplayedVehicle
from tjscan.vehicle.simulated import SimulatedVehicle
from tjscan.vehicle.simulated_body import (
    VEHICLE_STATE_PERIOD,
    DriveSettings,
    InertialSettings,
    ProximitySettings,
    SimulatedBody,
    VehicleSimulationSettings,
)
from tjscan.vehicle.slip_plant import SlipSettings
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import AT_REST, Twist, Vehicle, VehicleState, merge_unread_states


def vehicle(seed: int = 0, **settings: object) -> SimulatedVehicle:
    world = VehicleSimulationSettings(**settings)  # type: ignore[arg-type]
    return SimulatedVehicle(SimulatedBody(TrackGeometry(), world, seed=seed))


def where(simulated: SimulatedVehicle) -> tuple[float, float]:
    T_w_v = simulated.true_pose()
    return float(T_w_v[0, 3]), float(T_w_v[1, 3])


def run(simulated: Vehicle, seconds: float, twist: Twist | None = None) -> list[VehicleState]:
    """States of that time; the twist, if any, is commanded before each."""
    states = []
    for _ in range(round(seconds / VEHICLE_STATE_PERIOD)):
        if twist is not None:
            simulated.command(twist)
        states.append(simulated.next_state())
    return states


@pytest.mark.parametrize("plant", ["slip", "pads"])
def test_nothing_moves_without_a_command(plant: str) -> None:
    with vehicle(plant=plant, slip=SlipSettings(ratio=0.2)) as simulated:
        run(simulated, 1.0)
        np.testing.assert_array_equal(simulated.true_pose(), np.eye(4))


def test_it_drives_as_told_and_its_odometry_shows_it() -> None:
    with vehicle() as simulated:
        states = run(simulated, 10.0, Twist(0.02, 0.01))
        shown = states[-500:]
        assert np.mean([s.odometry.speed for s in shown]) == pytest.approx(0.02, abs=2e-5)
        assert np.mean([s.odometry.turn_rate for s in shown]) == pytest.approx(0.01, abs=1e-4)
        # The mean of two encoders' noise, 2 mrad/s each, at 50 mm.
        assert np.std([s.odometry.speed for s in shown]) == pytest.approx(1e-4 / 2**0.5, rel=0.15)
        assert states[-1].time == pytest.approx(10.0)
        T_w_v = simulated.true_pose()
        assert np.arctan2(T_w_v[1, 0], T_w_v[0, 0]) == pytest.approx(0.1, abs=2e-3)
        assert T_w_v[1, 3] > 0.005  # a clockwise turn leads to y, to the right


def test_odometry_does_not_show_the_slip() -> None:
    with vehicle(slip=SlipSettings(ratio=0.2)) as simulated:
        states = run(simulated, 5.0, Twist(0.02, 0.02))
        shown = sum(s.odometry.turn_rate for s in states) * VEHICLE_STATE_PERIOD
        T_w_v = simulated.true_pose()
        turned = np.arctan2(T_w_v[1, 0], T_w_v[0, 0])
        assert 0.7 < turned / shown < 0.9


@given(st.floats(-0.1, 0.1), st.floats(-0.2, 0.2))
def test_the_dead_man_stops_it(speed: float, turn_rate: float) -> None:
    with vehicle() as simulated:
        run(simulated, 0.3, Twist(speed, turn_rate))
        run(simulated, 0.6)
        stood = simulated.true_pose()
        run(simulated, 1.0)
        np.testing.assert_array_equal(simulated.true_pose(), stood)
        run(simulated, 0.5, Twist(0.05, 0.0))  # it is no latch
        assert np.linalg.norm((simulated.true_pose() - stood)[:2, 3]) > 0.01


def test_a_stop_holds_until_it_is_taken_back() -> None:
    with vehicle() as simulated:
        run(simulated, 1.0, Twist(0.1, 0.0))
        thread = threading.Thread(target=simulated.stop)
        thread.start()
        thread.join()
        run(simulated, 0.1)
        stood = simulated.true_pose()
        for _ in range(10):
            with pytest.raises(VehicleStopped):
                simulated.command(Twist(0.1, 0.0))
            simulated.next_state()
        np.testing.assert_array_equal(simulated.true_pose(), stood)
        simulated.accept_commands_again()
        run(simulated, 0.2)
        np.testing.assert_array_equal(simulated.true_pose(), stood)
        run(simulated, 0.5, Twist(0.1, 0.0))
        assert where(simulated)[0] > stood[0, 3] + 0.01
    with pytest.raises(VehicleLinkLost):
        simulated.next_state()
    with simulated:
        simulated.command(AT_REST)  # connecting again takes the stop back


@pytest.mark.parametrize("wrong", [nan, inf, -inf])
def test_what_is_no_number_never_steers(wrong: float) -> None:
    with vehicle() as simulated:
        for twist in (Twist(wrong, 0.0), Twist(0.0, wrong), Twist(0.0, 0.0, wrong)):
            with pytest.raises(VehicleFault):
                simulated.command(twist)
        with pytest.raises(VehicleFault, match="sideways"):
            simulated.command(Twist(0.0, 0.0, 0.1))
        run(simulated, 0.3)
        np.testing.assert_array_equal(simulated.true_pose(), np.eye(4))


def test_too_fast_a_twist_is_driven_slower_along_the_same_curve() -> None:
    ends = []
    for speed, seconds in ((0.05, 20.0), (1.0, 20.0 * 0.05 / DriveSettings().top_speed * 1.2)):
        with vehicle(drives=DriveSettings(lag=0.0, acceleration=100.0)) as simulated:
            run(simulated, seconds, Twist(speed, speed))
            ends.append(simulated.true_pose())
    radii = [np.hypot(T[0, 3], T[1, 3]) / (2 * np.sin(np.arctan2(T[1, 3], T[0, 3]))) for T in ends]
    assert radii == pytest.approx([1.0, 1.0], abs=1e-3)


def test_proximity_comes_ten_times_a_second_and_sees_the_edge() -> None:
    plate = ((-1.0, -1.0), (0.6, -1.0), (0.6, 1.0), (-1.0, 1.0))
    with vehicle(steel=plate) as simulated:
        states = run(simulated, 4.0, Twist(0.1, 0.0))
        samples = [(s.time, s.proximity) for s in states if s.proximity]
        assert len(samples) == 40
        off = [time for time, read in samples if read[0] == inf]
        # 200 mm ahead at 100 mm/s, and what the drives lag.
        assert 2.0 < off[0] < 2.4
        assert all(read[2] < 0.04 for _, read in samples)


def test_the_same_seed_gives_the_same_states() -> None:
    def states(seed: int) -> list[VehicleState]:
        with vehicle(seed, slip=SlipSettings(ratio=0.2)) as simulated:
            return run(simulated, 0.5, Twist(0.05, 0.1))

    assert states(3) == states(3)
    assert states(3) != states(4)


def test_settings_are_read_as_they_are_written() -> None:
    settings = VehicleSimulationSettings(
        plant="pads",
        slip=SlipSettings(ratio=0.1, crab=0.004),
        proximity=ProximitySettings(irregular=0.02),
        steel=((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)),
    )
    assert validate_table(VehicleSimulationSettings, table_to_dict(settings)) == settings
    with pytest.raises(ConfigurationError, match="did you mean: ratio"):
        validate_table(VehicleSimulationSettings, {"slip": {"rato": 0.1}})


def test_drivers_make_their_vehicle() -> None:
    def no_recording() -> tuple[VehicleState, ...]:
        return (VehicleState(0.0, AT_REST),)

    left = np.array((1.0, 2.0, 0.0)), 5.0
    inputs = VehicleDriverInputs(
        TrackGeometry(), 1, VehicleSimulationSettings(), left, no_recording
    )
    driver = VEHICLE_DRIVERS.load("simulated")
    with driver.make(inputs, None) as made:
        assert made.next_state().time == pytest.approx(5.0 + VEHICLE_STATE_PERIOD)
        np.testing.assert_allclose(driver.truth(made)[:2, 3], (1.0, 2.0))
    pytest.importorskip("paho.mqtt")
    driver = VEHICLE_DRIVERS.load("mqtt")
    assert driver.make(inputs, driver.table()).dead_man == 0.5
    driver = VEHICLE_DRIVERS.load("replay")
    with driver.make(inputs, None) as replayed:
        assert replayed.next_state() == VehicleState(0.0, AT_REST)
        with pytest.raises(ConfigurationError):
            driver.truth(replayed)


def test_a_recording_is_replayed_in_its_order_whatever_is_commanded() -> None:
    states = [VehicleState(0.01 * i, Twist(0.02, 0.001 * i)) for i in range(5)]
    with ReplayedVehicle(states) as replayed:
        assert run(replayed, 5 * VEHICLE_STATE_PERIOD, Twist(-1.0, 0.0)) == states
        with pytest.raises(VehicleLinkLost):
            replayed.next_state()
        replayed.stop()
        with pytest.raises(VehicleStopped):
            replayed.command(AT_REST)
    with pytest.raises(VehicleFault), ReplayedVehicle([]):
        pass


def test_inertial_sensors_show_how_it_truly_turns_and_disturb_nothing_else() -> None:
    exact = InertialSettings(gyro_noise=0.0, gyro_bias=0.0, down_noise=0.0, down_bias=0.0)
    pads = PadSettings(down=1.2)
    found = []
    for inertial in (None, exact):
        with vehicle(slip=SlipSettings(ratio=0.2), pads=pads, inertial=inertial) as simulated:
            found.append(run(simulated, 1.0, Twist(0.05, 0.1)))
            heading = simulated.body.plant.pose_w[2]
    plain, states = found
    assert [replace(state, gyro=(), down=()) for state in states] == plain
    assert not any(state.gyro or state.down for state in plain)
    turned = sum(rate for state in states for rate in state.gyro) * VEHICLE_STATE_PERIOD
    assert turned == pytest.approx(heading)
    assert states[-1].down == pytest.approx((1.2 - heading,))
    assert merge_unread_states(states[:2]).gyro == pytest.approx(
        ((states[0].gyro[0] + states[1].gyro[0]) / 2,)
    )


def test_an_inclinometer_shows_nothing_on_a_floor_and_gyros_are_biased() -> None:
    settings = {"inertial": InertialSettings(), "pads": PadSettings(inclination=0.0)}
    with vehicle(1, **settings) as simulated:
        states = run(simulated, 2.0)
    rates = [state.gyro[0] for state in states]
    assert not any(state.down for state in states)
    own = InertialSettings()
    assert 0.1 * own.gyro_bias < abs(np.mean(rates)) < 3 * own.gyro_bias
    assert np.std(rates) == pytest.approx(own.gyro_noise / np.sqrt(VEHICLE_STATE_PERIOD), rel=0.2)


def test_of_states_that_nobody_read_the_last_is_given_with_the_way_of_all() -> None:
    simulated = vehicle(slip=SlipSettings(ratio=0.0), encoder_noise=0.01)
    with simulated:
        states = run(simulated, 0.3, Twist(0.05, 0.02))
    read = [merge_unread_states(states[k : k + 5]) for k in range(0, len(states), 5)]
    assert [state.time for state in read] == [state.time for state in states[4::5]]
    way = sum(state.odometry.speed for state in states) * VEHICLE_STATE_PERIOD
    assert sum(state.odometry.speed for state in read) * 5 * VEHICLE_STATE_PERIOD == pytest.approx(
        way
    )
    sampled = [state.proximity for state in states if state.proximity]
    assert [state.proximity for state in read if state.proximity] == sampled
    assert merge_unread_states(states[:1]) == states[0]


def test_the_way_of_unread_states_comes_out_right_though_they_came_unevenly() -> None:
    times, speeds = [0.3, 0.31, 0.4], [0.04, 0.02, 0.0]
    states = [VehicleState(t, Twist(v, v)) for t, v in zip(times, speeds, strict=True)]
    merged = merge_unread_states(states, since=0.0)
    assert merged.time * merged.odometry.speed == pytest.approx(0.3 * 0.04 + 0.01 * 0.02)
