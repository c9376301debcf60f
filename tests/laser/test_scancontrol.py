"""scanCONTROL's payloads, on bytes that are made from the maker's specification."""

from __future__ import annotations

from dataclasses import replace
from struct import pack
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tjscan.core.errors import LaserFault, LaserStampsRefused, ProfileFormatRefused
from tjscan.laser.genicam.gige import ScanControlLaser
from tjscan.laser.genicam.messages import StampedBlock
from tjscan.laser.genicam.settings import ScanControlSettings
from tjscan.laser.profile import Profile
from tjscan.laser.scancontrol import (
    CONTAINER_FIELD_WORDS,
    middle_of_shutter,
    parse_scancontrol,
    scancontrol_profile_size,
)

OFFSET_SECONDS = 1 / (8000 * 3072)

POINT_COUNTS = (80, 160, 320, 640)
"""How many points a profile may have."""


def settings(**stated: Any) -> ScanControlSettings:
    return ScanControlSettings(serial="1", model="2600-100", **stated)


def clock_word(seconds: float) -> int:
    """A time as the specification compounds it: seconds, cycles of 1/8000, offsets of 1/3072."""
    offsets = round(seconds / OFFSET_SECONDS)
    cycles, offset = divmod(offsets, 3072)
    whole, cycle = divmod(cycles, 8000)
    return whole % 128 << 25 | cycle << 12 | offset


def time_stamp(count: int, opened: float, closed: float, edges: int = 0) -> bytes:
    return pack(">IIHHI", 0b10 << 30 | count, clock_word(opened), edges, 0, clock_word(closed))


def reflection(
    x: int, z: int, *, width: int = 9, intensity: int = 700, threshold: int = 3
) -> bytes:
    first = width << 20 | intensity << 10 | threshold
    return pack(">IHHII", first, x, z, 123_456, 654_321)


def full_profile(pairs: list[tuple[int, int]], stamp: bytes) -> bytes:
    """Each point with its first reflection, and none in the three others."""
    nothing = reflection(0, 0)
    whole = b"".join(reflection(x, z) + 3 * nothing for x, z in pairs)
    return whole[:-16] + stamp


def raw_numbers(points: int) -> list[tuple[int, int]]:
    random = np.random.default_rng(1)
    pairs = random.integers(1, 65536, (points, 2)).tolist()
    pairs[3] = [17, 0]
    return [(x, z) for x, z in pairs]


def assert_is(profile: Profile, pairs: list[tuple[int, int]]) -> None:
    """The documents' formula: (raw - 32768) * scale, and the offset for z; raw z 0 is no point."""
    for i, (x, z) in enumerate(pairs):
        if z == 0:
            assert np.isnan(profile.x_s[i])
            assert np.isnan(profile.z_s[i])
        else:
            assert 1e3 * profile.x_s[i] == pytest.approx((x - 32768) * 0.005, abs=1e-9)
            assert 1e3 * profile.z_s[i] == pytest.approx((z - 32768) * 0.005 + 250, abs=1e-9)


@pytest.mark.parametrize("points", POINT_COUNTS)
def test_a_full_profile_is_read_as_the_specification_has_it(points: int) -> None:
    pairs = raw_numbers(points)
    raw = full_profile(pairs, time_stamp(77, 12.5, 12.501))
    assert len(raw) == 64 * points
    profile = parse_scancontrol(raw, settings(points=points))
    assert_is(profile, pairs)


def test_the_time_stamp_takes_the_place_of_the_last_reflection_of_the_last_point_alone() -> None:
    raw = full_profile(raw_numbers(80), time_stamp(1, 1.0, 1.1))
    first = parse_scancontrol(raw, settings(points=80))
    fourth = parse_scancontrol(raw, settings(points=80, reflection=4))
    assert first.valid[-1]
    assert not fourth.valid.any()


@pytest.mark.parametrize("little", [False, True])
@pytest.mark.parametrize("fields", [("z", "x"), tuple(CONTAINER_FIELD_WORDS)])
def test_a_container_is_read_field_by_field(little: bool, fields: tuple[str, ...]) -> None:
    pairs, order = raw_numbers(160), "<" if little else ">"
    values = {"x": [x for x, _ in pairs], "z": [z for _, z in pairs]}
    row = b"".join(
        pack(
            f"{order}{160 * CONTAINER_FIELD_WORDS[name]}H",
            *values.get(name, [9] * 160 * CONTAINER_FIELD_WORDS[name]),
        )
        for name in fields
    )
    stamped = row + bytes(2 * 160 - 16) + time_stamp(5, 127.9999, 0.0004, edges=8)
    layout = settings(layout="container", points=160, fields=fields, little_endian=little)
    for raw in (stamped, 3 * stamped):
        assert_is(parse_scancontrol(raw, layout), pairs)
    assert_is(parse_scancontrol(row, replace(layout, time_stamp=False)), pairs)


