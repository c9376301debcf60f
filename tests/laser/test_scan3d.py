"""From raw numbers to a profile, by GenICam's rules."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.errors import LaserFault, ProfileFormatRefused
from tjscan.laser.profile import Profile
from tjscan.laser.scan3d import COORDINATE_FORMATS, AxisScale, Scan3dScales, profile_of_row

STEP = 5e-6
SCALES = Scan3dScales(AxisScale(STEP, -0.16384), AxisScale(STEP), invalid=0)


def test_a_coordinate_is_its_raw_number_times_scale_plus_offset() -> None:
    raw = np.array([[32768, 40000], [0, 1], [65535, 65535]], dtype="<u2")
    profile = profile_of_row(raw.tobytes(), "Coord3D_AC16", SCALES)
    np.testing.assert_allclose(profile.x_s, [0.0, -0.16384, 32767 * STEP], atol=1e-12)
    np.testing.assert_allclose(profile.z_s, [0.2, STEP, 65535 * STEP], atol=1e-12)


def test_a_point_whose_z_is_the_invalid_number_is_missing_in_both_coordinates() -> None:
    raw = np.array([[0, 7], [7, 0]], dtype="<u2")
    profile = profile_of_row(raw.tobytes(), "Coord3D_AC16", SCALES)
    np.testing.assert_array_equal(profile.valid, [True, False])
    assert np.isnan(profile.x_s[1])


def test_numbers_that_are_none_are_missing_without_being_stated() -> None:
    raw = np.array([[1, 2], [np.nan, 2], [1, np.inf], [1, -np.inf]], dtype="<f4")
    scales = Scan3dScales(AxisScale(1e-3), AxisScale(1e-3))
    profile = profile_of_row(raw.tobytes(), "Coord3D_AC32f", scales)
    np.testing.assert_array_equal(profile.valid, [True, False, False, False])


def test_a_signalling_nan_is_missing_like_any_other() -> None:
    raw = np.array([0x7F800001, 0x3F800000], dtype="<u4").tobytes()
    profile = profile_of_row(raw, "Coord3D_AC32f", Scan3dScales(AxisScale(1e-3), AxisScale(1e-3)))
    assert not profile.valid.any()


def test_points_beyond_the_limits_of_the_axes_are_missing() -> None:
    scales = Scan3dScales(AxisScale(1e-3, 0.0, -10, 10), AxisScale(1e-3, 0.5, 190, 290))
    raw = np.array([[0, 200], [11, 200], [0, 189], [0, 291]], dtype="<f4")
    profile = profile_of_row(raw.tobytes(), "Coord3D_AC32f", scales)
    np.testing.assert_array_equal(profile.valid, [True, False, False, False])


@pytest.mark.parametrize("name", ["Coord3D_C16", "Coord3D_C32f", "Mono16"])
def test_where_points_state_no_x_it_follows_from_the_column(name: str) -> None:
    raw = np.array([10, 20, 30], dtype=COORDINATE_FORMATS[name].dtype)
    scales = Scan3dScales(AxisScale(2e-3, -2e-3), AxisScale(1e-3))
    profile = profile_of_row(raw.tobytes(), name, scales)
    np.testing.assert_allclose(profile.x_s, [-2e-3, 0.0, 2e-3])
    np.testing.assert_allclose(profile.z_s, [0.01, 0.02, 0.03])


def test_the_middle_one_of_three_coordinates_is_passed_over() -> None:
    raw = np.array([[1, 99, 3]], dtype="<f4")
    scales = Scan3dScales(AxisScale(1e-3), AxisScale(1e-3))
    profile = profile_of_row(raw.tobytes(), "Coord3D_ABC32f", scales)
    np.testing.assert_allclose([profile.x_s[0], profile.z_s[0]], [1e-3, 3e-3], rtol=1e-6)


@given(
    st.lists(st.tuples(st.integers(0, 65535), st.integers(0, 65535)), min_size=1, max_size=40),
    st.floats(1e-7, 1e-3),
    st.floats(-1, 1),
)
def test_flipping_an_axis_twice_changes_nothing_and_once_its_sign(
    pairs: list[tuple[int, int]], scale: float, offset: float
) -> None:
    raw = np.array(pairs, dtype="<u2").tobytes()
    axis = AxisScale(scale, offset, 300, 60_000)
    plain, once, twice = (
        profile_of_row(raw, "Coord3D_AC16", Scan3dScales(x, AxisScale(scale)))
        for x in (axis, axis.flipped_axis(), axis.flipped_axis().flipped_axis())
    )
    np.testing.assert_array_equal(once.x_s, -plain.x_s)
    np.testing.assert_array_equal(twice.x_s, plain.x_s)
    np.testing.assert_array_equal(once.z_s, plain.z_s)


@pytest.mark.parametrize(
    ("raw", "name"),
    [(b"", "Coord3D_AC16"), (b"123", "Coord3D_AC16"), (bytes(8), "Mono8"), (bytes(8), "")],
)
def test_what_is_no_row_of_points_is_refused(raw: bytes, name: str) -> None:
    with pytest.raises(ProfileFormatRefused):
        profile_of_row(raw, name, SCALES)


@given(
    st.binary(max_size=200),
    st.one_of(st.sampled_from(sorted(COORDINATE_FORMATS)), st.text(max_size=12)),
    st.tuples(*[st.floats()] * 4),
    st.one_of(st.none(), st.floats()),
)
def test_whatever_comes_is_a_profile_or_a_fault_of_the_laser(
    raw: bytes, name: str, numbers: tuple[float, ...], invalid: float | None
) -> None:
    scale_x, offset_x, scale_z, offset_z = numbers
    try:
        axes = AxisScale(scale_x, offset_x), AxisScale(scale_z, offset_z)
        profile = profile_of_row(raw, name, Scan3dScales(*axes, invalid))
    except LaserFault:
        return
    assert isinstance(profile, Profile)
    np.testing.assert_array_equal(np.isnan(profile.x_s), np.isnan(profile.z_s))
    assert np.isfinite(profile.points_s).all()
