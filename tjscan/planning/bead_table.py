"""The beads of a plan in a table, as its page and the terminal show them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from tjscan.planning.document import PlanDocument

BEAD_HEAD: Final = (
    "bead",
    "station",
    "layer",
    "kind",
    "length / mm",
    "wire / (m/min)",
    "speed / (mm/min)",
    "area / mm²",
    "heat / (kJ/mm)",
    "position",
    "arc / min",
    "fill ± / %",
)


def bead_rows(plan: PlanDocument) -> Iterator[tuple[str, ...]]:
    """Words of each bead, in the order of `BEAD_HEAD`."""
    for bead in plan.beads:
        yield (
            str(bead.number),
            bead.station or "–",
            f"{bead.layer}.{bead.place}",
            bead.kind,
            f"{bead.length_mm:.0f}",
            f"{bead.feed_m_min:.2f}",
            "{:.0f}–{:.0f}".format(*bead.speed_mm_min),
            "{:.1f}–{:.1f}".format(*bead.area_mm2),
            "{:.2f}–{:.2f}".format(*bead.heat_kJ_mm),
            " ".join(bead.positions),
            f"{bead.arc_time_s / 60:.1f}",
            f"{100 * bead.fill_sigma:.1f}",
        )
