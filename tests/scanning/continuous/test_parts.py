"""Laws of the parts of a continuous scan: poses in between, fused profiles, clocks, seam ahead."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seams import Noise, seam

from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array, pose, unit_vector
from tjscan.groove.section import FROM_NEIGHBOURS
from tjscan.laser.profile import Profile
from tjscan.robot.arm import ArmState
from tjscan.robot.kinematics import Kinematics
from tjscan.scanning.continuous.clocks import LaserClock, ShuttleViews, clock_offset
from tjscan.scanning.continuous.fusing import ProfileFuser, fuse_profiles
from tjscan.scanning.continuous.poses import ActualPoses
from tjscan.scanning.continuous.seam_ahead import predict_seam, seam_direction
from tjscan.scanning.continuous.smoothing import finished_sections, smooth_corners
from tjscan.scanning.section import ProfileView, ScannedSection, SetPoint, Substep
from tjscan.scanning.sections_before import planning_sections
from tjscan.scanning.target import ScanDirection

HOME = np.radians([-110.0, -95.0, 160.0, 105.0, -110.0, 0.0])
T_F_S = pose(
    Rotation.from_euler("xyz", (2.0, 3.0, 1.0), degrees=True).as_matrix(), (0, -0.11, 0.17)
)


@cache
def arm() -> Kinematics:
    return Kinematics.load("ur10e")


def swinging(times: Array, size: float = 0.02) -> Array:
    """Joint angles of a smooth motion."""
    return np.asarray(HOME + size * np.sin(2.0 * times[:, None] + np.arange(6)))


def poses_of(times: Array, q: Array) -> ActualPoses:
    poses = ActualPoses(arm())
    poses.add(ArmState(one, arm().forward(one), t) for one, t in zip(q, times, strict=True))
    return poses


def test_between_states_the_arm_is_where_it_was_to_a_micrometre() -> None:
    times = np.arange(0.0, 2.0, 0.008)
    poses = poses_of(times, swinging(times))
    for t in (0.001, 0.5, 1.2345, 1.98):
        found = poses.at(t).T_b_f
        np.testing.assert_allclose(found, arm().forward(swinging(np.array([t]))[0]), atol=1e-6)


def test_states_that_come_twice_or_are_overtaken_change_nothing() -> None:
    times = np.arange(0.0, 1.0, 0.008)
    doubled = np.repeat(times, 2)
    doubled[100:103] = doubled[102:99:-1]
    once, twice = poses_of(times, swinging(times)), poses_of(doubled, swinging(doubled))
    for t in (0.3, 0.41, 0.7):
        np.testing.assert_allclose(twice.at(t).q, once.at(t).q, atol=1e-6)


def view_at(T_b_s: Array, profile: Profile, time: float) -> ProfileView:
    return ProfileView(3, Substep.PASSING, T_b_s, T_b_s, profile, time, HOME)


def profile_of_ridge(T_b_s: Array, along_b: Array, noise: float, seed: int) -> Profile:
    """A ridge that runs along a direction through the origin, seen in a sensor's plane."""
    x = np.linspace(-0.03, 0.03, 201)
    up = np.array((0.0, 0.0, 1.0))
    side = np.cross(along_b, up)

    def height(points: Array) -> Array:
        return np.asarray(points @ up - 0.3 * np.abs(points @ side))

    z = np.full_like(x, 0.23)
    for _ in range(40):  # Newton along each ray of constant x
        points = np.column_stack((x, 0 * x, z)) @ T_b_s[:3, :3].T + T_b_s[:3, 3]
        ahead = np.column_stack((x, 0 * x, z + 1e-6)) @ T_b_s[:3, :3].T + T_b_s[:3, 3]
        z = z - height(points) * 1e-6 / (height(ahead) - height(points))
    z = z + noise * np.random.default_rng(seed).standard_normal(len(x))
    return Profile(x, z)


def looking_down(y: float, turn: float = 0.0) -> Array:
    """A sensor above the ridge, its plane square to it but for a turn."""
    R = Rotation.from_euler("y", 180, degrees=True) * Rotation.from_euler("z", turn, degrees=True)
    return pose(R.as_matrix(), (0.0, y, 0.23))


