"""A continuous scan over the wire finds the groove where one with the simulated arm does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cells import FAULTLESS, PAPER
from command import tjscan
from scipy.interpolate import CubicSpline
from ur_cell import address

from tjscan.core.frames import Array
from tjscan.scanning.recording import read_recorded_scan
from tjscan_loopback.process import UrLoopbackProcess

pytest.importorskip("rtde_control")

MOST_APART = 5e-5
"""Metres between a corner of one scan and the line through those of the other."""

SECTIONS_OF_START = 10
"""Sections at the start, where the scans of both arms are up to 0.15 mm beside the true edges."""

LENGTH = 40.0
SPACING = 2.0
"""Millimetres beyond the second taught pose, and between sections."""

SLOW_PPM = "-750000"
"""Of the controller's clock: where arm and laser go on at a quarter of this machine's time, a busy
one has time to plan and to simulate profiles. The simulated laser has the arm's clock."""


def corners(run: Path) -> Array:
    """Outer corners p2 and p4 of each section in frame b, shape (m, 2, 3)."""
    sections = read_recorded_scan(run).sections
    return np.array([section.points_b[[1, 3]] for section in sections.values()])


def distances_apart(found: Array, reference: Array) -> Array:
    """Distances of points, shape (m, 3), from the curve through others, ends aside, metres."""
    gone = np.linalg.norm(np.diff(reference, axis=0), axis=1).cumsum()
    curve = CubicSpline(np.concatenate(([0.0], gone)), reference)
    fine = curve(np.arange(0.0, gone[-1], 1e-5))
    inside = [fine[np.linalg.norm(fine - point, axis=1).argmin()] - point for point in found[3:-3]]
    return np.asarray(np.linalg.norm(inside, axis=1))


def test_corners_are_those_of_the_simulated_arm(tmp_path: Path) -> None:
    options = [
        *(f"--{key}={value}" for key, value in FAULTLESS.items() if "noise" not in key),
        "--simulation.laser.noise_mm=0.002",  # a profile that is another's twin does not count
        *("--scan.mode", "continuous", f"--scan.length_mm={LENGTH}", "--scan.speed_mm_s=12"),
    ]
    assert tjscan("scan", PAPER, "--out", tmp_path / "simulated", *options) == 0
    slow = ("--clock", "900", SLOW_PPM)
    with UrLoopbackProcess(address(), "--hz", "500", "--fast", *slow) as arm:
        options += ["--arm.driver", "ur", "--arm.ur.host", arm.host, "--arm.ur.silence_s=3"]
        assert tjscan("scan", PAPER, "--out", tmp_path / "wire", *options) == 0
    simulated, wire = (corners(tmp_path / name) for name in ("simulated", "wire"))
    assert len(wire) > 0.7 * LENGTH / SPACING  # a busy machine is late to read some
    for corner in range(2):
        apart = distances_apart(wire[:, corner], simulated[:, corner])
        settled = apart[SECTIONS_OF_START:]
        # A busy machine gets few profiles of some section.
        assert np.quantile(settled, 0.9) < MOST_APART
        assert settled.max() < 3 * MOST_APART
