"""The wheel in an empty environment outside the checkout: its size, and that every command works.

Takes two or three minutes, and a package index the first time.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from _table import Row, main
from _wheel import ROOT, copy_sources

WORKS: Final = (
    "init paper",
    "init calibrate --out calibration",
    "init tow-simulation --out tow",
    "init paper-study --out study",
    "scan paper.toml --out run --scan.sections 6",
    "compare run tjoint-600x457.toml --tolerance-mm 0.5 --plot map.png",
    "report run",
    "groove run --plot fits.png",
    "reprocess run --out again",
    "export run --to json",
    "export run --to ros",
    "joint tjoint-600x457.toml",
    "doctor paper.toml",
    "calibrate calibration/calibrate.toml --dry-run",
    "schema scan",
)
"""Commands that a plain installation carries out, one after the other."""

NAMES_EXTRA: Final = {
    "view run": "live",
    "tow run tow/tow-simulation.toml --dry-run": "towing",
    "study study/paper-study.toml": "study",
    "scan paper.toml --arm.driver ur --arm.ur.host 127.0.0.2": "ur",
    "export run --to weldx": "weldx",
}
"""Commands that need an extra, and which."""


def run(command: Sequence[str | Path], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder, with nothing to read from."""
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False
    )


def installed(folder: Path) -> tuple[Path, float]:
    """An environment with the wheel and what it needs, and the processor time of installing it."""
    pip = ("-m", "pip", "--disable-pip-version-check", "--quiet")
    copy_sources(folder / "tree")
    subprocess.run(
        (sys.executable, *pip, "wheel", "--no-deps", "--wheel-dir", folder, folder / "tree"),
        check=True,
    )
    (wheel,) = folder.glob("*.whl")
    subprocess.run((sys.executable, "-m", "venv", folder / "venv"), check=True)
    python = folder / "venv" / "bin" / "python"
    before = os.times()
    subprocess.run((python, *pip, "install", "-c", ROOT / "constraints.txt", wheel), check=True)
    after = os.times()
    took = sum(after[2:4]) - sum(before[2:4])  # user and system, of children
    return python.with_name("tjscan"), took


def measure() -> list[Row]:
    """Build the wheel, install it, and run the commands."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        tjscan, seconds = installed(folder)
        files = (file for file in (folder / "venv").rglob("*") if not file.is_symlink())
        size = sum(file.stat().st_size for file in files if file.is_file())
        desk = folder / "desk"
        desk.mkdir()
        failed = 0
        for command in WORKS:
            done = run((tjscan, *command.split()), desk)
            if done.returncode:
                failed += 1
                print(f"tjscan {command}: {done.returncode}: {done.stderr}", file=sys.stderr)
        unnamed = 0
        for command, extra in NAMES_EXTRA.items():
            done = run((tjscan, *command.split()), desk)
            if done.returncode != 2 or f"tjscan[{extra}]" not in " ".join(done.stderr.split()):
                unnamed += 1
                print(f"tjscan {command}: {done.returncode}: {done.stderr}", file=sys.stderr)
    return [
        # docs/install.md says what takes it, and why it is more than 900 MB.
        Row("plain installation", size / 1e6, 1400, "MB"),
        Row("… installing it from a warm cache, processor time", seconds, 90, "s"),
        Row(f"… of {len(WORKS)} commands that a plain installation runs, failed", failed, 0),
        Row(f"… of {len(NAMES_EXTRA)} that need an extra, do not name it", unnamed, 0),
    ]


if __name__ == "__main__":
    sys.exit(main("wheel", measure, sys.argv[1:]))
