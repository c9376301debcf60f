"""The beads of a plan in tables: ``beads.csv``, a row a point, and a row a bead for readers."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.files import read_small_file
from tjscan.core.frames import Array
from tjscan.core.pose_vector import rotation_to_vector
from tjscan.core.provenance import Provenance
from tjscan.core.units import DEG, MM, MM2
from tjscan.planning.bead import PlannedBead
from tjscan.planning.document import BeadEntry, PlanDocument
from tjscan.planning.plan import WeldPlan
from tjscan.planning.wps import KJ_MM, M_MIN, MM_MIN

MOST_TABLE_BYTES: Final = 200_000_000
"""A larger table holds no plan."""


@dataclass(frozen=True, slots=True, eq=False)
class BeadCourse:
    """Welding positions of a bead, or a part of it, along the groove, as ``beads.csv`` has them.

    Parameters
    ----------
    number : int
        In the order of welding.
    s : ndarray, shape (q,)
        Millimetres along the groove.
    positions : tuple of str
        Welding position at each point.
    """

    number: int
    s: Array
    positions: tuple[str, ...]


def read_beads_csv(file: Path) -> tuple[BeadCourse, ...]:
    """Read the welding positions of the beads in ``beads.csv``.

    Raises
    ------
    ConfigurationError
        If it is missing, or no such table.
    """
    try:
        text = read_small_file(file, MOST_TABLE_BYTES, "a table of beads").decode()
        lines = (line for line in text.splitlines() if not line.startswith("#"))
        rows = list(csv.DictReader(lines, strict=True))
        return tuple(
            _course(int(number), list(of_part))
            for (number, _), of_part in groupby(rows, lambda row: (row["bead"], row["part"]))
        )
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise ConfigurationError(
            f"is no table of beads as this version writes it ({error}): run `tjscan plan` again",
            file=file,
        ) from None


def _course(number: int, rows: list[dict[str, str]]) -> BeadCourse:
    s = np.array([float(row["s_mm"]) for row in rows])
    return BeadCourse(number, s, tuple(row["position"] for row in rows))


def beads_to_csv(plan: WeldPlan, provenance: Provenance) -> str:
    """Convert a plan's beads to CSV text; the names of the columns have their units.

    Parameters
    ----------
    plan : WeldPlan
        The plan.
    provenance : Provenance
        Written above the table.
    """
    stream = io.StringIO()
    stream.write(provenance.comment_lines("#"))
    writer = csv.writer(stream, lineterminator="\n")
    names = ("bead", "part", "zone", "layer", "place", "kind")
    writer.writerow((*names, *_number_columns(plan.beads[0]), "position", "station"))
    for bead in plan.beads:
        whose = (bead.number, bead.part, bead.zone, bead.layer, bead.place, bead.kind)
        rows = np.column_stack(list(_number_columns(bead).values()))
        for row, position in zip(rows, bead.positions, strict=True):
            writer.writerow((*whose, *(f"{value:.6f}" for value in row), position, bead.station))
    return stream.getvalue()


def _number_columns(bead: PlannedBead) -> dict[str, Array]:
    """Columns of numbers of ``beads.csv``; rx, ry and rz are the torch's rotation vector, rad."""
    x, y, z = bead.points.T / MM.factor
    rx, ry, rz = rotation_to_vector(bead.T_r_torch[:, :3, :3]).T
    return {
        "s_mm": bead.s / MM.factor,
        **{"x_mm": x, "y_mm": y, "z_mm": z, "rx": rx, "ry": ry, "rz": rz},
        "speed_mm_min": bead.speed / MM_MIN.factor,
        "sigma_speed_mm_min": bead.relative_sigma * bead.speed / MM_MIN.factor,
        "feed_m_min": np.full(len(bead.s), bead.feed / M_MIN.factor),
        "area_mm2": bead.area / MM2.factor,
        "sigma_area_mm2": bead.relative_sigma * bead.area / MM2.factor,
        "width_mm": bead.width / MM.factor,
        "heat_kJ_mm": bead.heat / KJ_MM.factor,
        "slope_deg": bead.slope / DEG.factor,
        "rotation_deg": bead.rotation / DEG.factor,
    }


BEAD_COLUMNS: Final[Mapping[str, Callable[[BeadEntry], str]]] = {
    "bead": lambda bead: str(bead.number),
    "station": lambda bead: bead.station or "–",
    "layer": lambda bead: f"{bead.layer}.{bead.place}",
    "kind": lambda bead: bead.kind,
    "length / mm": lambda bead: f"{bead.length_mm:.0f}",
    "wire / (m/min)": lambda bead: f"{bead.feed_m_min:.2f}",
    "speed / (mm/min)": lambda bead: "{:.0f}–{:.0f}".format(*bead.speed_mm_min),
    "area / mm²": lambda bead: "{:.1f}–{:.1f}".format(*bead.area_mm2),
    "heat / (kJ/mm)": lambda bead: "{:.2f}–{:.2f}".format(*bead.heat_kJ_mm),
    "position": lambda bead: " ".join(bead.positions),
    "arc / min": lambda bead: f"{bead.arc_time_s / 60:.1f}",
    "fill ± / %": lambda bead: f"{100 * bead.fill_sigma:.1f}",
}
"""Columns of the table of beads that the page and the terminal show."""


def bead_rows(plan: PlanDocument) -> list[tuple[str, ...]]:
    """Words of each bead, in the order of `BEAD_COLUMNS`."""
    return [tuple(word(bead) for word in BEAD_COLUMNS.values()) for bead in plan.beads]
