"""``tjscan plan``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tjscan.runs.plan.run import WrittenPlan
    from tjscan.runs.plan.send import ArmForProgram

OUT_OF_WPS = 3
"""Exit code where something of the plan is out of the WPS or reached by no station."""


def plan(
    run: Path,
    *,
    wps: Path,
    gravity: tuple[float, float, float],
    out: Path | None = None,
    after_pass: int = 0,
    reach: bool = True,
    output: int = 0,
    arc: bool = False,
    send_to: Path | None = None,
    station: str | None = None,
    json: bool = False,
) -> None:
    """Plan the beads of a measured groove: how many, where, torch, speed, heat, and how sure.

    Parameters
    ----------
    run
        The run directory: of one scan, stitched, or a crawl's.
    wps
        The welding procedure specification, TOML: your windows; see docs/planning.md.
    gravity
        Direction downwards in the frame of the run's sections, three numbers: 0 0 -1 where its z
        points up.
    out
        Directory for the plan's files; the run directory where left out.
    after_pass
        Passes that were welded before the groove was scanned: planned are those after them.
    reach
        Find out what the arm reaches from its stations, and write a program for each.
    output
        Standard digital output that switches the arc in the program for the arm, 0 to 7.
    arc
        Let the program switch that output on on the beads; else it stays off throughout.
    send_to
        The job of a real arm, to which the program is sent once it is written; Ctrl-C stops it.
    station
        The station at which that arm stands, where there are several.
    json
        Print the plan as JSON on stdout.
    """
    from tjscan.cli.output.console import print_message, show_phase
    from tjscan.core.errors import ConfigurationError

    if not 0 <= output <= 7:
        raise ConfigurationError("must be 0 to 7", key="--output")
    if after_pass < 0:
        raise ConfigurationError("must be 0 or more", key="--after-pass")
    if station is not None and send_to is None:
        raise ConfigurationError("says where the arm of --send-to stands", key="--station")
    arm = None
    if send_to is not None:
        from tjscan.runs.plan.send import arm_for_program

        arm = arm_for_program(send_to, station, run)
    with show_phase("planning the beads"):
        import numpy as np

        from tjscan.report.plan_page import write_plan_page
        from tjscan.runs.plan.crawl import is_crawl, plan_crawl_run
        from tjscan.runs.plan.run import ArcSwitch, plan_run

        down = np.array(gravity)
        if is_crawl(run):
            done = plan_crawl_run(run, wps, down, out, after_pass)
        else:
            switch = ArcSwitch(output, arc)
            done = plan_run(run, wps, down, switch, out, after_pass, reach=reach)
        page = write_plan_page(done.directory)
    if json:
        print(done.document.model_dump_json(indent=1))
    else:
        _print_plan(done, page)
    wanting = bool(done.plan.findings or done.nobody_s)
    wanting |= any(one.out_of_table for one in done.document.details)
    if arm is not None:
        if wanting and arc:
            print_message(
                "nothing was sent to the arm: the plan is out of the WPS, as said above; it runs "
                "without --arc only"
            )
            raise SystemExit(OUT_OF_WPS)
        _send(done, arm, station, output, arc=arc)
    if wanting:
        raise SystemExit(OUT_OF_WPS)


def _send(
    done: WrittenPlan, arm: ArmForProgram, station: str | None, output: int, *, arc: bool
) -> None:
    from tjscan.cli.output.console import print_message
    from tjscan.runs.plan.send import send_program, way_of_station

    way, torch = way_of_station(done.ways, station), done.plan.wps.torch
    switched = f"output {output} switches the arc" if arc else "the arc stays off"
    words = f"{len(way.beads)} beads of {way.station} run on {arm.settings.host}, {switched}"

    def started() -> None:
        print_message(f"{words}; Ctrl-C stops them")

    send_program(arm, way, torch, output, arc=arc, started=started)
    print_message("the program has come to its end")


def _print_plan(done: WrittenPlan, page: Path) -> None:
    from tjscan.cli.output.console import print_message, print_table
    from tjscan.planning.tables import BEAD_COLUMNS, bead_rows

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
    for one in found.out_of_wps:
        print(
            f"out of the WPS: bead {one.bead}, s = {one.begin_mm:.0f} to {one.end_mm:.0f} mm: "
            f"{one.key}: {one.text}"
        )
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
    for begin, end in done.nobody_s:
        print(f"no station reaches s = {1e3 * begin:.0f} to {1e3 * end:.0f} mm")
    if found.without_stations:
        print_message(f"no program for the arm: {found.without_stations}")
    print_message(f"written to {done.directory}: {', '.join((*done.files, page.name))}")
