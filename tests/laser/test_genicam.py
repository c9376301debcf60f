"""The driver of GenICam lasers, through the real client library, against the loopback laser."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cells import PAPER
from laser_cell import laser_at, loopback_laser, require_broadcasts, write_groove_profiles

from tjscan.core.config import validate_table
from tjscan.core.errors import (
    ConfigurationError,
    LaserFault,
    LaserInUse,
    LaserNotConnected,
    LaserNotResponding,
    ProfileFormatRefused,
    ProfileNotReceived,
    ProfileStale,
    WrongLaser,
)
from tjscan.job.files import read_scan_job
from tjscan.laser.genicam.gige import RETRIGGERED_PROFILE_EVENT, ScanControlLaser
from tjscan.laser.genicam.settings import ScanControlSettings
from tjscan.laser.scan3d import COORDINATE_FORMATS
from tjscan_loopback.process import LaserLoopbackProcess

pytest.importorskip("viva_genicam")
require_broadcasts()

LONGEST = 5.0
"""Seconds within which every fault has its error."""

HALF_COUNT = 2.51e-6
"""Metres: formats of 16 bits round to it, and those of 32 bits to less than 10 nm."""

QUICK = {"timeout_ms": 500.0, "attempts": 2}
"""Long enough for a busy machine, and short for faults that time out."""


@pytest.fixture(scope="module")
def profiles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of profiles of a groove."""
    return write_groove_profiles(tmp_path_factory.mktemp("profiles") / "groove.csv")


@pytest.fixture(scope="module")
def running(profiles: Path) -> Iterator[LaserLoopbackProcess]:
    """A laser that stays for all tests of this module."""
    with loopback_laser(profiles) as laser:
        yield laser


@pytest.fixture
def loopback(running: LaserLoopbackProcess) -> Iterator[LaserLoopbackProcess]:
    """That laser, all right; the driver leaves neither a process nor an open file behind."""
    running.schedule_fault("clear")
    before = left_behind()
    yield running
    assert left_behind() == before


def left_behind() -> tuple[int, int, int]:
    """Open files, threads and child processes of this process."""
    children = Path("/proc/self/task").glob("*/children")
    clients = [pid for file in children for pid in file.read_text(encoding="ascii").split()]
    files = list(Path("/proc/self/fd").iterdir())
    return len(files), threading.active_count(), len(clients)


def test_a_profile_is_that_of_the_sensor_and_says_when_it_was_exposed(
    loopback: LaserLoopbackProcess,
) -> None:
    with laser_at(loopback.host) as laser:
        assert str(laser.identity).startswith("tjscan laser-loopback, serial number 1")
        for _ in range(3):
            before = time.monotonic()
            profile = laser.capture()
            after = time.monotonic()
            assert len(profile) == 640
            assert 300 < profile.valid.sum() < 640
            assert ((profile.z_s[profile.valid] > 0.19) & (profile.z_s[profile.valid] < 0.29)).all()
            assert 0 < profile.time_uncertainty < after - before
            assert before <= profile.time <= after + profile.time_uncertainty


def test_each_acquisition_begins_with_the_same_profiles(loopback: LaserLoopbackProcess) -> None:
    taken = []
    for _ in range(2):
        with laser_at(loopback.host) as laser:
            taken.append([laser.capture() for _ in range(3)])
    for one, other in zip(*taken, strict=True):
        np.testing.assert_array_equal(one.z_s, other.z_s)
    assert not np.array_equal(taken[0][0].z_s, taken[0][1].z_s, equal_nan=True)


@pytest.mark.parametrize("name", sorted(set(COORDINATE_FORMATS) - {"Mono16"}))
def test_any_format_gives_the_same_surface(loopback: LaserLoopbackProcess, name: str) -> None:
    with laser_at(loopback.host) as laser:
        true = laser.capture()
    with laser_at(loopback.host, pixel_format=name) as laser:
        profile = laser.capture()
    if COORDINATE_FORMATS[name].has_x:
        np.testing.assert_allclose(profile.x_s, true.x_s, atol=HALF_COUNT)
        np.testing.assert_allclose(profile.z_s, true.z_s, atol=HALF_COUNT)
    else:
        assert profile.valid.sum() > 200


def test_a_job_may_state_what_the_numbers_mean_and_which_way_the_axes_point(
    loopback: LaserLoopbackProcess,
) -> None:
    with laser_at(loopback.host) as laser:
        true = laser.capture()
    stated = {"scale_mm": [0.005, 0.005], "offset_mm": [-163.84, 0.0], "invalid": 0.0}
    loopback.schedule_fault("missing-features")
    with laser_at(loopback.host, flip_x=True, **stated) as laser:
        profile = laser.capture()
    np.testing.assert_allclose(profile.x_s, -true.x_s, atol=1e-12)
    np.testing.assert_allclose(profile.z_s, true.z_s, atol=1e-12)


