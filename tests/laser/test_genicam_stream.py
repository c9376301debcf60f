"""Laws of a stream of profiles from GenICam lasers, against the loopback laser."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
import pytest
from laser_cell import laser_at, loopback_laser, require_broadcasts, write_groove_profiles

from tjscan.core.errors import (
    LaserFault,
    LaserInUse,
    LaserNotResponding,
    LaserStampsRefused,
    ProfileFormatRefused,
)
from tjscan.core.frames import Array
from tjscan.laser.genicam.gige import GenicamLaser
from tjscan.laser.line_laser import StreamedProfile, StreamingLaser
from tjscan_loopback.process import LaserLoopbackProcess

pytest.importorskip("viva_genicam")
require_broadcasts()

PERIOD = 0.005
AHEAD, PPM = 900.0, 150.0
"""Seconds by which the laser's clock is ahead of this machine's, and how much faster it runs."""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LaserLoopbackProcess]:
    file = write_groove_profiles(tmp_path_factory.mktemp("profiles") / "groove.csv")
    with loopback_laser(file, "--clock", str(AHEAD), str(PPM)) as laser:
        yield laser


@pytest.fixture
def loopback(running: LaserLoopbackProcess) -> LaserLoopbackProcess:
    running.schedule_fault("clear")
    return running


def host_time(stamp: float) -> float:
    """The moment on this machine's clock of a stamp of the loopback laser."""
    return (stamp - AHEAD) / (1 + 1e-6 * PPM)


def assert_are_periods(times: Sequence[float] | Array) -> None:
    """Times of profiles one after another; a busy machine leaves out some."""
    gone = np.diff(times) / PERIOD
    assert gone.min() > 1 - 1e-4
    assert np.median(gone) == pytest.approx(1.0, abs=1e-6)


def take(laser: GenicamLaser, count: int) -> list[StreamedProfile]:
    return list(islice((one for one in laser.stream(PERIOD) if one is not None), count))


def test_a_stream_has_the_time_in_the_middle_of_each_exposure(
    loopback: LaserLoopbackProcess,
) -> None:
    with laser_at(loopback.host, exposure_us=4000.0) as laser:
        assert isinstance(laser, StreamingLaser)
        laser.check_stream(PERIOD)
        began = time.monotonic()
        taken = take(laser, 200)
        ended = time.monotonic()
        times = np.array([host_time(one.profile.time) for one in taken])
        assert_are_periods(times)
        assert began < times[0]
        assert times[-1] < ended - 0.5 * 4e-3 + 1e-4  # it came when the exposure had ended
        assert min(one.waited for one in taken) < 2e-3
        assert laser.capture().valid.any()  # by trigger, as before


def test_profiles_wait_in_order_while_the_program_is_busy(loopback: LaserLoopbackProcess) -> None:
    with laser_at(loopback.host) as laser:
        stream = laser.stream(PERIOD)
        first = next(one for one in stream if one is not None)
        time.sleep(2.0)
        later = list(islice((one for one in stream if one is not None), 350))
        stamps = [host_time(one.profile.time) for one in (first, *later)]
        assert_are_periods(stamps)
        waited = [one.waited for one in later]
        assert 1.5 < waited[0] < 2.5
        now = time.monotonic()  # what has waited, came so long ago
        assert now - waited[-1] - stamps[-1] < 0.1


def test_a_lost_profile_is_none(loopback: LaserLoopbackProcess) -> None:
    with laser_at(loopback.host) as laser:
        stream = laser.stream(PERIOD)
        next(one for one in stream if one is not None)
        loopback.schedule_fault("loss 20")
        taken = list(islice(stream, 300))
        stamps = [host_time(one.profile.time) for one in taken if one is not None]
        lost = np.rint(np.diff(stamps) / PERIOD) - 1
        assert lost.sum() > 10
        assert lost.min() == 0  # in order
        assert taken.count(None) >= lost.sum()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("no-clock", "can't be read"),
        ("coarse-clock", r"\d0 ms at a time"),
        ("wrong-clock", "1,000,000,000 a second"),
    ],
)
def test_a_clock_that_is_none_is_refused_before_the_stream(
    loopback: LaserLoopbackProcess, fault: str, words: str
) -> None:
    loopback.schedule_fault(fault)
    with (
        laser_at(loopback.host) as laser,
        pytest.raises(LaserStampsRefused, match=words) as caught,
    ):
        laser.check_stream(PERIOD)
    assert "stepwise" in str(caught.value)


def test_profiles_without_a_stamp_are_refused(loopback: LaserLoopbackProcess) -> None:
    loopback.schedule_fault("no-stamp")
    with laser_at(loopback.host) as laser, pytest.raises(LaserStampsRefused, match="is 0"):
        take(laser, 1)


def test_what_a_stream_needs_is_refused_by_name(loopback: LaserLoopbackProcess) -> None:
    with laser_at(loopback.host, rows=4) as laser, pytest.raises(LaserStampsRefused, match="rows"):
        laser.check_stream(PERIOD)
    with laser_at(loopback.host) as laser, pytest.raises(LaserStampsRefused, match="2000"):
        laser.check_stream(1e-5)
    with pytest.raises(LaserFault, match="with"):
        laser_at(loopback.host).check_stream(PERIOD)


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("silent", LaserNotResponding),
        ("taken", LaserInUse),
        ("reboot", LaserNotResponding),
        ("wrong-format", ProfileFormatRefused),
    ],
)
def test_a_stream_that_ends_says_why(
    loopback: LaserLoopbackProcess, fault: str, error: type[LaserFault]
) -> None:
    with laser_at(loopback.host) as laser:
        stream = laser.stream(PERIOD)
        next(stream)
        loopback.schedule_fault(fault)
        start = time.monotonic()
        with pytest.raises(error):
            for _ in stream:
                pass
        assert time.monotonic() - start < 10.0


def test_a_stream_that_was_left_is_ended_by_what_comes_next(loopback: LaserLoopbackProcess) -> None:
    with laser_at(loopback.host) as laser:
        left = laser.stream(PERIOD)
        next(left)
        assert laser.capture().valid.any()
        again = laser.stream(PERIOD)
        next(again)
        left.close()  # type: ignore[attr-defined]
        assert [one for one in islice(again, 20) if one is not None]


@pytest.mark.parametrize(
    ("fault", "words"),
    [("narrow", "320 points"), ("new-offset", "Scan3d"), ("new-exposure", "ExposureTime")],
)
def test_what_changes_in_a_stream_is_noticed(
    loopback: LaserLoopbackProcess, fault: str, words: str
) -> None:
    with laser_at(loopback.host) as laser:
        stream = laser.stream(PERIOD)
        next(stream)
        loopback.schedule_fault(fault)
        start = time.monotonic()
        with pytest.raises(LaserFault, match=words):
            for _ in stream:
                pass
        assert time.monotonic() - start < 5.0
