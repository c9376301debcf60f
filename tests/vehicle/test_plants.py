"""Laws of both truths, and the figures that the pads must show."""

from math import inf, pi

import numpy as np
import pytest
from plants import TRACKS, distance_between, drive, pad_plant, path_figures, slip_plant

from tjscan.core.frames import Array
from tjscan.vehicle.pad_plant import PadSettings
from tjscan.vehicle.slip_plant import SlipPlant, SlipSettings, TrackLoad
from tjscan.vehicle.tracks import VehiclePlant

MIRROR = np.array((1.0, -1.0, -1.0))
"""What becomes of a pose where y is turned round."""

SAME = 1e-9
"""Metres and radians: what is left of the forces in equilibrium, over the pads' stiffness."""


@pytest.mark.parametrize("down", [0.0, pi / 2, pi, -pi / 2])
def test_pads_hold_the_vehicle_where_it_stands(down: float) -> None:
    plant = pad_plant(friction=0.3, down=down)
    for _ in range(100):
        plant.advance(0.0, 0.0, 0.05)
    np.testing.assert_array_equal(plant.pose_w, 0.0)


def test_slip_moves_nothing_without_its_tracks() -> None:
    plant = slip_plant(ratio=0.2, turning_crab=0.1)
    for _ in range(100):
        plant.advance(0.0, 0.0, 0.05)
    np.testing.assert_array_equal(plant.pose_w, 0.0)


@pytest.mark.parametrize("curvature", [0.0, 0.05, -0.2])
def test_a_vehicle_that_does_not_slip_drives_the_circle_it_is_told(curvature: float) -> None:
    for plant in (slip_plant(), slip_plant(np.array((1.0, 2.0, 3.0)))):
        start = plant.pose_w
        end = drive(plant, 1.0, curvature)[-1]
        angle = curvature * 1.0
        chord = 1.0 if angle == 0 else 2 * np.sin(angle / 2) / curvature
        towards = start[2] + angle / 2
        expected = start + np.array((chord * np.cos(towards), chord * np.sin(towards), angle))
        np.testing.assert_allclose(end, expected, atol=1e-6)  # of steps of 1 mm


@pytest.mark.parametrize("distance", [0.2, -0.2])
@pytest.mark.parametrize("curvature", [0.0, 0.05, -0.2])
def test_a_mirrored_wall_gives_the_mirrored_path(distance: float, curvature: float) -> None:
    pads = [pad_plant(friction=0.3, down=down) for down in (pi / 3, -pi / 3)]
    slips = [
        slip_plant(ratio=0.2, crab=sign * 0.01, yaw_drift=sign * 0.01, turning_crab=sign * 0.1)
        for sign in (1, -1)
    ]
    plants: list[tuple[VehiclePlant, VehiclePlant]] = [(pads[0], pads[1]), (slips[0], slips[1])]
    for plant, mirrored in plants:
        there = drive(plant, distance, curvature)
        other = drive(mirrored, distance, -curvature)
        np.testing.assert_allclose(other, MIRROR * there, atol=1e-7)


def test_slip_is_what_its_ratio_says() -> None:
    speed, crab, drift = path_figures(drive(slip_plant(ratio=0.2, icr_ahead=0.0), 2.0))
    assert speed == pytest.approx(0.02 * 0.98)
    assert crab == pytest.approx(0.010, rel=1e-3)
    assert drift == pytest.approx(0.010, rel=1e-3)
    whole_swing = 2.0 / 0.98
    _, _, turn = path_figures(drive(slip_plant(ratio=0.2, yaw_drift=0.0), whole_swing, 0.05))
    assert turn == pytest.approx(0.8 * 0.05 / 0.98, rel=1e-2)


def test_the_crab_angle_flips_with_the_direction_of_travel() -> None:
    there = path_figures(drive(slip_plant(ratio=0.1), 1.0))[1]
    back = path_figures(drive(slip_plant(ratio=0.1), -1.0))[1]
    assert there == pytest.approx(back)  # sideways over distance: the angle turns round
    assert there > 0


def test_the_centre_of_rotation_lies_ahead_in_the_direction_of_travel() -> None:
    for distance in (0.5, -0.5):
        plant = slip_plant(ratio=0.2, crab=0.0, yaw_drift=0.0)
        poses = drive(plant, distance, 0.2)
        ahead = np.sign(distance) * 0.06
        points: Array = poses[:, :2] + ahead * np.stack(
            (np.cos(poses[:, 2]), np.sin(poses[:, 2])), axis=1
        )
        # The path of that point runs along the heading.
        steps = np.diff(points, axis=0)
        heading = (poses[1:, 2] + poses[:-1, 2]) / 2
        across = -np.sin(heading) * steps[:, 0] + np.cos(heading) * steps[:, 1]
        assert np.abs(across).max() < 1e-8


