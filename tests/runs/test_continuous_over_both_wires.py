"""A continuous scan with arm and laser both over the wire, each with a clock of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cells import FAULTLESS, PAPER
from laser_cell import require_broadcasts
from ur_cell import address

from tjscan.result.summary import read_summary
from tjscan.scanning.recording import read_views
from tjscan.scanning.section import Substep
from tjscan_loopback.process import LaserLoopbackProcess, UrLoopbackProcess

pytest.importorskip("rtde_control")
pytest.importorskip("viva_genicam")
require_broadcasts()

LENGTH, SPACING = 20.0, 2.0
"""Millimetres beyond the second taught pose, and between sections."""

EXPOSURE_US, RATE = 2000.0, 25.0
LASER_CLOCK, ARM_CLOCK = (5000.0, -80.0), (900.0, 60.0)
"""Seconds ahead, and how fast they run, ppm."""

POINTS = ("--laser.points", "320")  # a busy machine simulates as many

SLOW_TIME = Path(__file__).parents[1] / "support/slow_time"
"""Arm, laser and scan have four times as long for the same."""


def test_the_groove_is_measured_where_it_is_with_clocks_that_drift_and_profiles_that_are_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(SLOW_TIME))
    simulated = [*(f"--{k}={v}" for k, v in FAULTLESS.items()), *POINTS]
    clock = [str(number) for number in ARM_CLOCK]
    with (
        UrLoopbackProcess(address(), "--hz", "125", "--clock", *clock) as arm,
        LaserLoopbackProcess(
            *(address(), str(PAPER), "--arm", arm.host, *simulated),
            *("--simulation.laser.noise_mm=0.01", "--clock", *map(str, LASER_CLOCK)),
        ) as laser,
    ):
        laser.schedule_fault("loss 0.5")
        options = (
            *("scan", PAPER, "--out", tmp_path / "run", *POINTS, "--scan.mode", "continuous"),
            *(f"--scan.length_mm={LENGTH}", f"--scan.section_mm={SPACING}"),
            *("--scan.speed_mm_s=6", "--arm.driver", "ur", "--arm.ur.host", arm.host),
            *("--arm.ur.silence_s=3", "--laser.driver", "genicam"),
            *("--laser.genicam.address", laser.host),
            *(f"--laser.genicam.exposure_us={EXPOSURE_US}",),
            *(f"--laser.genicam.features.AcquisitionFrameRate={RATE}",),
        )
        program = (sys.executable, "-c", "from tjscan.cli import main; main()")
        subprocess.run((*program, *map(str, options)), check=True)
    summary = read_summary(tmp_path / "run" / "summary.json")
    assert summary.complete
    assert summary.sections > 0.7 * LENGTH / SPACING
    assert summary.corner_error_mm is not None
    assert summary.corner_error_mm.mean < 0.03
    assert summary.corner_error_mm.p95 < 0.08
    taken = [view for view in read_views(tmp_path / "run") if view.substep is Substep.PASSING]
    times = np.diff([view.time for view in taken])
    assert np.median(times) == pytest.approx(1 / RATE, rel=1e-3)
