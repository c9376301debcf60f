"""Jobs with stations, as tests need them: written anew from the examples, with tables replaced."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from cells import EXAMPLES, PAPER

from tjscan.core.config import read_toml
from tjscan.core.frames import Array, pose_from_euler_zyx, pose_to_euler_zyx

WHOLE = EXAMPLES / "whole-joint.toml"

QUICK = ("--scan.sections", "4")
"""Options of a scan that is soon done."""


def table_of(T: Array) -> dict[str, Any]:
    """A pose as a job file has it."""
    position, angles = pose_to_euler_zyx(T)
    return {
        "position_mm": (1e3 * position).tolist(),
        "euler_zyx_deg": np.degrees(angles).tolist(),
    }


def pose_of(table: dict[str, Any]) -> Array:
    """What `table_of` took."""
    return pose_from_euler_zyx(
        1e-3 * np.array(table["position_mm"]),
        np.radians(table.get("euler_zyx_deg", (0.0, 0.0, 0.0))),
    )


def data_of(example: Path) -> dict[str, Any]:
    """An example as tables; the file of its joint by its full path."""
    data = read_toml(example)
    data["joint"]["file"] = str((example.parent / data["joint"]["file"]).resolve())
    return data


def written(folder: Path, data: dict[str, Any]) -> Path:
    """A job file of these tables."""
    file = folder / "job.toml"
    file.write_text(tomli_w.dumps(data), encoding="utf-8")
    return file


def paper_at_a_station(T_w_b: Array, name: str = "left") -> dict[str, Any]:
    """The paper's job with its base standing somewhere in frame w, and its joint there, too."""
    data = data_of(PAPER)
    scan = data["scan"]
    starts = {which: scan.pop(which) for which in ("first", "second")}
    data["station"] = [{"name": name, **table_of(T_w_b), **starts}]
    data["joint"] |= table_of(T_w_b @ pose_of(data["joint"]))
    return data


def moved(data: dict[str, Any], T: Array) -> dict[str, Any]:
    """The same job in another frame w: all that is told in it moves alike."""
    tables: Sequence[dict[str, Any]] = [
        *data["station"],
        *data["simulation"].get("station", ()),
        data["joint"],
        *(solid for solid in data["clearance"]["solid"] if solid.get("frame") == "w"),
    ]
    for table in tables:
        table |= table_of(T @ pose_of(table))
    return data
