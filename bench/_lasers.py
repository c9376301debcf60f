"""Loopback lasers with profiles that are known, and what faults of theirs end in."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.config import validate_table
from tjscan.core.errors import (
    GrooveNotFound,
    LaserInUse,
    LaserNotResponding,
    ProfileFormatRefused,
    ProfileNotReceived,
    ProfileStale,
    TjscanError,
    WrongLaser,
)
from tjscan.groove.read import read_groove
from tjscan.laser.genicam.gige import GenicamLaser
from tjscan.laser.genicam.settings import GenicamSettings
from tjscan.laser.profile import Profile
from tjscan_loopback.process import LaserLoopbackProcess

RECORDED: Final = 50
"""Profiles in the file, each of its own."""

_addresses = count(1)

SURVIVED: Final = ("duplicate", "reorder", "late", "buffered")
ENDS_IN: Final[dict[str, type[TjscanError]]] = {
    "loss 100": ProfileNotReceived,
    "lose-leader": ProfileNotReceived,
    "lose-trailer": ProfileNotReceived,
    "stale": ProfileStale,
    "silent": LaserNotResponding,
    "taken": LaserInUse,
    "reboot": WrongLaser,
    "wrong-format": ProfileFormatRefused,
    "unit-pixel": ProfileFormatRefused,
    "missing-features": ProfileFormatRefused,
    "all-invalid": GrooveNotFound,
}
AT_CONNECTION: Final = ("unit-pixel", "missing-features", "reboot")


def address() -> str:
    """An address that nothing else here has."""
    return f"127.{32 + os.getpid() % 16}.{os.getpid() // 16 % 250}.{next(_addresses)}"


def laser_at(host: str, **keys: Any) -> GenicamLaser:
    """The driver for a laser, its settings as in a job file."""
    settings = validate_table(GenicamSettings, {"address": host, **keys})
    return GenicamLaser(settings, time.monotonic)


def write_profiles(file: Path) -> list[Profile]:
    """Profiles of a groove, each of its own, as a file and as they will come over the wire."""
    random, lines, sent = np.random.default_rng(3), ["profile,x_mm,z_mm"], []
    x = np.round(np.linspace(-50.0, 50.0, 640) / 0.005) * 0.005
    for number in range(RECORDED):
        z = 240.0 + np.maximum(0.0, 20.0 - 1.4 * np.abs(x)) + random.normal(0.0, 0.02, x.size)
        z = np.round(z / 0.005) * 0.005
        z[random.random(x.size) < 0.03] = np.nan
        lines += [f"{number},{a:.3f},{b:.3f}" for a, b in zip(x, z, strict=True)]
        sent.append(Profile(1e-3 * np.where(np.isnan(z), np.nan, x), 1e-3 * z))
    file.write_text("\n".join(lines), encoding="utf-8")
    return sent


def is_one_of(profile: Profile, sent: Sequence[Profile]) -> bool:
    """Whether a profile is one that was sent, point by point."""
    return any(
        np.allclose(profile.z_s, one.z_s, atol=1e-8, rtol=0, equal_nan=True)
        and np.allclose(profile.x_s, one.x_s, atol=1e-8, rtol=0, equal_nan=True)
        for one in sent
    )


def left_behind() -> tuple[int, int, int]:
    """Open files, threads and child processes of this process."""
    children = Path("/proc/self/task").glob("*/children")
    pids = [pid for file in children for pid in file.read_text(encoding="ascii").split()]
    return len(list(Path("/proc/self/fd").iterdir())), threading.active_count(), len(pids)


def ends_as_it_should(loopback: LaserLoopbackProcess, fault: str) -> tuple[bool, float]:
    """Whether a fault ends in its error, nothing left behind, and the seconds it took."""
    loopback.schedule_fault("clear")
    before, ended = left_behind(), None
    laser = laser_at(loopback.host)
    if fault == "reboot":
        with laser:
            laser.capture()
    if fault in AT_CONNECTION:
        loopback.schedule_fault(fault)
    start = time.perf_counter()
    try:
        with laser:
            if fault not in AT_CONNECTION:
                loopback.schedule_fault(fault)
                start = time.perf_counter()
            profile = laser.capture()
            if fault == "all-invalid":
                read_groove(profile)
    except TjscanError as error:
        ended = error
    seconds = time.perf_counter() - start
    wanted = ENDS_IN.get(fault)
    right = ended is None if wanted is None else type(ended) is wanted
    if not right or left_behind() != before:
        print(f"{fault}: {ended!r}, {before}, {left_behind()}", file=sys.stderr)
    return right and left_behind() == before, seconds
