"""The centre of a butt joint is read at the noise floor, or not at all."""

from contextlib import nullcontext, suppress
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from hull_views import (
    ARC_20,
    ARC_40,
    CAPPED,
    EXACT,
    FILLED_15_MM,
    area_left_to_fill,
    mirrored,
    see,
    top_edges,
    true_placement,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.crawler.joint_tracking.registration import ReferenceProfile
from tjscan.crawler.joint_tracking.tracking import (
    FILLED_GROOVE,
    REGISTERED_JOINT,
    TACK_WELD,
    ButtJointReading,
    JointTracker,
)
from tjscan.joint.hull import HullJoint, HullTack, hull_section
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import (
    SectionLaserModel,
    SectionLaserPose,
    cast_rays_on_section,
    section_in_sensor,
)

EMPTY = HullJoint()

BELIEVED = 0.5e-6
"""Metres: what noisy profiles before leave in what is estimated of the bevels' angles."""


def started(joint: HullJoint = EMPTY) -> JointTracker:
    """A tracker that has read a few profiles of the empty joint."""
    tracker, rng = JointTracker(), np.random.default_rng(0)
    for _ in range(20):
        tracker.read(see(joint, rng, passes=0))
    return tracker


def track(joint: HullJoint, model: SectionLaserModel, profiles: int) -> tuple[Array, Array, int]:
    """Errors and stated standard deviations of the centre, and how many were refused."""
    tracker, rng = started(joint), np.random.default_rng(1)
    errors, sigmas, refused = [], [], 0
    for k in range(profiles):
        pose = SectionLaserPose(offset=2e-3 * np.sin(k / 20), roll=5e-3 * np.sin(k / 30))
        try:
            reading = tracker.read(see(joint, rng, model, pose))
        except GrooveNotFound:
            refused += 1
            continue
        errors.append(reading.centre - true_placement(pose).centre)
        sigmas.append(reading.centre_sigma)
    return np.array(errors), np.array(sigmas), refused


@settings(max_examples=20)
@given(
    offset=st.floats(-3e-4, 3e-4), roll=st.floats(-2e-3, 2e-3), stand_off=st.floats(0.1487, 0.1493)
)
def test_exact_points_give_the_exact_edges(offset: float, roll: float, stand_off: float) -> None:
    # Through an open root: a point next to a bevel's foot could be of either.
    joint = HullJoint(high_low=1e-3, backing=False)
    pose = SectionLaserPose(offset=offset, roll=roll, stand_off=stand_off)
    reading = started(joint).read(see(joint, np.random.default_rng(0), EXACT, pose))
    edges = section_in_sensor(top_edges(joint), pose)
    np.testing.assert_allclose(reading.edges, edges, atol=BELIEVED)
    truth = true_placement(pose)
    assert reading.centre == pytest.approx(truth.centre, abs=BELIEVED)
    assert reading.hull_z == pytest.approx(truth.hull_z, abs=BELIEVED)
    assert reading.roll == pytest.approx(roll, abs=1e-6)


def test_joint_right_of_the_laser_reads_at_positive_x() -> None:
    reading = JointTracker().read(
        see(EMPTY, np.random.default_rng(0), pose=SectionLaserPose(offset=-3e-3))
    )
    assert reading.centre == pytest.approx(3e-3, abs=5 * reading.centre_sigma)


def test_mirrored_profiles_give_mirrored_readings() -> None:
    rng = np.random.default_rng(2)
    profiles = [
        see(FILLED_15_MM, rng, ARC_20, SectionLaserPose(offset=1e-3), passes=0) for _ in range(5)
    ]
    profiles += [see(FILLED_15_MM, rng, ARC_20, SectionLaserPose(offset=1e-3)) for _ in range(5)]
    here, there = JointTracker(), JointTracker()
    for profile in profiles:
        one, other = here.read(profile), there.read(mirrored(profile))
    # The first search is no mirror image of the other to the last digit.
    assert one.centre == pytest.approx(-other.centre, abs=0.1 * one.centre_sigma)
    assert one.roll == pytest.approx(-other.roll, abs=1e-5)
    assert one.centre_sigma == pytest.approx(other.centre_sigma, rel=0.02)


@pytest.mark.parametrize(
    ("joint", "model", "sd_mm", "least_read"),
    [
        (EMPTY, SectionLaserModel(), 0.015, 1.0),
        (EMPTY, ARC_20, 0.025, 0.98),
        (EMPTY, ARC_40, 0.035, 0.97),
        (FILLED_15_MM, ARC_20, 0.035, 0.9),
    ],
    ids=["no arc", "20 % arc", "40 % arc", "filled, 20 % arc"],
)
def test_error_is_small_and_as_stated(
    joint: HullJoint, model: SectionLaserModel, sd_mm: float, least_read: float
) -> None:
    errors, sigmas, refused = track(joint, model, 150)
    assert refused <= (1 - least_read) * 150
    assert 1e3 * np.std(errors) < sd_mm
    # A mean of 150 squares of standard normals is within 0.35 of 1 in 99.7 %.
    assert 0.65 < np.mean((errors / sigmas) ** 2) < 1.4


def test_error_is_at_the_bound_of_any_unbiased_estimate() -> None:
    """Truth of another make: Fisher's information from moved corners of the outline."""
    model = SectionLaserModel(missing=0.0, step=0.0)
    section = hull_section(EMPTY, 0.0)
    jacobian = []
    for node, axis in ((0, 1), (1, 0), (1, 1), (2, 0), (3, 0), (4, 0), (4, 1), (5, 1)):
        views = []
        for step in (-1e-6, 1e-6):
            moved = section.copy()
            moved[node, axis] += step
            views.append(cast_rays_on_section(moved, SectionLaserPose(), model))
        jacobian.append((views[1] - views[0]) / 2e-6)
    J = np.array(jacobian)
    covariance = np.linalg.inv(J @ J.T) * model.noise**2
    bound = 0.5 * np.sqrt(covariance[1, 1] + covariance[5, 5] + 2 * covariance[1, 5])
    tracker, rng = started(), np.random.default_rng(4)
    readings = [tracker.read(see(EMPTY, rng, model)) for _ in range(200)]
    assert np.std([r.centre for r in readings]) / bound == pytest.approx(1.0, abs=0.2)
    assert readings[-1].centre_sigma / bound == pytest.approx(1.0, abs=0.15)


def test_stated_error_grows_with_the_noise() -> None:
    sigmas = []
    for noise in (0.03e-3, 0.06e-3):
        tracker, rng = JointTracker(), np.random.default_rng(0)
        model = SectionLaserModel(noise=noise, step=0.0)
        for _ in range(100):
            reading = tracker.read(see(EMPTY, rng, model))
        sigmas.append(reading.centre_sigma)
        assert tracker.noise == pytest.approx(noise, rel=0.05)
    assert sigmas[1] / sigmas[0] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize(
    "joint",
    [
        HullJoint(high_low=2e-3),
        HullJoint(high_low=-2e-3, backing=False),
        HullJoint(tacks=(HullTack(at=0.0),)),
        HullJoint(opening_angle=1.25, root_face=2e-3),
    ],
    ids=["high-low", "open root", "tack", "root face"],
)
def test_misfit_and_tacks_do_not_move_the_centre(joint: HullJoint) -> None:
    errors, sigmas, _ = track(joint, SectionLaserModel(), 60)
    assert abs(np.mean(errors)) < 3 * np.mean(sigmas) / np.sqrt(60)


def test_tack_is_noticed_and_passes() -> None:
    joint = HullJoint(tacks=(HullTack(at=0.1, length=20e-3),))
    tracker, rng = JointTracker(), np.random.default_rng(0)
    on_tack = {
        along: TACK_WELD in tracker.read(see(joint, rng, along=along)).conditions
        for along in np.arange(0, 0.15, 1e-3)
    }
    # Half a tack is 10 mm long, and its end rises to what is noticed over one.
    for along, noticed in on_tack.items():
        if not 8e-3 < abs(along - 0.1) < 10e-3:
            assert noticed == (abs(along - 0.1) < 9e-3)


@pytest.mark.parametrize("passes", [0, 1, 3])
def test_area_and_depth_left_are_those_of_the_section(passes: int) -> None:
    tracker, rng = started(), np.random.default_rng(0)
    readings = []
    for _ in range(30):
        with suppress(GrooveNotFound):
            readings.append(tracker.read(see(FILLED_15_MM, rng, ARC_20, passes=passes)))
    assert len(readings) > 25
    truth = area_left_to_fill(FILLED_15_MM, hull_section(FILLED_15_MM, 0.0, passes))
    assert np.median([r.area_left for r in readings]) == pytest.approx(truth, abs=1e-6)
    floor = np.linspace(-1, 1, 101) * {0: 3e-3, 1: 9e-3, 3: 11e-3}[passes]
    depth = -np.median(np.interp(floor, *hull_section(FILLED_15_MM, 0.0, passes).T))
    assert readings[-1].depth_left == pytest.approx(depth, abs=0.3e-3)


def reference(joint: HullJoint, pose: SectionLaserPose) -> ReferenceProfile:
    rng, truth = np.random.default_rng(9), true_placement(pose)
    profiles = [see(joint, rng, pose=pose) for _ in range(10)]
    return ReferenceProfile.from_profiles(profiles, [truth] * 10, 0.06e-3)


def test_capped_joint_is_read_by_what_it_looked_like_before() -> None:
    before = reference(CAPPED, SectionLaserPose(offset=1e-3, roll=2e-3))
    tracker, rng = started(), np.random.default_rng(3)
    readings: list[ButtJointReading] = []
    for k in range(60):
        offset = 1e-3 * np.sin(k / 10)
        readings.append(
            tracker.read(see(CAPPED, rng, ARC_20, SectionLaserPose(offset=offset)), before)
        )
        error = readings[-1].centre + offset
        assert abs(error) < 5 * readings[-1].centre_sigma
    assert all(r.conditions == (FILLED_GROOVE, REGISTERED_JOINT) for r in readings)
    assert np.mean([r.centre_sigma for r in readings]) < 0.08e-3
    # Its edges are taken up again where they are seen again.
    again = tracker.read(see(EMPTY, rng, pose=SectionLaserPose(offset=offset)))
    assert REGISTERED_JOINT not in again.conditions
    assert again.centre == pytest.approx(-offset, abs=5 * again.centre_sigma)


def test_joint_that_would_have_jumped_is_refused() -> None:
    aside = reference(CAPPED, SectionLaserPose())
    moved = replace(aside, across=aside.across + 1e-3)
    tracker, rng = started(), np.random.default_rng(3)
    for _ in range(10):
        with pytest.raises(GrooveNotFound):
            tracker.read(see(CAPPED, rng), moved)


@pytest.mark.parametrize(("wider", "is_read"), [(-0.3e-3, True), (0.0, True), (0.3e-3, False)])
def test_edges_that_came_apart_are_none(wider: float, is_read: bool) -> None:
    """What welds close never opens: one of them is a bead's toe."""
    tracker, rng = started(), np.random.default_rng(3)
    before = replace(reference(CAPPED, SectionLaserPose()), width=EMPTY.width - wider)
    with nullcontext() if is_read else pytest.raises(GrooveNotFound):
        tracker.read(see(EMPTY, rng), before)


def test_capped_joint_is_refused_without_that() -> None:
    tracker, rng = started(), np.random.default_rng(3)
    for _ in range(15):
        with pytest.raises(GrooveNotFound):
            tracker.read(see(CAPPED, rng))


def test_refused_start_leaves_nothing_behind() -> None:
    tracker, rng = JointTracker(), np.random.default_rng(3)
    for _ in range(5):
        with pytest.raises(GrooveNotFound):
            tracker.read(see(CAPPED, rng))
    reading = tracker.read(see(EMPTY, rng))
    assert reading.centre == pytest.approx(0.0, abs=5 * reading.centre_sigma)


def test_frozen_profile_is_no_reading() -> None:
    tracker, rng = started(), np.random.default_rng(1)
    profile = see(EMPTY, rng)
    tracker.read(profile)
    for time in (0.0, 0.01):
        with pytest.raises(GrooveNotFound, match="frozen"):
            tracker.read(replace(profile, time=time))
    tracker.read(see(EMPTY, rng))


@pytest.mark.parametrize("ring", [2, 3, 64])
def test_profiles_that_come_round_again_are_no_readings(ring: int) -> None:
    """As of a sensor that stopped, and whose driver gives out its buffers over and over."""
    tracker, rng = started(), np.random.default_rng(1)
    buffers = [see(EMPTY, rng) for _ in range(ring)]
    for profile in buffers:
        tracker.read(profile)
    for profile in buffers * 2:
        with pytest.raises(GrooveNotFound, match="frozen"):
            tracker.read(profile)
    tracker.read(see(EMPTY, rng))


@pytest.mark.parametrize("share", [0.8, 1.0])
def test_profile_without_points_is_no_reading(share: float) -> None:
    tracker, rng = started(), np.random.default_rng(1)
    for k in count():
        profile = see(EMPTY, rng)
        z = np.where(np.arange(len(profile)) < share * len(profile), np.nan, profile.z_s)
        with pytest.raises(GrooveNotFound, match="too few points" if k == 0 else "frozen|too few"):
            tracker.read(Profile(profile.x_s, z))
        if k == 3:
            break
    tracker.read(see(EMPTY, rng))


def test_bare_plate_is_no_joint() -> None:
    plate = np.array([(-0.2, 0.0), (0.2, 0.0)])
    rng, tracker, fresh = np.random.default_rng(0), started(), JointTracker()
    for _ in range(6):
        z = cast_rays_on_section(plate, SectionLaserPose(), EXACT)
        z += 0.06e-3 * rng.standard_normal(len(z))
        for reader in (tracker, fresh):
            with pytest.raises(GrooveNotFound):
                reader.read(Profile(z * EXACT.ray_slopes, z))


def test_joint_is_found_again_after_a_second_without_profiles() -> None:
    tracker, rng = started(), np.random.default_rng(0)
    pose = SectionLaserPose(offset=0.3e-3, roll=2e-3)
    reading = tracker.read(see(EMPTY, rng, ARC_20, pose))
    assert reading.centre == pytest.approx(
        true_placement(pose).centre, abs=5 * reading.centre_sigma
    )


def test_joint_that_is_elsewhere_is_searched_for() -> None:
    tracker, rng = started(), np.random.default_rng(0)
    found = None
    for _ in range(6):
        try:
            found = tracker.read(see(EMPTY, rng, pose=SectionLaserPose(offset=7e-3)))
        except GrooveNotFound:
            continue
    assert found is not None
    assert found.centre == pytest.approx(-7e-3, abs=5 * found.centre_sigma)


def test_joint_of_another_width_is_not_taken_for_this_one() -> None:
    tracker, rng = started(), np.random.default_rng(0)
    for _ in range(6):
        with pytest.raises(GrooveNotFound):
            tracker.read(see(HullJoint(width=34e-3), rng))