def test_pads_share_out_the_weight_and_the_torque_is_its_pull() -> None:
    plant = pad_plant(friction=0.3, down=pi)  # x climbs
    drive(plant, 1.5)
    left, right = plant.torques
    assert left == pytest.approx(100 * 9.81 / 2 * TRACKS.sprocket_radius, rel=1e-3)
    assert right == pytest.approx(-left, rel=1e-6)  # mirrored


@pytest.mark.parametrize("friction", [0.3, 0.5])
@pytest.mark.parametrize("radius", [inf, -20.0, 5.0])
@pytest.mark.parametrize("down", [pi / 2, pi])
def test_pads_slip_within_the_ranges_of_an_independent_brush_model(
    friction: float, radius: float, down: float
) -> None:
    plant = pad_plant(friction=friction, down=down)
    drive(plant, 0.7, 1 / radius)
    speed, crab, turn = path_figures(drive(plant, 0.7, 1 / radius))
    assert abs(1 - speed / 0.02) <= 0.024  # longitudinal slip
    if radius == inf:
        assert abs(turn) <= 4.7e-3
        assert abs(crab) <= 3.6e-3
        assert (crab > 1e-4) == (down == pi / 2)  # downhill on a level joint, none climbing
    else:
        assert 0.41 <= turn * radius <= 0.81  # yaw efficiency
        assert 1e-3 <= abs(crab) <= 16e-3


def test_pads_that_do_not_slide_turn_as_two_brushes_do_in_closed_form() -> None:
    # Shear grows along the contact. Side forces cancel where the centre of rotation lies L / 6
    # ahead; their moment is that of the tracks' shear at an efficiency of 1 / (1 + L² / 9 b²).
    length, gauge, curvature = 0.7, TRACKS.gauge, 1 / 400
    plant = pad_plant(inclination=0.0)
    drive(plant, 0.8, curvature)
    _, crab, turn = path_figures(drive(plant, 0.7, curvature))
    assert turn / curvature == pytest.approx(1 / (1 + length**2 / (9 * gauge**2)), rel=0.01)
    assert -crab / turn == pytest.approx(length / 6, rel=0.05)  # of 24 pads, not a continuum


def test_a_tighter_turn_needs_more_torque() -> None:
    most = []
    for radius in (inf, 50.0, 20.0, 5.0):
        plant = pad_plant(friction=0.3, down=pi)
        drive(plant, 0.9, 1 / radius)
        left, right = plant.torques
        most.append((left - right) / 2 if radius == inf else abs(left + right) / 2)
    straight, *turning = most
    assert straight == pytest.approx(24.5, abs=0.2)
    assert turning == sorted(turning)


def test_poses_lie_where_time_steps_of_another_length_put_them() -> None:
    ends = []
    for speed in (0.02, 0.005):  # 2 and 0.5 mm a step
        plant = pad_plant(friction=0.5)
        ends.append(drive(plant, 0.2, 0.05, speed)[-1])
    assert distance_between(*ends) < 2e-4
    assert abs(ends[0][2] - ends[1][2]) < 3e-4


def loaded(down: float = pi, inclination: float = pi / 2) -> SlipPlant:
    pads = PadSettings(friction=0.3, down=down, inclination=inclination)
    return SlipPlant(SlipSettings(), TRACKS.gauge, np.zeros(3), 0, TrackLoad(pads, TRACKS))


@pytest.mark.parametrize("down", [0.0, pi / 2, pi, 2.0])
def test_the_load_of_a_way_straight_on_is_that_of_the_pads(down: float) -> None:
    plant, pads = loaded(down), pad_plant(friction=0.3, down=down)
    drive(plant, 0.5)
    drive(pads, 0.5)
    left, right = plant.torques
    assert left == pytest.approx(-right, abs=1e-9)
    # Weight across the tracks turns a vehicle on pads a little, which takes torque of its own.
    assert left - right == pytest.approx(pads.torques[0] - pads.torques[1], abs=0.5)


def test_the_load_of_a_turn_grows_with_it_and_comes_over_a_way() -> None:
    most = []
    for radius in (inf, 100.0, 20.0, 5.0, 0.5):
        plant, mirrored = loaded(inclination=0.0), loaded(inclination=0.0)
        drive(plant, 0.1, 1 / radius)
        begun = plant.torques[0]
        drive(plant, 5.0, 1 / radius)
        drive(mirrored, 5.1, -1 / radius)
        most.append(plant.torques[0])
        assert begun <= 0.2 * most[-1]
        assert mirrored.torques == pytest.approx((-plant.torques[1], -plant.torques[0]))
    assert most[0] == 0.0
    assert most == sorted(most)
    # All pads slide where a vehicle turns on the spot: mu N L / 4, over Merritt's 0.925.
    pressed = 0.3 * (48 * 25 + 100) * 9.81
    slides = pressed * 0.7 / 4 / TRACKS.gauge * TRACKS.sprocket_radius
    spot = loaded(inclination=0.0)
    for _ in range(500):
        spot.advance(0.02, -0.02, 1.0)
    assert spot.torques == pytest.approx((slides / 0.925, slides / 0.925), rel=1e-3)