def test_profiles_slid_along_the_groove_agree_and_their_noise_goes_down() -> None:
    along = np.array((0.0, 1.0, 0.0))
    places = 0.35e-3 * np.arange(-3, 4)

    def seen(noise: float) -> tuple[list[ProfileView], Profile]:
        sensors = [looking_down(y, turn=8.0 + 30 * y) for y in places]
        profiles = [profile_of_ridge(T, along, noise, k) for k, T in enumerate(sensors)]
        views = [
            view_at(T, p, 0.1 * k) for k, (T, p) in enumerate(zip(sensors, profiles, strict=True))
        ]
        return views, profile_of_ridge(sensors[3], along, 0.0, 0)

    views, truth = seen(0.0)
    fused = fuse_profiles(views, views[3], along).profile
    np.testing.assert_allclose(
        np.interp(truth.x_s, fused.x_s, fused.z_s)[5:-5], truth.z_s[5:-5], atol=2e-6
    )
    views, truth = seen(0.02e-3)
    fused = fuse_profiles(views, views[3], along).profile
    left = np.interp(truth.x_s, fused.x_s, fused.z_s) - truth.z_s
    assert np.nanstd(left[5:-5]) < 0.02e-3 / np.sqrt(len(places)) * 1.3


@pytest.mark.parametrize("speed", [0.3e-3, 0.7e-3, 1.1e-3])
def test_places_are_evenly_spaced_whatever_the_speed(speed: float) -> None:
    along, fuser = np.array((0.0, 1.0, 0.0)), ProfileFuser(2e-3, np.array((0.0, 0.0, 0.23)))
    fuser.start_at(looking_down(0.0), 0.0)
    random, found = np.random.default_rng(0), []
    for y in np.arange(0.0, 0.05, speed):
        T = looking_down(y)
        z = 0.23 + 1e-5 * random.standard_normal(50)
        profile = Profile(np.linspace(-0.01, 0.01, 50), z)
        found += [s for s, _ in fuser.add(view_at(T, profile, y), along)]
    assert len(found) == 24
    np.testing.assert_allclose(found, 2e-3 * np.arange(1, 25), atol=0.51 * speed)


def shuttle(offset: float, across: bool, noise: float) -> tuple[ShuttleViews, ActualPoses]:
    """Corners that stand still in b, seen while the laser goes to and fro."""
    times = np.arange(0.0, 1.6, 0.008)
    T = arm().forward(HOME)
    amplitude = 4e-3 * np.sin(2 * np.pi * 1.5 * times) ** 1
    axis = (T @ T_F_S)[:3, 0] if across else (T @ T_F_S)[:3, 1]
    q, near = [], HOME
    for a in amplitude:
        near = arm().inverse(pose(p=a * axis) @ T, near=near)
        q.append(near)
    poses = poses_of(times, np.array(q))
    random = np.random.default_rng(2)
    start = T @ T_F_S
    corners_b = start @ np.array(((-0.01, 0.0, 0.22, 1.0), (0.012, 0.0, 0.235, 1.0))).T
    stamps, seen = np.arange(0.1, 1.5, 0.005), []
    for t in stamps:
        now = np.linalg.inv(poses.at(t).T_b_f @ T_F_S)
        # A groove that runs along y of the sensor: what is seen does not depend on y.
        seen.append((now @ corners_b)[[0, 2]].T)
    corners = np.array(seen) + noise * random.standard_normal((len(stamps), 2, 2))
    return ShuttleViews(stamps - offset, corners), poses


@pytest.mark.parametrize("offset", [-0.03, 0.0, 0.02])
def test_a_shuttle_across_the_groove_finds_the_offset_of_the_clocks(offset: float) -> None:
    views, poses = shuttle(offset, across=True, noise=0.03e-3)
    found, sigma = clock_offset(views, poses, T_F_S, offset + 2e-3)
    assert abs(found - offset) < 3 * sigma
    assert sigma < 0.2e-3


def test_a_shuttle_along_the_groove_does_not() -> None:
    views, poses = shuttle(0.02, across=False, noise=0.03e-3)
    with pytest.raises(LaserFault, match="can't be laid"):
        clock_offset(views, poses, T_F_S, 0.022)


