"""The driver of real lasers against the loopback laser, and both against clients of other makes.

``--quick`` takes fewer rounds of everything, under five minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from _both_wires import HALF_COUNT_MM, broken_off, whole_scan
from _clocked_laser import UNIT, time_of_profile
from _lasers import (
    ENDS_IN,
    SURVIVED,
    address,
    ends_as_it_should,
    is_one_of,
    laser_at,
    write_profiles,
)
from _stopwatch import Stopwatch
from _table import Row, main

from tjscan.core.errors import (
    LaserFault,
)
from tjscan.laser.genicam.settings import ScanControlSettings
from tjscan.laser.profile import Profile
from tjscan.laser.scan3d import COORDINATE_FORMATS, AxisScale, Scan3dScales, profile_of_row
from tjscan.laser.scancontrol import parse_scancontrol, scancontrol_profile_size
from tjscan_loopback.laser.coding import encode_profile
from tjscan_loopback.process import LaserLoopbackProcess

HERE: Final = Path(__file__).resolve().parent
DEBIAN_PACKAGES: Final = "/usr/lib/python3/dist-packages"
ARAVIS_FAKE: Final = Path("/usr/bin/arv-fake-gv-camera-0.8")
ROUNDING_MM: Final = 1e-6


def accepted(host: str, file: Path) -> Row:
    """How many clients, of those installed here, read the loopback laser rightly."""
    with laser_at(host) as laser:
        right = [len(laser.capture()) == 640]
    paths = os.pathsep.join((str(HERE.parent), os.environ.get("PYTHONPATH", ""), DEBIAN_PACKAGES))
    for name, module, arguments in (
        ("genapi", "genicam.genapi", ()),
        ("aravis", "gi.repository.Aravis", (host, str(file))),
    ):
        environment = os.environ | {"PYTHONPATH": paths}
        probe = "import gi; gi.require_version('Aravis', '0.8'); " if name == "aravis" else ""
        command = [sys.executable, "-c", f"{probe}import {module}"]
        if subprocess.run(command, env=environment, capture_output=True, check=False).returncode:
            print(f"{name} is not installed, and is left out", file=sys.stderr)
            continue
        command = [sys.executable, str(HERE / "_genicam_clients.py"), name, *arguments]
        found = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=False
        )
        right.append(found.returncode == 0 and float(found.stdout) <= HALF_COUNT_MM + ROUNDING_MM)
        if not right[-1]:
            print(name, found.stdout, found.stderr, file=sys.stderr)
    name = "clients of three makes that accept it, of those installed"
    return Row(name, sum(right), len(right), "", len(right))


def frames_of_aravis(rounds: int) -> Row | None:
    """Profiles from aravis' own fake camera, a server of another make; none where it is missing."""
    if not ARAVIS_FAKE.exists():
        print("aravis' fake camera is not installed, and is left out", file=sys.stderr)
        return None
    host, got = "127.0.0.1", 0  # it takes no other address of this machine
    keys: dict[str, Any] = {
        "pixel_format": "Mono16",
        "scale_mm": [0.1, 0.001],
        "offset_mm": [-25.6, 200.0],
        "features": {"Width": 512},
    }
    with subprocess.Popen([ARAVIS_FAKE, "-i", host]) as fake:
        try:
            with laser_at(host, **keys) as laser:
                for _ in range(rounds):
                    before = time.monotonic()
                    profile = laser.capture()
                    got += len(profile) == 512 and profile.time + profile.time_uncertainty >= before
        finally:
            fake.kill()
    return Row("profiles from aravis' fake camera", got, rounds, "", rounds)


def times(host: str, rounds: int) -> list[Row]:
    """How long a capture takes."""
    watch = Stopwatch()
    with laser_at(host) as laser:
        laser.capture()
        for _ in range(rounds):
            with watch:
                laser.capture()
    return [
        watch.row(f"capture of 640 points: p{share}", partial(np.percentile, q=share), limit)
        for share, limit in ((50, 1.0), (99, 10.0))
    ]


def lossy(loopback: LaserLoopbackProcess, sent: Sequence[Profile], rounds: int) -> list[Row]:
    """Captures that fail, and profiles that nobody sent, while packets get lost."""
    rows = []
    for per_cent in (1, 5):
        failed = wrong = 0
        loopback.schedule_fault("clear")
        with laser_at(loopback.host) as laser:
            loopback.schedule_fault(f"loss {per_cent}")
            for _ in range(rounds):
                try:
                    wrong += not is_one_of(laser.capture(), sent)
                except LaserFault as error:
                    print(f"loss {per_cent}: {error!r}", file=sys.stderr)
                    failed += 1
        rows += [
            Row(f"{per_cent} % of packets lost: captures that fail, of {rounds}", failed, 0),
            Row(f"{per_cent} % of packets lost: wrong profiles", wrong, 0),
        ]
    loopback.schedule_fault("clear")
    return rows


