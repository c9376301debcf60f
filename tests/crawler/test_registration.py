"""A profile is laid on one taken before, as far as its shape tells where."""

from dataclasses import replace

import numpy as np
import pytest
from hull_views import ARC_20, CAPPED, DEFAULT, EXACT, NEARLY_FILLED, see, true_placement
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.crawler.joint_tracking.registration import (
    UNKNOWN_CLOSING,
    JointPlacement,
    ReferenceProfile,
    register_profile,
)
from tjscan.joint.hull import HullJoint, WeldBead, hull_section
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import SectionLaserModel, SectionLaserPose, cast_rays_on_section

NOISE = 0.06e-3


def reference(
    model: SectionLaserModel = DEFAULT,
    joint: HullJoint = CAPPED,
    *,
    passes: int = 9,
    of: int = 10,
    seed: int = 9,
) -> ReferenceProfile:
    rng = np.random.default_rng(seed)
    profiles = [see(joint, rng, model, passes=passes) for _ in range(of)]
    return ReferenceProfile.from_profiles(profiles, [true_placement()] * of, NOISE)


def register(
    profile: Profile, against: ReferenceProfile, start: JointPlacement
) -> JointPlacement | None:
    v = profile.valid
    z = profile.z_s[v]
    found = register_profile(profile.x_s[v] / z, z, against, start, NOISE)
    return None if found is None else found[0]


@settings(max_examples=20)
@given(
    offset=st.floats(-6e-4, 6e-4), roll=st.floats(-5e-3, 5e-3), stand_off=st.floats(0.1485, 0.1495)
)
def test_registration_recovers_how_the_sensor_moved(
    offset: float, roll: float, stand_off: float
) -> None:
    pose = SectionLaserPose(offset=offset, roll=roll, stand_off=stand_off)
    profile = see(CAPPED, np.random.default_rng(0), EXACT, pose)
    found = register(profile, reference(EXACT), true_placement())
    truth = true_placement(pose)
    assert found is not None
    # The reference is a broken line with a point for each column.
    assert found.centre == pytest.approx(truth.centre, abs=5e-6)
    assert found.hull_z == pytest.approx(truth.hull_z, abs=5e-6)
    assert found.roll == pytest.approx(roll, abs=5e-5)


def test_stated_error_is_that_of_many_profiles() -> None:
    rng, ratios = np.random.default_rng(5), []
    for _ in range(15):
        against = ReferenceProfile.from_profiles(
            [see(CAPPED, rng) for _ in range(10)], [true_placement()] * 10, NOISE
        )
        for _ in range(10):
            offset = rng.uniform(-0.3e-3, 0.3e-3)
            profile = see(CAPPED, rng, ARC_20, SectionLaserPose(offset=offset))
            found = register(profile, against, true_placement())
            assert found is not None
            ratios.append((found.centre + offset) / found.centre_sigma)
    assert 0.6 < np.mean(np.square(ratios)) < 1.5


def test_bead_that_rises_along_the_joint_is_no_noisier_than_one_that_does_not() -> None:
    """By 0.4 mm a millimetre, as one falls where it ends."""

    def rising(along: float) -> HullJoint:
        return HullJoint(beads=(replace(CAPPED.beads[0], crown=2e-3 + 0.4 * along),))

    rng, even = np.random.default_rng(3), list[float]()
    errors, sigmas = list[float](), list[float]()
    beyond = np.linspace(-2e-3, 2e-3, 10)
    for _ in range(20):
        profiles = [see(rising(at), rng) for at in beyond.tolist()]
        against = ReferenceProfile.from_profiles(
            profiles, [true_placement()] * 10, NOISE, None, beyond
        )
        for at in (-0.5e-3, 0.5e-3):
            found = register(see(rising(at), rng), against.seen_from(at), true_placement())
            assert found is not None
            errors.append(found.centre)
            sigmas.append(found.centre_sigma)
        level = register(see(CAPPED, rng), reference(seed=len(even)), true_placement())
        assert level is not None
        even.append(level.centre_sigma)
    assert np.median(sigmas) < 1.3 * np.median(even)
    assert 0.5 < np.mean(np.divide(errors, sigmas) ** 2) < 1.5


def test_error_of_the_reference_is_an_error_of_the_reading() -> None:
    rng = np.random.default_rng(0)
    profiles = [see(CAPPED, rng) for _ in range(10)]
    sigmas = []
    for sigma in (0.0, 0.3e-3):
        placement = JointPlacement(centre=0.0, hull_z=0.149, roll=0.0, centre_sigma=sigma)
        against = ReferenceProfile.from_profiles(profiles, [placement] * 10, NOISE)
        found = register(profiles[0], against, placement)
        assert found is not None
        sigmas.append(found.centre_sigma)
    assert sigmas[1] == pytest.approx(np.hypot(sigmas[0], 0.3e-3 / np.sqrt(10)), rel=0.01)


