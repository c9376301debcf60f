"""``beads.csv``: a row for every point of every bead."""

from __future__ import annotations

import csv
import io
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
from tjscan.planning.plan import WeldPlan
from tjscan.planning.wps import KJ_MM, M_MIN, MM_MIN

COLUMNS: Final = (
    *(
        "bead",
        "part",
        "zone",
        "layer",
        "place",
        "kind",
        "s_mm",
        "x_mm",
        "y_mm",
        "z_mm",
        "rx",
        "ry",
        "rz",
    ),
    *("speed_mm_min", "sigma_speed_mm_min", "feed_m_min", "area_mm2", "sigma_area_mm2"),
    *("width_mm", "heat_kJ_mm", "slope_deg", "rotation_deg", "position", "station"),
)
"""rx, ry and rz are the rotation vector of the torch, radians."""

MOST_BYTES: Final = 200_000_000
"""A larger table holds no plan."""


@dataclass(frozen=True, slots=True, eq=False)
class BeadCourse:
    """How a bead, or a part of it, goes along the groove, in the units of ``beads.csv``.

    Parameters
    ----------
    number : int
        In the order of welding.
    kind : str
        root, fill or cap.
    s, speed, heat : ndarray, shape (q,)
        Millimetres along the groove, mm/min and kJ/mm.
    positions : tuple of str
        Welding position at each point.
    """

    number: int
    kind: str
    s: Array
    speed: Array
    heat: Array
    positions: tuple[str, ...]


def read_beads_csv(file: Path) -> tuple[BeadCourse, ...]:
    """Read how the beads of ``beads.csv`` go along the groove.

    Raises
    ------
    ConfigurationError
        If it is missing, or no such table.
    """
    try:
        text = read_small_file(file, MOST_BYTES, "a table of beads").decode()
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
    s, speed, heat = (
        np.array([float(row[name]) for row in rows])
        for name in ("s_mm", "speed_mm_min", "heat_kJ_mm")
    )
    return BeadCourse(
        number, rows[0]["kind"], s, speed, heat, tuple(row["position"] for row in rows)
    )


def beads_to_csv(plan: WeldPlan, provenance: Provenance) -> str:
    """Convert a plan's beads to CSV text; units stand in the names of the columns.

    Parameters
    ----------
    plan : WeldPlan
        The plan.
    provenance : Provenance
        Stands above the table.
    """
    stream = io.StringIO()
    stream.write(provenance.comment_lines("#"))
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for bead in plan.beads:
        turns = rotation_to_vector(bead.T_r_torch[:, :3, :3])
        sigma = bead.relative_sigma
        numbers = np.column_stack(
            (
                bead.s / MM.factor,
                bead.points / MM.factor,
                turns,
                bead.speed / MM_MIN.factor,
                sigma * bead.speed / MM_MIN.factor,
                np.full(len(sigma), bead.feed / M_MIN.factor),
                bead.area / MM2.factor,
                sigma * bead.area / MM2.factor,
                bead.width / MM.factor,
                bead.heat / KJ_MM.factor,
                bead.slope / DEG.factor,
                bead.rotation / DEG.factor,
            )
        )
        names = (bead.number, bead.part, bead.zone, bead.layer, bead.place, bead.kind)
        for row, position in zip(numbers, bead.positions, strict=True):
            writer.writerow((*names, *(f"{value:.6f}" for value in row), position, bead.station))
    return stream.getvalue()