@pytest.mark.parametrize("drift", [-1e-4, 0.0, 1e-4])
def test_drift_is_found_from_when_profiles_arrive(drift: float) -> None:
    random = np.random.default_rng(4)

    def arrival(t: float) -> float:
        delay = 2e-3 + 0.3e-3 * abs(random.standard_normal())
        return float(0.002 * np.ceil((t + 0.02 + delay) / 0.002))

    usual = float(np.median([arrival(t) - t - 0.02 for t in np.arange(-2.0, 0.0, 0.005)]))
    clock = LaserClock(0.02, 1e-4, since=0.0, delays=(usual, usual), state_period=0.002)
    for t in np.arange(0.0, 10.0, 0.005):
        stamp = t / (1 + drift)
        clock.notice_arrival(stamp, arrival(t))
        assert abs(clock.arm_time(stamp) - (t + 0.02)) < 0.4e-3
    assert clock.sigma_at(stamp) < 0.7e-3


@pytest.mark.parametrize("direction", ScanDirection, ids=["ccw", "cw"])
@pytest.mark.parametrize("joint", ["tjoint-600x457", "tjoint-406x324"])
def test_the_seam_ahead_is_where_the_next_sections_are(
    joint: str, direction: ScanDirection
) -> None:
    world = seam(joint, direction, noise=Noise())
    walk = world.walk(0.4, 0.008, 24)
    known = planning_sections(walk[:12])
    ahead = predict_seam(known, world.plan, 0.08)
    assert (np.diff(ahead.lengths) > 0).all()
    origins = ahead.T_b_t[:, :3, 3]
    for later in walk[12:20]:
        point = later.T_b_g[:3, 3]
        k = int(np.linalg.norm(origins - point, axis=1).argmin())
        off = point - origins[k]
        x = ahead.T_b_t[k, :3, 0]
        assert np.linalg.norm(off - (off @ x) * x) < 1.5e-3
    with pytest.raises(IndexError):
        predict_seam([], world.plan, 0.08)


@pytest.mark.parametrize("yaw", [-20.0, 20.0])
def test_the_seam_ahead_leads_the_same_way_however_the_plane_of_light_is_turned(
    yaw: float,
) -> None:
    """Where it does not, the path turns the plane, and the plane the path."""
    world = seam()
    *before, last = world.walk(1.5, 0.008, 12)
    about_y = pose(Rotation.from_euler("y", yaw, degrees=True).as_matrix())
    turned = world.look(SetPoint(last.T_b_t @ about_y, last.T_s_t), last.view.index)
    ways = [
        predict_seam([*before, one], world.plan, 0.03).T_b_t[0, :3, 0] for one in (last, turned)
    ]
    assert np.degrees(np.arccos(ways[0] @ ways[1])) < 1.0


def test_sections_to_plan_with_are_spaced_and_end_with_the_last() -> None:
    walk = seam(noise=Noise()).walk(0.4, 0.004, 40)
    chosen = planning_sections(walk)
    assert chosen[-1] is walk[-1]
    gaps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in chosen], axis=0), axis=1)
    assert (gaps > 7.9e-3).all()
    assert (gaps < 12.5e-3).all()


def section_at(seamwise: float, corner_shift: float, index: int) -> ScannedSection:
    """A section of a straight groove, its corners shifted across."""
    world = seam()
    section = world.walk(0.4, 0.02, 1)[0]
    T = section.view.T_b_s
    away = pose(p=seamwise * T[:3, 1] + corner_shift * T[:3, 0])
    view = replace(section.view, T_b_s=away @ T, index=index)
    return replace(section, view=view)


def test_smoothing_takes_noise_away_and_leaves_a_parabola_and_a_jump() -> None:
    random = np.random.default_rng(3)
    s: Array = 0.002 * np.arange(60.0)
    way: Array = np.asarray(2.0 * (s - 0.06) ** 2)
    noise = 0.03e-3 * random.standard_normal(60)
    step = np.where(np.arange(60) < 30, 0.0, 2e-3)

    def smoothed(shifts: Array) -> Array:
        sections = [section_at(a, b, k) for k, (a, b) in enumerate(zip(s, shifts, strict=True))]
        straight = [section_at(a, 0.0, k) for k, a in enumerate(s)]
        off = smooth_corners(sections) - np.array([one.points_b[1:4] for one in straight])
        return np.asarray(off[:, 0] @ sections[0].view.T_b_s[:3, 0])

    np.testing.assert_allclose(smoothed(way), way, atol=1e-6)  # over its chords, not over s
    left = smoothed(way + noise)[4:-4] - way[4:-4]
    assert left.std() < 0.75 * noise.std()
    over = smoothed(step + noise)
    assert np.abs(over - step).max() < 0.15e-3  # nothing is smeared over the step