def test_features_are_set_by_name_and_a_wrong_one_is_refused(
    loopback: LaserLoopbackProcess,
) -> None:
    with laser_at(loopback.host, features={"ExposureTime": 250.0}) as laser:
        assert laser.connected.exposure == pytest.approx(250e-6)
    with laser_at(loopback.host, exposure_us=500.0, rows=4) as laser:
        assert laser.connected.exposure == pytest.approx(500e-6)
        assert len(laser.capture()) == 640
    with (
        pytest.raises(ProfileFormatRefused, match="NoSuchFeature"),
        laser_at(loopback.host, features={"NoSuchFeature": 1}),
    ):
        pass


def test_a_laser_that_runs_free_gives_what_was_exposed_after_the_call(
    loopback: LaserLoopbackProcess,
) -> None:
    with laser_at(loopback.host, trigger="fresh", features={"AcquisitionFrameRate": 50.0}) as laser:
        for _ in range(5):
            before = time.monotonic()
            profile = laser.capture()
            assert profile.time + profile.time_uncertainty >= before


def test_a_laser_is_found_by_its_serial_number(
    loopback: LaserLoopbackProcess, profiles: Path
) -> None:
    with (
        loopback_laser(profiles, "--serial", "A-17") as other,
        laser_at("", address=None, serial="A-17") as laser,
    ):
        assert laser.connected.address == other.host
        assert laser.identity.serial == "A-17"


def test_lost_packets_are_made_up_for(loopback: LaserLoopbackProcess) -> None:
    events: list[str] = []
    with laser_at(loopback.host) as laser:
        true = laser.capture()
    with laser_at(loopback.host) as laser:
        laser.report_events_to(lambda name, detail: events.append(name))
        loopback.schedule_fault("loss 5")
        taken = [laser.capture() for _ in range(40)]
    assert set(events) <= {RETRIGGERED_PROFILE_EVENT}
    first = taken[0]
    assert first.valid.sum() > 300
    both = first.valid & true.valid
    assert np.abs(first.z_s - true.z_s)[both].max() < 1e-3


@pytest.mark.parametrize("fault", ["duplicate", "reorder", "late", "buffered", "all-invalid"])
def test_what_harms_no_profile_is_no_error(loopback: LaserLoopbackProcess, fault: str) -> None:
    with laser_at(loopback.host) as laser:
        loopback.schedule_fault(fault)
        profiles = [laser.capture() for _ in range(2)]
    for profile in profiles:
        assert profile.valid.any() == (fault != "all-invalid")


ENDS_IN = {
    "lose-leader": ProfileNotReceived,
    "lose-trailer": ProfileNotReceived,
    "loss 100": ProfileNotReceived,
    "stale": ProfileStale,
    "taken": LaserInUse,
    "wrong-format": ProfileFormatRefused,
    "silent": LaserNotResponding,
}


@pytest.mark.parametrize("fault", ENDS_IN)
def test_a_fault_ends_in_its_error(loopback: LaserLoopbackProcess, fault: str) -> None:
    with laser_at(loopback.host, **QUICK) as laser:
        laser.capture()
        loopback.schedule_fault(fault)
        start = time.monotonic()
        with pytest.raises(LaserFault) as caught:
            laser.capture()
        assert type(caught.value) is ENDS_IN[fault]
        assert time.monotonic() - start < LONGEST


@pytest.mark.parametrize("fault", ["unit-pixel", "missing-features"])
def test_numbers_that_are_no_lengths_are_refused(
    loopback: LaserLoopbackProcess, fault: str
) -> None:
    loopback.schedule_fault(fault)
    with pytest.raises(ProfileFormatRefused, match="scale_mm"), laser_at(loopback.host):
        pass


def test_uncalibrated_output_is_refused(loopback: LaserLoopbackProcess) -> None:
    features = {"Scan3dOutputMode": "UncalibratedC"}
    with (
        pytest.raises(ProfileFormatRefused, match="no lengths"),
        laser_at(loopback.host, features=features),
    ):
        pass


def test_another_laser_than_the_job_is_for_is_refused(loopback: LaserLoopbackProcess) -> None:
    with pytest.raises(WrongLaser, match="serial number 2"), laser_at(loopback.host, serial="2"):
        pass


def test_a_laser_that_was_exchanged_meanwhile_is_refused(profiles: Path) -> None:
    with loopback_laser(profiles) as loopback:
        laser = laser_at(loopback.host, **QUICK)
        with laser:
            laser.capture()
            loopback.schedule_fault("reboot")
            with pytest.raises(LaserNotResponding):
                laser.capture()
        with pytest.raises(WrongLaser, match="before"), laser:
            pass


