"""Start poses as a person teaches them: a job to write them into, and an arm that stands there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from cells import PAPER

from tjscan.core.frames import Array
from tjscan.robot.kinematics import Kinematics

HALF_DIGIT = (0.6e-6, np.radians(1e-4))
"""Metres and radians: what rounding to 0.001 mm and 0.0001 degrees may change."""


def example(folder: Path, file: Path = PAPER) -> Path:
    """A copy of an example that names its joint by its full path."""
    copy = folder / "job.toml"
    text = file.read_text(encoding="utf-8")
    copy.write_text(text.replace("../cad", str(PAPER.parents[1] / "cad")), encoding="utf-8")
    return copy


def standing(T_b_f: Array) -> str:
    """Joint angles that put the example's flange there, as an option."""
    kinematics = Kinematics.load("ur10e")
    q = kinematics.inverse(T_b_f, near=np.radians((-110, -95, 160, 105, -110, 0)))
    return str(np.degrees(q).tolist())