def test_bare_plate_does_not_tell_where_it_is() -> None:
    x = np.linspace(-0.04, 0.04, 290)
    rng, placement = np.random.default_rng(0), true_placement()
    plates = [Profile(x, 0.149 + NOISE * rng.standard_normal(290)) for _ in range(11)]
    against = ReferenceProfile.from_profiles(plates[:10], [placement] * 10, NOISE)
    found = register(plates[10], against, placement)
    assert found is None or found.centre_sigma > 0.15e-3


def test_another_shape_is_refused() -> None:
    rng = np.random.default_rng(0)
    x = np.linspace(-0.04, 0.04, 290)
    dust = Profile(x, rng.uniform(0.1, 0.2, 290))
    assert register(dust, reference(), true_placement()) is None


@pytest.mark.parametrize("passes", [2, 4])
def test_profile_laid_on_its_own_place_is_at_the_bound_of_any_estimate(passes: int) -> None:
    """Truth of another make: Fisher's information of offset, height and roll from moved views."""
    model = SectionLaserModel(missing=0.0, step=0.0)
    section = hull_section(NEARLY_FILLED, 0.0, passes)
    before, after = (
        np.array(
            [
                cast_rays_on_section(section, pose, model)
                for pose in (
                    SectionLaserPose(offset=h),
                    SectionLaserPose(stand_off=0.149 + h),
                    SectionLaserPose(roll=h),
                )
            ]
        )
        for h in (-1e-5, 1e-5)
    )
    J = (after - before) / 2e-5
    centre = np.array((-1.0, 0.0, 0.149))  # how it moves with offset, height and roll
    bound = np.sqrt(centre @ np.linalg.inv(J @ J.T) @ centre) * NOISE
    against, rng = (
        reference(model, NEARLY_FILLED, passes=passes, of=100),
        np.random.default_rng(2),
    )
    found = [
        register(see(NEARLY_FILLED, rng, model, passes=passes), against, true_placement())
        for _ in range(150)
    ]
    kept = [one for one in found if one is not None]
    assert len(kept) == 150
    centres = np.array([one.centre for one in kept])
    # The reference's own error is shared by all of them.
    assert abs(np.mean(centres)) < 0.5 * bound
    assert np.std(centres) / bound == pytest.approx(1.0, abs=0.25)
    # What is stated allows for the change of the joint along the reference, too.
    assert 1.0 < np.median([one.centre_sigma for one in kept]) / bound < 1.5


@pytest.mark.parametrize("model", [DEFAULT, ARC_20], ids=["no arc", "20 % arc"])
@pytest.mark.parametrize(("before", "now"), [(1, 2), (2, 3), (3, 4)])
def test_bead_laid_since_does_not_move_the_joint(
    before: int, now: int, model: SectionLaserModel
) -> None:
    rng, errors, sigmas = np.random.default_rng(1), [], []
    for seed in range(10):
        against = reference(joint=NEARLY_FILLED, passes=before, seed=seed)
        for _ in range(10):
            offset = rng.uniform(-0.2e-3, 0.2e-3)
            profile = see(NEARLY_FILLED, rng, model, SectionLaserPose(offset=offset), passes=now)
            found = register(profile, against, true_placement())
            if found is not None:
                errors.append(found.centre + offset)
                sigmas.append(found.centre_sigma)
    assert len(errors) > 85
    assert abs(np.mean(errors)) < np.mean(sigmas)


@pytest.mark.parametrize(
    "other",
    [HullJoint(width=26e-3, opening_angle=0.9), HullJoint(width=36e-3)],
    ids=["narrower", "wider"],
)
def test_reference_of_another_joint_is_refused(other: HullJoint) -> None:
    against, rng = reference(joint=other, passes=0), np.random.default_rng(1)
    for _ in range(50):
        assert register(see(NEARLY_FILLED, rng, ARC_20), against, true_placement()) is None


@pytest.mark.parametrize("narrower", [0.5e-3, 1e-3, 2e-3, 4e-3])
@pytest.mark.parametrize("now", [3, 4])
def test_reference_of_a_joint_a_little_narrower_is_seldom_believed(
    narrower: float, now: int
) -> None:
    other = replace(NEARLY_FILLED, width=NEARLY_FILLED.width - narrower)
    against, rng = reference(joint=other, passes=3), np.random.default_rng(1)
    profiles = [see(NEARLY_FILLED, rng, ARC_20, passes=now) for _ in range(40)]
    estimated = [register(profile, against, true_placement()) for profile in profiles]
    assert sum(one is not None for one in estimated) <= 10


def test_joint_whose_edges_were_welded_over_since_is_refused() -> None:
    joint = HullJoint(beads=(*NEARLY_FILLED.beads, *CAPPED.beads))
    against, rng = reference(joint=joint, passes=4), np.random.default_rng(1)
    for _ in range(50):
        assert register(see(joint, rng, ARC_20), against, true_placement()) is None