def stale_given_as_new(rounds: int) -> Row:
    """Profiles exposed before the call, as they themselves hold, where a buffer gives old ones."""
    host, stale = address(), 0
    command = [sys.executable, str(HERE / "_clocked_laser.py"), host]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(HERE.parent), str(HERE)))}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            _wait_for(process, "ready")
            with laser_at(host) as laser:
                laser.capture()
                if process.stdin is not None:
                    process.stdin.write("buffered\n")
                    process.stdin.flush()
                _wait_for(process, "ordered")
                for _ in range(rounds):
                    before = time.monotonic()
                    stale += time_of_profile(laser.capture()) < before - UNIT
        finally:
            process.kill()
    return Row(f"stale profiles given as new, of {rounds}", stale, 0)


def _wait_for(process: subprocess.Popen[str], word: str) -> None:
    for line in process.stdout or ():
        if line.startswith(word):
            return


def fuzzed(rounds: int) -> Row:
    """Payloads, right ones with bytes changed, cut or doubled, that end in anything else."""
    random, bad = np.random.default_rng(5), 0
    x = np.linspace(-0.05, 0.05, 640)
    profile = Profile(x, 0.24 + 0.02 * np.sin(60 * x))
    scales = Scan3dScales(AxisScale(5e-6, -0.16), AxisScale(5e-6), 0.0)
    layouts = [
        ScanControlSettings(
            serial="1", model="2600-100", layout=kind, points=number, time_stamp=stamped
        )
        for kind in ("full", "container")
        for number in (80, 640)
        for stamped in (True, False)
    ]
    for k in range(rounds):
        name, layout = (
            list(COORDINATE_FORMATS)[k % len(COORDINATE_FORMATS)],
            layouts[k % len(layouts)],
        )
        right = (
            encode_profile(profile, COORDINATE_FORMATS[name])
            if k % 2
            else bytes(scancontrol_profile_size(layout))
        )
        raw = bytearray(right)
        for at in random.integers(0, len(raw), int(random.integers(1, 40))):
            raw[at] = int(random.integers(0, 256))
        if k % 3 == 0:
            del raw[int(random.integers(0, len(raw))) :]
        elif k % 3 == 1:
            raw += raw[: int(random.integers(0, len(raw)))]
        try:
            if k % 2:
                found = profile_of_row(bytes(raw), name, scales)
            else:
                found = parse_scancontrol(bytes(raw), layout)
            bad += not bool(np.isfinite(found.points_s).all())
        except LaserFault:
            pass
        except Exception as error:
            print(f"fuzzing: {error!r}", file=sys.stderr)
            bad += 1
    name = f"payloads, of {rounds} changed ones, that end in neither profile nor laser fault"
    return Row(name, bad, 0)


def measure(*, quick: bool) -> list[Row]:
    """Measure every bar."""
    share = 10 if quick else 1
    with TemporaryDirectory() as folder:
        file = Path(folder, "profiles.csv")
        sent = write_profiles(file)
        rows = whole_scan()
        with LaserLoopbackProcess(address(), "--recording", str(file)) as loopback:
            rows.append(accepted(loopback.host, file))
            rows += [row for row in [frames_of_aravis(100 // share)] if row is not None]
            rows += times(loopback.host, 1000 // share)
            rows += lossy(loopback, sent, 1000 // share)
            rounds = 1 if quick else 5
            slowest = 0.0
            for fault in (*SURVIVED, *ENDS_IN):
                found = [ends_as_it_should(loopback, fault) for _ in range(rounds)]
                word = "survived" if fault in SURVIVED else "ends in its error"
                right = sum(good for good, _ in found)
                rows.append(Row(f"{fault}: {word}, nothing left", right, rounds, "", rounds))
                slowest = max(slowest, *(seconds for _, seconds in found))
            rows.append(Row("any fault: slowest", slowest, 5, "s"))
    rows.append(stale_given_as_new(10_000 // share))
    rows.append(fuzzed(10_000 // share))
    return rows + broken_off(3 if quick else 50)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--quick"]
    sys.exit(
        main("Lasers over the wire", partial(measure, quick=len(words) < len(sys.argv) - 1), words)
    )
