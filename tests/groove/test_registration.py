"""A profile is laid on one taken before, as far as its shape tells where."""

import numpy as np
import pytest
from hull_views import ARC_20, CAPPED, DEFAULT, EXACT, see, true_placement
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.groove.registration import JointPlacement, ReferenceProfile, register_profile
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import SectionLaserModel, SectionLaserPose

NOISE = 0.06e-3


def reference(model: SectionLaserModel = DEFAULT) -> ReferenceProfile:
    rng = np.random.default_rng(9)
    profiles = [see(CAPPED, rng, model) for _ in range(10)]
    return ReferenceProfile.from_profiles(profiles, [true_placement()] * 10, NOISE)


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