def test_a_turned_axis_counts_from_the_other_end_and_zero_is_still_no_point() -> None:
    pairs = raw_numbers(80)
    raw = full_profile(pairs, time_stamp(1, 1.0, 1.1))
    turned = settings(points=80, flip_x=True, flip_z=True)
    profile = parse_scancontrol(raw, turned)
    assert_is(profile, [(65535 - x, 65535 - z if z else 0) for x, z in pairs])


@pytest.mark.parametrize("word", [8000 << 12, 3072])
@pytest.mark.parametrize("place", [4, 12])
def test_a_time_stamp_that_counts_further_than_the_clock_is_refused(place: int, word: int) -> None:
    stamp = bytearray(time_stamp(1, 1.0, 1.1))
    stamp[place : place + 4] = word.to_bytes(4, "big")
    raw = full_profile(raw_numbers(80), bytes(stamp))
    with pytest.raises(ProfileFormatRefused, match="another layout"):
        parse_scancontrol(raw, settings(points=80))


def test_payloads_of_another_size_are_refused() -> None:
    raw = full_profile(raw_numbers(80), time_stamp(1, 1.0, 1.1))
    with pytest.raises(ProfileFormatRefused, match="160 points"):
        parse_scancontrol(raw[:-1], settings(points=160))
    with pytest.raises(ProfileFormatRefused):
        parse_scancontrol(b"", settings())


@given(st.data())
def test_whatever_comes_is_a_profile_or_a_fault_of_the_laser(data: st.DataObject) -> None:
    layout = settings(
        layout=data.draw(st.sampled_from(["full", "container"])),
        points=data.draw(st.sampled_from(POINT_COUNTS[:2])),
        reflection=data.draw(st.integers(1, 4)),
        time_stamp=data.draw(st.booleans()),
        little_endian=data.draw(st.booleans()),
    )
    rest = data.draw(st.binary(max_size=80))
    raw = bytes(data.draw(st.integers(0, 1)) * scancontrol_profile_size(layout))
    at = data.draw(st.integers(0, max(len(raw), 1)))
    raw = data.draw(st.sampled_from([raw + rest, raw[:at] + rest + raw[at + len(rest) :]]))
    try:
        profile = parse_scancontrol(raw, layout)
    except LaserFault:
        return
    assert len(profile) == layout.points
    assert np.isfinite(profile.points_s).all()


@given(opened=st.floats(0, 127.99), exposure=st.floats(1e-5, 1e-2))
def test_the_middle_of_the_shutter_is_told_also_where_the_clock_begins_again(
    opened: float, exposure: float
) -> None:
    raw = full_profile(raw_numbers(80), time_stamp(7, opened, opened + exposure))
    off = (middle_of_shutter(raw) - opened - exposure / 2 + 64.0) % 128.0 - 64.0
    assert abs(off) <= OFFSET_SECONDS


def streamed(raw: bytes, number: int) -> StampedBlock:
    return StampedBlock(raw, "Mono8", 0, 0, number=number, ticks=0, came=0.0)


def test_times_of_a_stream_rise_on_where_the_clock_begins_again() -> None:
    laser = ScanControlLaser(settings(points=80), float)
    true = np.arange(120.0, 400.0, 1.7)
    times = [
        laser._time_of_stamp(streamed(full_profile(raw_numbers(80), time_stamp(k, t, t + 1e-3)), k))
        for k, t in enumerate(true)
    ]
    np.testing.assert_allclose(np.diff(times), 1.7, atol=2 * OFFSET_SECONDS)


def test_what_tells_no_time_of_each_profile_is_refused_for_a_stream() -> None:
    laser = ScanControlLaser(settings(points=80), float)
    two = 2 * full_profile(raw_numbers(80), time_stamp(1, 1.0, 1.001))
    with pytest.raises(LaserStampsRefused, match="several"):
        laser._time_of_stamp(streamed(two, 1))