def test_two_programs_can_not_have_one_laser(loopback: LaserLoopbackProcess) -> None:
    with (
        laser_at(loopback.host),
        pytest.raises(LaserInUse),
        laser_at(loopback.host),
    ):
        pass


def test_nobody_at_the_address_is_said_at_once() -> None:
    with pytest.raises(LaserNotConnected, match=r"127\.0\.0\.99"), laser_at("127.0.0.99"):
        pass


def test_a_laser_that_is_not_connected_takes_no_profile() -> None:
    with pytest.raises(LaserFault, match="with"):
        laser_at("127.0.0.99").capture()


def test_a_job_names_the_laser_and_its_calibration_holds_for_that_one() -> None:
    keys = {"laser.driver": "genicam", "arm.driver": "ur", "arm.ur": {"host": "10.0.0.2"}}
    job = read_scan_job(PAPER, keys | {"laser.genicam": {"address": "10.0.0.7", "serial": "77"}})
    assert job.laser.device_id == "genicam 77"
    with pytest.raises(ConfigurationError, match="address or serial"):
        read_scan_job(PAPER, keys | {"laser.genicam": {"rows": 1}})
    with pytest.raises(ConfigurationError, match=r"laser\.genicam"):
        read_scan_job(PAPER, keys)


def test_a_scancontrol_has_the_same_transport_and_a_payload_of_its_own(
    loopback: LaserLoopbackProcess,
) -> None:
    """The loopback sends another payload, which is refused: triggers, freshness and names work."""
    table = {"address": loopback.host, "model": "2600-100", "registers": {"0xA024": 1}}
    with ScanControlLaser(validate_table(ScanControlSettings, table), time.monotonic) as laser:
        assert laser.identity.serial == "1"
        described = laser.describe()
        assert (described.near, described.far) == pytest.approx((0.0862, 0.4138), abs=1e-4)
        with pytest.raises(ProfileFormatRefused, match=r"laser\.scancontrol"):
            laser.capture()


@pytest.mark.parametrize(
    ("table", "hint"),
    [
        ({}, "address or serial"),
        ({"address": "10.0.0.7"}, "either model"),
        ({"address": "10.0.0.7", "model": "2600-100", "scale_mm": 0.005}, "either model"),
        ({"address": "10.0.0.7", "model": "2900-50"}, "2600-100"),
        ({"address": "10.0.0.7", "model": "2600-50", "fields": ["z"]}, "fields"),
        ({"address": "10.0.0.7", "model": "2600-50", "registers": {"f0": 1}}, "0xf0f0081c"),
        ({"address": "10.0.0.7", "model": "2600-50", "points": 100}, "80"),
    ],
)
def test_what_a_scancontrol_needs_is_said(table: dict[str, object], hint: str) -> None:
    with pytest.raises(ConfigurationError, match=hint):
        validate_table(ScanControlSettings, table)


def test_a_row_that_is_narrower_than_stated_is_refused(loopback: LaserLoopbackProcess) -> None:
    with laser_at(loopback.host, **QUICK) as laser:
        laser.capture()
        loopback.schedule_fault("narrow")
        with pytest.raises(ProfileFormatRefused, match=r"320 points.*640"):
            laser.capture()


def test_an_offset_that_changes_from_profile_to_profile_is_that_of_each(
    loopback: LaserLoopbackProcess,
) -> None:
    with laser_at(loopback.host, **QUICK) as laser:
        before = laser.capture()
    with laser_at(loopback.host, **QUICK) as laser:
        loopback.schedule_fault("new-offset")
        after = laser.capture()
    np.testing.assert_allclose(after.z_s, before.z_s, atol=2 * HALF_COUNT)


def test_a_laser_without_a_trigger_by_software_is_told_what_to_set(
    loopback: LaserLoopbackProcess,
) -> None:
    loopback.schedule_fault("no-trigger")
    with (
        pytest.raises(ProfileFormatRefused, match='trigger = "fresh"'),
        laser_at(loopback.host, **QUICK),
    ):
        pass
    with laser_at(loopback.host, trigger="fresh", **QUICK) as laser:
        assert laser.capture().valid.any()


def test_a_laser_whose_port_is_closed_in_a_run_does_not_respond(profiles: Path) -> None:
    with loopback_laser(profiles) as loopback:
        laser = laser_at(loopback.host, **QUICK)
        with laser:
            laser.capture()
            loopback._end()
            with pytest.raises(LaserNotResponding):
                laser.capture()


def test_a_laser_says_how_its_clock_counts(loopback: LaserLoopbackProcess) -> None:
    with laser_at(loopback.host) as laser:
        assert "1,000,000,000 ticks a second" in laser.describe().link
