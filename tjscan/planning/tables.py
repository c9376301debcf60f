"""``beads.csv``: a row for every point of every bead."""

from __future__ import annotations

import csv
import io
from typing import Final

import numpy as np

from tjscan.core.pose_vector import rotation_to_vector
from tjscan.core.provenance import Provenance
from tjscan.core.units import DEG, MM, MM2
from tjscan.planning.plan import WeldPlan
from tjscan.planning.wps import KJ_MM, M_MIN, MM_MIN

COLUMNS: Final = (
    *("bead", "zone", "layer", "place", "kind", "s_mm", "x_mm", "y_mm", "z_mm", "rx", "ry", "rz"),
    *("speed_mm_min", "sigma_speed_mm_min", "feed_m_min", "area_mm2", "sigma_area_mm2"),
    *("heat_kJ_mm", "slope_deg", "rotation_deg", "position"),
)
"""rx, ry and rz are the rotation vector of the torch, radians."""


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
                bead.heat / KJ_MM.factor,
                bead.slope / DEG.factor,
                bead.rotation / DEG.factor,
            )
        )
        names = (bead.number, bead.zone, bead.layer, bead.place, bead.kind)
        for row, position in zip(numbers, bead.positions, strict=True):
            writer.writerow((*names, *(f"{value:.6f}" for value in row), position))
    return stream.getvalue()
