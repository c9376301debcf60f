"""A loopback laser whose profiles hold the time of their exposure: ``... HOST``, faults on stdin.

Column by column z is 100 mm and one step of the laser for each unit of a digit of base 10,000 of
the milliseconds of `time.monotonic` times 100: what a reader decodes owes nothing to time stamps.
"""

from __future__ import annotations

import sys
from typing import Final

import numpy as np

from tjscan.laser.profile import Profile
from tjscan_loopback.laser.coding import STEP_MM
from tjscan_loopback.laser.sensor import LoopbackSensor
from tjscan_loopback.laser.server import run_laser_server

COLUMNS: Final = 640
BASE: Final = 10_000
DIGITS: Final = 4
UNIT: Final = 1e-5
"""Seconds for one in the last digit."""

ZERO_MM: Final = 100.0


def profile_of_time(seconds: float) -> Profile:
    """Profile that holds a time."""
    count, z = int(seconds / UNIT), np.full(COLUMNS, ZERO_MM)
    for digit in range(DIGITS):
        z[digit] += STEP_MM * (count % BASE)
        count //= BASE
    return Profile(np.linspace(-0.05, 0.05, COLUMNS), 1e-3 * z)


def time_of_profile(profile: Profile) -> float:
    """The time that a profile holds, in seconds of `time.monotonic`, cut to `UNIT`."""
    digits = np.round((1e3 * profile.z_s[:DIGITS] - ZERO_MM) / STEP_MM)
    return UNIT * float(sum(digit * BASE**i for i, digit in enumerate(digits)))


def _tell(line: str) -> None:
    print(line, flush=True)


def _expose(moment: float) -> Profile:
    return profile_of_time(moment)


if __name__ == "__main__":
    laser = LoopbackSensor(sys.argv[1], "1", COLUMNS, _expose, lambda: None, _tell)
    run_laser_server(laser, _tell, attached=True)
