"""What ``tjscan plan`` prints."""

from __future__ import annotations

from pathlib import Path

from tjscan.cli.output.console import print_message, print_table
from tjscan.planning.document import BEAD_COLUMNS, bead_rows, out_of_wps_rows
from tjscan.runs.plan.run import WrittenPlan


def print_plan(done: WrittenPlan, page: Path) -> None:
    """Print the beads of a plan, its totals, and everything that is out of the WPS."""
    found = done.document
    print_table([tuple(BEAD_COLUMNS), *bead_rows(found)])
    zones = "" if len(found.zones) == 1 else f" in {len(found.zones)} zones"
    print(
        f"{len({bead.number for bead in found.beads})} beads{zones} over {found.groove_mm:.0f} mm"
        f"{', closed' if found.closed else ''}: arc on for {found.arc_time_s / 60:.1f} min, "
        f"wire {found.wire_m:.0f} m or {found.wire_kg:.2f} kg, gas {found.gas_l:.0f} l; "
        f"stick-out {found.stick_out_mm:g} mm, overlap {found.overlap_mm:g} mm, "
        f"interpass temperature {found.interpass_temperature_C:g} °C"
    )
    for begin, end in found.root.tack_spans_mm:
        done_with = "fused" if found.root.tacks == "fuse" else "skipped by the root bead"
        print(f"tack weld about s = {0.5 * (begin + end):.0f} mm: {done_with}")
    if found.root.opening_mm is not None:
        print(
            "open root, {:.1f} to {:.1f} mm wide, ".format(*found.root.opening_mm)
            + ("backed" if found.root.backing else "without backing")
        )
    for part in found.details:
        names = ", ".join(part.details) or "no detail"
        out = "; ".join(part.out_of_table) or "inside the table"
        low, high = part.dihedral_deg
        print(
            f"dihedral angle {low:.1f} to {high:.1f}°, s = {part.begin_mm:.0f} to "
            f"{part.end_mm:.0f} mm: {names}: {out}"
        )
    for key, beads, span, _, text in out_of_wps_rows(found):
        print(f"out of the WPS: {key}: bead {beads}, s = {span} mm: {text}")
    for station in found.stations:
        reached = station.reached_mm
        print(
            f"{station.name} reaches "
            + ("nothing" if reached is None else "s = {:.0f} to {:.0f} mm".format(*reached))
            + (f": {station.program}" if station.program else "")
        )
        for length in station.unreached:
            print(f"  not s = {length.begin_mm:.0f} to {length.end_mm:.0f} mm: {length.reason}")
        if station.without_program:
            print(f"  no program: {station.without_program}")
    for begin, end in done.unreached_spans:
        print(f"no station reaches s = {1e3 * begin:.0f} to {1e3 * end:.0f} mm")
    if found.without_stations:
        print_message(f"no program for the arm: {found.without_stations}")
    print_message(f"written to {done.directory}: {', '.join((*done.files, page.name))}")
