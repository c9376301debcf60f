"""Arm and laser both over the wire: the scan is that with the simulated laser, point by point."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cells import FAULTLESS, PAPER
from command import tjscan
from laser_cell import require_broadcasts
from ur_cell import address

from tjscan.scanning.recording import read_recorded_scan
from tjscan_loopback.process import LaserLoopbackProcess, UrLoopbackProcess

pytest.importorskip("rtde_control")
pytest.importorskip("viva_genicam")
require_broadcasts()

COUNT = 5e-6
"""Metres that one count of the laser's numbers is worth: at its limit, a number is either."""

SECTIONS = 3

NOISELESS = [
    f"--{key}={value}"
    for key, value in FAULTLESS.items()
    if ".laser." in key and "resolution" not in key
]
"""A profile that is lost on a busy machine is taken again, and chance would make it another."""


@pytest.fixture(scope="module")
def arm() -> Iterator[UrLoopbackProcess]:
    # At its true speed: what is known 10 us late of a fast one is another profile.
    with UrLoopbackProcess(address()) as process:
        yield process


@pytest.fixture(scope="module")
def laser(arm: UrLoopbackProcess) -> Iterator[LaserLoopbackProcess]:
    with LaserLoopbackProcess(address(), str(PAPER), *NOISELESS, "--arm", arm.host) as process:
        yield process


def scan(arm: UrLoopbackProcess, run: Path, *options: str) -> int:
    arm.schedule_fault("clear")
    arm.schedule_fault("home")
    real = ("--arm.driver", "ur", "--arm.ur.host", arm.host)
    return tjscan("scan", PAPER, "--out", run, f"--scan.sections={SECTIONS}", *real, *options)


def over_the_wire(laser: LaserLoopbackProcess) -> tuple[str, ...]:
    return ("--laser.driver", "genicam", "--laser.genicam.address", laser.host)


def test_the_scan_is_the_same_as_with_the_simulated_laser(
    arm: UrLoopbackProcess, laser: LaserLoopbackProcess, tmp_path: Path
) -> None:
    assert scan(arm, tmp_path / "simulated", *NOISELESS) == 0
    assert scan(arm, tmp_path / "wire", *NOISELESS, *over_the_wire(laser)) == 0
    one, other = (read_recorded_scan(tmp_path / name) for name in ("simulated", "wire"))
    assert len(one.views) == len(other.views) > SECTIONS
    for a, b in zip(one.views, other.views, strict=True):
        np.testing.assert_array_equal(a.profile.valid, b.profile.valid)
        np.testing.assert_allclose(a.profile.x_s, b.profile.x_s, atol=1.01 * COUNT)
        np.testing.assert_allclose(a.profile.z_s, b.profile.z_s, atol=1.01 * COUNT)
        assert b.profile.time >= b.time  # exposed after the arm had come to rest
        assert b.profile.time_uncertainty > 0
    assert {"arm", "laser"} <= {event.name for event in other.events}


def test_a_laser_that_fails_on_the_way_ends_the_scan_and_it_can_be_resumed(
    arm: UrLoopbackProcess, laser: LaserLoopbackProcess, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    laser.schedule_fault("stale")
    quick = ("--laser.genicam.timeout_ms", "5000", "--laser.genicam.attempts", "1")
    assert scan(arm, run, *over_the_wire(laser), *quick) == 4
    laser.schedule_fault("clear")
    assert tjscan("scan", "--resume", run) == 0
    assert json.loads((run / "summary.json").read_text(encoding="utf-8"))["complete"]


def test_the_doctor_reports_the_laser_and_its_range(
    arm: UrLoopbackProcess, laser: LaserLoopbackProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    arm.schedule_fault("home")
    real = ("--arm.driver", "ur", "--arm.ur.host", arm.host, *over_the_wire(laser))
    assert tjscan("doctor", PAPER, "--json", *real) == 0
    findings = {row["what"]: row for row in json.loads(capsys.readouterr().out)}
    assert "packets of at most 1500 bytes" in findings["laser's link"]["detail"]
    assert 'serial = "1"' in findings["laser's link"]["detail"]
    assert "Coord3D_AC16" in findings["laser's format"]["detail"]
    assert "190 to 290 mm" in findings["laser's range"]["detail"]
    assert tjscan("doctor", PAPER, "--json", *real, "--laser.far_mm", "400") == 2
    findings = {row["what"]: row for row in json.loads(capsys.readouterr().out)}
    assert "flip_z" in findings["laser's range"]["detail"]
