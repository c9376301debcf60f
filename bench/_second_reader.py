"""A second reader of WPS, table of beads and program: which samples are outside a window."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from tjscan.planning.plan import WpsFinding

Sample = tuple[str, int, float]
"""Key of the window that it is outside of, number of its bead, s in millimetres."""


def samples_of_table(wps_text: str, table: str) -> Iterator[tuple[Sample, bool]]:
    """Every value of ``beads.csv`` with a window in the WPS, and whether it is outside.

    Heat, area and position are computed anew, from wire feed, speed, slope and rotation.
    """
    wps = tomllib.loads(wps_text)
    for row in csv.DictReader(line for line in table.splitlines() if not line.startswith("#")):
        bead, s = int(row["bead"]), float(row["s_mm"])
        for key, value, (low, high) in _values(wps, row):
            outside = not low * (1 - 1e-5) <= value <= high * (1 + 1e-5)
            yield (key, bead, s), outside
        yield (
            ("sequence.positions", bead, s),
            _position(wps, row) not in wps["sequence"]["positions"],
        )


def _values(wps: dict[str, Any], row: dict[str, str]) -> Iterator[tuple[str, float, list[float]]]:
    wire, arc = wps["wire"], wps["arc"]
    feed, speed = float(row["feed_m_min"]), float(row["speed_mm_min"])
    feeds, currents, voltages = np.transpose(arc["power"])
    watts = np.interp(feed, feeds, currents) * np.interp(feed, feeds, voltages)
    area = (
        math.pi / 4 * wire["diameter_mm"] ** 2 * 1e3 * feed * wire["deposition_efficiency"] / speed
    )
    yield "arc.wire_feed_m_min", feed, arc["wire_feed_m_min"]
    yield "arc.travel_speed_mm_min", speed, arc["travel_speed_mm_min"]
    heat = arc["thermal_efficiency"] * float(watts) / (speed / 60) / 1e3
    yield "arc.heat_input_kJ_mm", heat, arc["heat_input_kJ_mm"]
    yield f"bead.{row['kind']}_area_mm2", area, wps["bead"][f"{row['kind']}_area_mm2"]
    yield "bead.weave_limit_mm", float(row["width_mm"]), [0.0, wps["bead"]["weave_limit_mm"]]


def _position(wps: dict[str, Any], row: dict[str, str]) -> str:
    slope, rotation = float(row["slope_deg"]), float(row["rotation_deg"])
    if abs(slope) > wps["sequence"]["slope_limit_deg"]:
        return "PF" if slope > 0 else "PG"
    return min(
        ["PA", "PB", "PC", "PD", "PE"], key=lambda p: abs(90 - 45 * (ord(p[1]) - 65) - rotation)
    )


def samples_of_program(wps_text: str, program: str) -> Iterator[tuple[Sample, bool]]:
    """The speed of every step of a program that is welded, and whether it is outside."""
    low, high = tomllib.loads(wps_text)["arc"]["travel_speed_mm_min"]
    bead = 0
    for line in program.splitlines():
        if found := re.match(r"  # bead (\d+):", line):
            bead = int(found[1])
        elif "movep" in line:
            speed = 60e3 * float(line.split("v=")[1].split(",")[0])
            outside = not low * (1 - 1e-4) <= speed <= high * (1 + 1e-4)
            yield ("arc.travel_speed_mm_min", bead, math.nan), outside


def count_outside(
    samples: Iterable[tuple[Sample, bool]], findings: Iterable[WpsFinding]
) -> tuple[int, int]:
    """How many samples are outside, and how many of these no finding of their bead names."""
    outside = [sample for sample, is_outside in samples if is_outside]
    named: dict[tuple[str, int], list[tuple[float, float]]] = {}
    for one in findings:
        named.setdefault((one.key, one.bead), []).append((1e3 * one.begin, 1e3 * one.end))
    unnamed = [
        (key, bead, s)
        for key, bead, s in outside
        if not any(
            math.isnan(s) or a - 1e-3 <= s <= b + 1e-3 for a, b in named.get((key, bead), ())
        )
    ]
    return len(outside), len(unnamed)
