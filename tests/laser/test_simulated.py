"""The simulated laser behaves as a line laser should."""

from collections.abc import Callable

import numpy as np
import pytest

from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array, pose, rot_x, rot_y, rot_z, transform_points
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import RaycastSurface, SimulatedLaser
from tjscan.laser.profile import Profile

T_J_S = pose(rot_z(0.4) @ rot_y(-0.7) @ rot_x(2.0), (0.31, -0.22, 0.47))
AWAY = T_J_S @ pose(rot_y(np.pi))
FLOAT64 = 1e-9
"""Metres: what rounding leaves after moving a scene by a metre."""
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 4], [0, 4, 5]])


def corner() -> Array:
    """Vertices in frame j of a right-angled valley that faces the sensor."""
    y, r = 0.2, 0.1
    vertices_s = [
        (0, -y, 0.25),
        (0, y, 0.25),
        (r, y, 0.25 - r),
        (r, -y, 0.25 - r),
        (-r, y, 0.25 - r),
        (-r, -y, 0.25 - r),
    ]
    return transform_points(T_J_S @ pose(rot_x(0.15)), vertices_s)


def laser(
    seed: int = 0,
    where: Callable[[], Array] = lambda: T_J_S,
    T: Array | None = None,
    model: LaserModel | None = None,
) -> SimulatedLaser:
    """A laser before the valley, both moved by T."""
    T = np.eye(4) if T is None else T
    return SimulatedLaser(
        RaycastSurface(transform_points(T, corner()), TRIANGLES),
        lambda: T @ where(),
        model=model or LaserModel(),
        rng=np.random.default_rng(seed),
        clock=lambda: 12.5,
    )


def profiles(source: LineLaser, count: int = 5) -> list[Profile]:
    with source as connected:
        return [connected.capture() for _ in range(count)]


def columns(taken: list[Profile]) -> Array:
    return np.array([(p.x_s, p.z_s, p.intensity) for p in taken])


def test_a_profile_has_the_sensors_columns_and_the_cells_time() -> None:
    for n in (80, 640):
        (profile,) = profiles(laser(model=LaserModel(columns=n)), 1)
        assert len(profile) == n
        assert profile.time == 12.5
        assert 0.7 * n < profile.valid.sum() < n


def test_the_same_seed_gives_the_same_sequence() -> None:
    np.testing.assert_array_equal(columns(profiles(laser(1))), columns(profiles(laser(1))))


def test_another_seed_and_another_moment_give_another_profile() -> None:
    one, two = columns(profiles(laser(1), 2))
    other = columns(profiles(laser(2), 1))[0]
    for profile in (two, other):
        both = np.isfinite(one[1]) & np.isfinite(profile[1])
        assert not np.array_equal(one[1][both], profile[1][both])


def test_a_profile_does_not_depend_on_what_was_seen_before() -> None:
    places = iter((AWAY, T_J_S))
    _, second = profiles(laser(4, lambda: next(places)), 2)
    _, expected = profiles(laser(4), 2)
    np.testing.assert_array_equal(columns([second]), columns([expected]))


def test_moving_scene_and_sensor_together_leaves_the_profile_as_it_is() -> None:
    T = pose(rot_x(1.0) @ rot_z(-2.0), (0.8, -0.5, 0.9))
    model = LaserModel(step=0.0)  # rounding to whole steps would tell apart what is equal
    here, there = profiles(laser(model=model)), profiles(laser(T=T, model=model))
    np.testing.assert_allclose(columns(here), columns(there), atol=FLOAT64)


def test_the_truth_about_a_capture_is_the_capture() -> None:
    with laser(7) as one, laser(7) as other:
        profile, points = one.capture(), other.capture_with_origins()
    np.testing.assert_array_equal(profile.x_s, points.x_s)
    np.testing.assert_array_equal(profile.z_s, points.z_s)
    assert not points.z_s.flags.writeable
    assert not points.kind.flags.writeable


def test_looking_into_nothing_gives_a_profile_without_points() -> None:
    (profile,) = profiles(laser(where=lambda: AWAY), 1)
    assert len(profile) == 640
    assert not profile.valid.any()
    assert np.isnan(profile.x_s).all()
    assert profile.points_s.shape == (0, 3)


def test_a_laser_that_is_not_connected_is_at_fault() -> None:
    source = laser()
    with pytest.raises(LaserFault, match="not connected"):
        source.capture()
    profiles(source, 1)
    with pytest.raises(LaserFault, match="not connected"):
        source.capture()


@pytest.mark.parametrize("bad", [np.eye(3), np.full((4, 4), np.nan)])
def test_a_pose_that_is_none_is_a_fault(bad: Array) -> None:
    # np.eye(4) @ bad must not hide the shape, so the laser gets it as it is.
    source = SimulatedLaser(
        RaycastSurface(corner(), TRIANGLES),
        lambda: bad,
        model=LaserModel(),
        rng=np.random.default_rng(0),
        clock=lambda: 0.0,
    )
    with source, pytest.raises(LaserFault, match="pose"):
        source.capture()
