"""A simulated line laser over a section sees what plain geometry says."""

from math import cos, radians, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.frames import Array
from tjscan.joint.hull import HullJoint, WeldBead, hull_section
from tjscan.laser.section_laser import (
    LASER_STAND_OFF,
    SectionLaserModel,
    SectionLaserPose,
    cast_rays_on_section,
    section_in_sensor,
    simulate_section_profile,
)

JOINT = HullJoint(beads=(WeldBead(level=12e-3, crown=1e-3),))
MODEL = SectionLaserModel()
EXACT = SectionLaserModel(noise=0.0, step=0.0, missing=0.0)

offsets = st.floats(-8e-3, 8e-3)
rolls = st.floats(-0.1, 0.1)


def test_line_is_80_mm_wide_at_its_stand_off() -> None:
    plane = np.array([(-0.2, 0.0), (0.2, 0.0)])
    profile = simulate_section_profile(plane, SectionLaserPose(), EXACT, np.random.default_rng(0))
    assert len(profile) == 290
    assert np.ptp(profile.x_s) == pytest.approx(80e-3, abs=0.2e-3)
    np.testing.assert_allclose(profile.z_s, LASER_STAND_OFF)


@given(offset=offsets, roll=rolls, heading=st.floats(-0.3, 0.3))
def test_every_point_lies_on_the_section(offset: float, roll: float, heading: float) -> None:
    section = hull_section(JOINT, 0.0, passes=1)
    pose = SectionLaserPose(offset=offset, heading=heading, roll=roll)
    z = cast_rays_on_section(section, pose, EXACT)
    outline = section_in_sensor(section, pose)
    np.testing.assert_allclose(np.interp(z * EXACT.ray_slopes, *outline.T), z, atol=1e-9)


def test_the_first_of_two_faces_on_a_ray_is_seen() -> None:
    step = np.array([(-0.2, 0.02), (0.0, 0.02), (1e-7, 0.0), (0.2, 0.0)])
    pose = SectionLaserPose(offset=-0.03)  # from the high side the step hides what lies behind it
    z = cast_rays_on_section(step, pose, EXACT)
    x = z * EXACT.ray_slopes
    hidden = 0.03 / (LASER_STAND_OFF - 0.02) * LASER_STAND_OFF
    assert (z[x < 0.03 - 1e-6] < LASER_STAND_OFF - 0.019).all()
    assert x[z > LASER_STAND_OFF - 1e-6].min() >= hidden - 1e-6


@given(offset=offsets)
def test_offset_moves_the_joint_by_its_negative(offset: float) -> None:
    section = hull_section(JOINT, 0.0)
    moved = section_in_sensor(section, SectionLaserPose(offset=offset))
    np.testing.assert_allclose(
        moved - section_in_sensor(section, SectionLaserPose()),
        [(-offset, 0)] * len(section),
        atol=1e-15,
    )


def test_heading_widens_what_is_seen() -> None:
    section = hull_section(JOINT, 0.0)
    wide, narrow = (section_in_sensor(section, SectionLaserPose(heading=h)) for h in (0.3, 0.0))
    np.testing.assert_allclose(wide[:, 0] * cos(0.3), narrow[:, 0])


def test_roll_towards_the_right_brings_the_steel_there_nearer() -> None:
    plane = np.array([(-0.2, 0.0), (0.2, 0.0)])
    z = cast_rays_on_section(plane, SectionLaserPose(roll=radians(3)), EXACT)
    assert z[0] > z[-1]
    slope = np.polyfit(z * EXACT.ray_slopes, z, 1)[0]
    assert slope == pytest.approx(-tan(radians(3)))


@given(offset=offsets, roll=rolls)
def test_a_mirrored_scene_gives_the_mirrored_profile(offset: float, roll: float) -> None:
    section = hull_section(JOINT, 0.0, passes=1)
    z = cast_rays_on_section(section, SectionLaserPose(offset=offset, roll=roll), EXACT)
    mirrored = SectionLaserPose(offset=-offset, roll=-roll)
    other = cast_rays_on_section(section[::-1] * (-1, 1), mirrored, EXACT)
    np.testing.assert_allclose(z, other[::-1], atol=1e-12)


def take(model: SectionLaserModel, count: int = 100) -> tuple[Array, Array]:
    """z of many profiles of a plane, and of the same without faults, (count, n)."""
    plane = np.array([(-0.2, 0.0), (0.2, 0.0)])
    rng = np.random.default_rng(3)
    z = [simulate_section_profile(plane, SectionLaserPose(), model, rng).z_s for _ in range(count)]
    return np.array(z), np.full((count, model.columns), LASER_STAND_OFF)


def test_noise_moves_points_along_their_rays() -> None:
    rng = np.random.default_rng(0)
    profile = simulate_section_profile(
        hull_section(JOINT, 0.0), SectionLaserPose(), SectionLaserModel(step=0.0), rng
    )
    v = profile.valid
    np.testing.assert_allclose(profile.x_s[v] / profile.z_s[v], MODEL.ray_slopes[v])
    z, truth = take(SectionLaserModel(missing=0.0, step=0.0))
    assert np.std(z - truth) == pytest.approx(MODEL.noise, rel=0.02)


def test_arc_points_take_their_share_in_short_bursts() -> None:
    z, truth = take(SectionLaserModel(arc=0.4, missing=0.0))
    off = ~(np.abs(z - truth) < 6 * MODEL.noise)
    assert off.mean() == pytest.approx(0.4, abs=0.01)
    assert np.nanmax(np.abs(z - truth)) < 40.5e-3


def test_missing_columns_have_no_point() -> None:
    z, _ = take(SectionLaserModel(missing=0.1))
    assert np.isnan(z).mean() == pytest.approx(0.1, abs=0.005)


def test_the_same_seed_gives_the_same_profiles() -> None:
    np.testing.assert_array_equal(take(MODEL, 3)[0], take(MODEL, 3)[0])