def test_the_grooves_direction_is_known_to_two_degrees_whatever_one_section_is_off() -> None:
    """Profiles are slid along it: 2° over a millimetre are 0.03 mm across the groove."""
    walk = seam("tjoint-406x324", noise=Noise(points=0.1e-3)).walk(0.4, 0.002, 60)
    exact = seam("tjoint-406x324").walk(0.4, 0.002, 60)
    for k in range(20, 58):
        ahead = exact[k + 1].points_b[1:4] - exact[k - 1].points_b[1:4]
        cosine = seam_direction(walk[: k + 1]) @ unit_vector(ahead.mean(axis=0))
        assert np.degrees(np.arccos(cosine)) < 2.0


def test_a_lone_corner_that_contradicts_its_neighbours_is_given_by_them_and_named() -> None:
    random = np.random.default_rng(5)
    s: Array = 0.002 * np.arange(40.0)
    way: Array = np.asarray(2.0 * (s - 0.04) ** 2)
    read = way + 0.03e-3 * random.standard_normal(40)
    wrong = [0, 12, 25, 39]
    read[wrong] += 0.8e-3
    sections = [section_at(a, b, k) for k, (a, b) in enumerate(zip(s, read, strict=True))]
    fused = [replace(one, view=replace(one.view, substep=Substep.FUSED)) for one in sections]
    given = finished_sections(fused)
    assert [k for k, one in enumerate(given) if FROM_NEIGHBOURS in one.groove.conditions] == wrong
    for k in wrong:
        off = (given[k].points_b - section_at(s[k], way[k], k).points_b)[1:4]
        assert np.linalg.norm(off, axis=1).max() < 0.1e-3
        sigmas = np.sqrt(np.trace(given[k].groove.corner_covariances_s, axis1=1, axis2=2))
        assert (np.linalg.norm(off, axis=1) < 3 * sigmas).all()
    assert finished_sections(given) == given  # what was given once stays
    assert finished_sections(sections) == tuple(sections)  # of a stepwise scan


def test_what_begins_in_the_groove_is_not_taken_for_a_wrong_reading() -> None:
    s: Array = 0.002 * np.arange(40.0)
    step = np.where(np.arange(40) < 20, 0.0, 2e-3)
    sections = [section_at(a, b, k) for k, (a, b) in enumerate(zip(s, step, strict=True))]
    fused = [replace(one, view=replace(one.view, substep=Substep.FUSED)) for one in sections]
    assert all(FROM_NEIGHBOURS not in one.groove.conditions for one in finished_sections(fused))


@pytest.mark.parametrize("leap", [-1.0, -0.1, 0.1, 100.0])
def test_stamps_that_leap_are_refused(leap: float) -> None:
    clock = LaserClock(0.02, 1e-4, since=0.0, delays=(2e-3, 2e-3), state_period=0.002)
    for t in np.arange(0.0, 1.0, 0.005):
        clock.notice_arrival(float(t), float(t) + 0.022)

    def leap_for_half_a_second() -> None:
        for t in np.arange(1.0, 1.6, 0.005):
            clock.notice_arrival(float(t) + leap, float(t) + 0.022)

    with pytest.raises(LaserFault, match="leaps"):
        leap_for_half_a_second()


def test_profiles_that_come_before_states_of_an_arm_that_are_late_are_no_leap() -> None:
    clock = LaserClock(0.02, 1e-4, since=0.0, delays=(2e-3, 2e-3), state_period=0.002)
    for t in np.arange(0.0, 4.0, 0.005):
        clock.notice_arrival(float(t), float(t) + 0.022 - (0.1 if t % 1.0 < 0.2 else 0.0))
        assert abs(clock.arm_time(float(t)) - (t + 0.02)) < 0.2e-3
    for t in (4.0, 8.0):  # neither are they before and after a while without any
        clock.notice_arrival(t, t + 0.022 - 0.1)
    with pytest.raises(LaserFault, match="leaps"):
        clock.notice_arrival(13.0, 8.2)


def test_profiles_that_arrive_late_do_not_bend_the_clock() -> None:
    clock = LaserClock(0.02, 1e-4, since=0.0, delays=(2e-3, 2e-3), state_period=0.002)
    for t in np.arange(0.0, 8.0, 0.005):
        clock.notice_arrival(float(t), float(t) + 0.022 + (0.1 if t > 2.0 else 0.0))
        assert abs(clock.arm_time(float(t)) - (t + 0.02)) < 0.2e-3