@pytest.mark.parametrize(("crown", "left", "model"), [(5e-3, -0.1, ARC_20), (3e-3, -0.9, DEFAULT)])
def test_joint_with_a_bead_over_one_edge_is_where_the_other_edge_shows(
    crown: float, left: float, model: SectionLaserModel
) -> None:
    """The bead may also cover the other bevel but for its upper part."""
    beads = WeldBead(level=14e-3), WeldBead(level=20e-3, crown=crown, left=left, right=1.4)
    joint, rng = HullJoint(beads=beads), np.random.default_rng(1)
    against, errors, sigmas = reference(joint=joint, passes=1), [], []
    for _ in range(40):
        offset = rng.uniform(-0.2e-3, 0.2e-3)
        profile = see(joint, rng, model, SectionLaserPose(offset=offset), passes=2)
        if (found := register(profile, against, true_placement())) is not None:
            errors.append(found.centre + offset)
            sigmas.append(found.centre_sigma)
    assert len(errors) > 30
    assert np.abs(errors).max() < 5 * np.mean(sigmas)
    assert abs(np.mean(errors)) < np.mean(sigmas)


STANDS_OVER = WeldBead(level=20e-3, crown=3e-3, right=-0.1)
FALLS_GENTLY = WeldBead(level=20e-3, crown=-6e-3, right=1.9)


def flush(high_low: float, width: float = 30e-3, bead: WeldBead = STANDS_OVER) -> HullJoint:
    """A joint whose last bead ends at the left edge."""
    return HullJoint(width=width, high_low=high_low, beads=(WeldBead(level=14e-3), bead))


@pytest.mark.parametrize("bead", [STANDS_OVER, FALLS_GENTLY])
@pytest.mark.parametrize("high_low", [-1e-3, 0.0, 1e-3])
def test_bead_flush_with_an_edge_leaves_the_joint_where_the_other_edge_shows(
    high_low: float, bead: WeldBead
) -> None:
    """The joint closes meanwhile, by how much is not known, and either plate may move."""
    rng, errors, sigmas = np.random.default_rng(1), [], []
    for seed in range(60):
        against = reference(joint=flush(high_low, bead=bead), passes=1, seed=seed)
        closed = abs(UNKNOWN_CLOSING * rng.standard_normal())
        pose = SectionLaserPose(offset=rng.uniform(-0.2e-3, 0.2e-3))
        profile = see(flush(high_low, 30e-3 - closed, bead), rng, DEFAULT, pose, passes=2)
        if (found := register(profile, against, true_placement())) is not None:
            errors.append(found.centre + pose.offset)
            sigmas.append(found.centre_sigma)
    assert len(errors) > 55
    assert 0.5 < np.mean(np.divide(errors, sigmas) ** 2) < 2


@pytest.mark.parametrize("narrower", [2e-3, 3e-3, 4e-3])
@pytest.mark.parametrize("high_low", [-1e-3, 0.0, 1e-3])
def test_narrower_joint_beside_the_same_edge_is_no_bead_over_the_other(
    narrower: float, high_low: float
) -> None:
    """Its plate hides the other edge as a flush bead does, whichever plate is the higher one."""
    against, rng = reference(joint=flush(high_low), passes=1), np.random.default_rng(1)
    other = flush(high_low, 30e-3 - narrower)
    pose = SectionLaserPose(offset=-narrower / 2)
    for _ in range(20):
        assert register(see(other, rng, DEFAULT, pose, passes=1), against, true_placement()) is None


def test_one_side_does_not_show_the_joint_where_a_bead_ended() -> None:
    beads = WeldBead(level=14e-3), WeldBead(level=20e-3, crown=5e-3, left=-0.1, right=1.4)
    joint, rng = HullJoint(beads=beads), np.random.default_rng(1)
    against = reference(joint=joint, passes=1)
    changing = replace(against, noise=against.noise + 0.4e-3)
    profiles = [see(joint, rng, passes=2) for _ in range(20)]
    assert None not in [register(profile, against, true_placement()) for profile in profiles]
    assert {register(profile, changing, true_placement()) for profile in profiles} == {None}


def test_one_side_without_a_bevel_shows_nothing() -> None:
    against, rng = reference(), np.random.default_rng(1)
    for _ in range(10):
        seen = see(CAPPED, rng)
        hidden = replace(seen, z_s=np.where(seen.x_s < 0, seen.z_s - 4e-3, seen.z_s))
        assert register(hidden, against, true_placement()) is None


def test_error_that_placements_share_does_not_average_out() -> None:
    rng = np.random.default_rng(0)
    profiles = [see(CAPPED, rng) for _ in range(10)]
    placement = JointPlacement(
        centre=0.0, hull_z=0.149, roll=0.0, centre_sigma=0.05e-3, shared_sigma=0.03e-3
    )
    against = ReferenceProfile.from_profiles(profiles, [placement] * 10, NOISE)
    assert against.centre_sigma == pytest.approx(np.hypot(0.04e-3 / np.sqrt(10), 0.03e-3))
