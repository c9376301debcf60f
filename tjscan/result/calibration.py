"""Which calibration a run was made with."""

from __future__ import annotations

from pathlib import Path

from tjscan.calibration.file import read_calibration
from tjscan.result.directory import CALIBRATION, JOB


def calibration_name(directory: Path) -> str:
    """What the sensor's pose on the hand comes from, in the words of a run directory's files.

    Raises
    ------
    ConfigurationError
        If its ``calibration.toml`` can't be read.
    """
    file = directory / CALIBRATION
    if not file.is_file():
        return f"T_f_s_mm in {JOB}"
    found = read_calibration(file)
    return f"{found.arm} with {found.laser}, {found.date:%Y-%m-%d %H:%M}"
