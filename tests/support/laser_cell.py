"""Loopback lasers for tests, each on an address of its own."""

from __future__ import annotations

import socket
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ur_cell import address

from tjscan.core.config import validate_table
from tjscan.laser.genicam.gige import GenicamLaser
from tjscan.laser.genicam.settings import GenicamSettings
from tjscan_loopback.process import LaserLoopbackProcess

PROFILES = 20


def require_broadcasts() -> None:
    """Skip a module of tests on a machine without any network: lasers are found by broadcasts."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        try:
            trial.connect(("255.255.255.255", 9))
        except OSError:
            pytest.skip("there is no network to broadcast in", allow_module_level=True)


def write_groove_profiles(file: Path) -> Path:
    """Profiles of a V groove with noise, and some points missing, as a file."""
    random, lines = np.random.default_rng(3), ["profile,x_mm,z_mm"]
    x = np.linspace(-50.0, 50.0, 640)
    for number in range(PROFILES):
        z = 240.0 + np.maximum(0.0, 20.0 - 1.4 * np.abs(x)) + random.normal(0.0, 0.02, x.size)
        z[random.random(x.size) < 0.03] = np.nan
        lines += [f"{number},{a:.3f},{b:.3f}" for a, b in zip(x, z, strict=True)]
    file.write_text("\n".join(lines), encoding="utf-8")
    return file


def loopback_laser(recording: Path, *options: str) -> LaserLoopbackProcess:
    """A loopback laser with recorded profiles."""
    return LaserLoopbackProcess(address(), "--recording", str(recording), *options)


def laser_at(host: str, **keys: Any) -> GenicamLaser:
    """The driver for a laser, its settings as in a job file."""
    settings = validate_table(GenicamSettings, {"address": host, **keys})
    return GenicamLaser(settings, time.monotonic)
