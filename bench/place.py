"""Whether a joint that a person draws becomes a job that scans it all round, on four arms.

Drawn joints are placed by ``tjscan place`` before each arm, upright and leaning, and scanned in
simulation as the job stands: every station, then the stitching. A joint out of reach has to be said
so. ``--joints N`` draws N joints instead of 40; ``--quick`` two of them on two arms; ``--first N``
begins at another seed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import tomli_w
from _table import Row, main, numbers_to_draw

ARMS: Final = ("ur10e", "ur20", "ur5e", "ur16e")
LONGEST: Final = 30.0
"""Seconds of a placement."""

TILTS: Final = ("0", "45")
PIPES: Final = ((219.1, 12.7), (323.9, 16.0), (457.2, 20.0), (610.0, 25.4))
"""Outer diameter and wall of a brace, mm."""


def drawn_joint(seed: int) -> dict[str, object]:
    """A joint of standard pipes as its file has it."""
    random = np.random.default_rng([seed, 35])
    brace, wall = PIPES[random.integers(len(PIPES))]
    leg = round(brace * random.uniform(1.15, 1.9), 1)
    angle = round(random.uniform(60.0, 90.0), 1)
    return {
        "leg": {
            "outer_diameter_mm": leg,
            "wall_mm": round(wall * random.uniform(0.9, 1.3), 1),
            "length_mm": round(2.2 * leg + brace, 0),
        },
        "brace": {
            "outer_diameter_mm": brace,
            "wall_mm": wall,
            "length_mm": round(leg + brace, 0),
            "angle_deg": angle,
        },
        "groove": {
            "angle_deg": [[90.0, 50.0], [140.0, 65.0]],
            "root_opening_mm": 4.0,
            "root_face_mm": 1.5,
            "root_bead_mm": 2.0,
        },
    }


def place_and_scan(seed: int, arm: str, tilt: str) -> tuple[str, float]:
    """What came of it, ``whole``, ``out of reach`` or what is wrong; seconds of the placement."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "joint.toml").write_text(tomli_w.dumps(drawn_joint(seed)), encoding="utf-8")
        command = [sys.executable, "-m", "tjscan"]

        def run(*words: str) -> subprocess.CompletedProcess[str]:
            return subprocess.run(
                [*command, *words],
                cwd=folder,
                input="y\n" * 20,
                capture_output=True,
                text=True,
                check=False,
            )

        since = time.monotonic()
        placed = run("place", "joint.toml", arm, "--tilt-deg", tilt, "--out", "job.toml")
        took = time.monotonic() - since
        if placed.returncode == 1 and "reach the groove all round" in placed.stderr:
            return "out of reach", took
        if placed.returncode:
            return f"place: {placed.stderr.strip()[:200]}", took
        scanned = run("scan", "job.toml", "--out", "run")
        if scanned.returncode:
            return f"scan: {' '.join(scanned.stderr.split())[-300:]}", took
        covered = json.loads((folder / "run" / "stations.json").read_text())["covered_deg"]
        return "whole" if covered > 359 else f"{covered:.0f}° of it", took


def measure(joints: range, arms: tuple[str, ...]) -> Iterator[Row]:
    """Rows of the bench."""
    told, longest = [], 0.0
    for seed in joints:
        for arm in arms:
            for tilt in TILTS:
                what, took = place_and_scan(seed, arm, tilt)
                longest = max(longest, took)
                if what != "out of reach" or tilt == TILTS[-1]:
                    break
            told.append(what)
            print(f"joint {seed}, {arm}, {tilt}°: {what}", file=sys.stderr)
    reached = [what for what in told if what != "out of reach"]
    whole = reached.count("whole")
    yield Row("joints before arms", len(told), float("inf"))
    yield Row("… that are said to be out of reach", len(told) - len(reached), float("inf"))
    yield Row("… reached, and scanned whole", 100 * whole / max(len(reached), 1), 100, "%", 95)
    failed = sum(what.startswith("scan") for what in reached)
    yield Row("… called sound, and failed", failed, 0)
    yield Row("longest placement", longest, LONGEST, "s")


if __name__ == "__main__":
    ARGUMENTS = sys.argv[1:]
    CHOSEN = ARMS[:2] if "--quick" in ARGUMENTS else ARMS
    DRAWN = numbers_to_draw(ARGUMENTS, "--joints", 40, first=0)
    sys.exit(main("joints of one's own", lambda: measure(DRAWN, CHOSEN), ARGUMENTS))
