"""``tjscan plan``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cyclopts import Parameter

from tjscan.cli.output.console import print_message, show_phase
from tjscan.core.errors import ConfigurationError

if TYPE_CHECKING:
    from tjscan.job.files import ScanJob
    from tjscan.runs.plan.run import WrittenPlan

OUT_OF_WPS_EXIT_CODE: Final = 3
"""Exit code if something of the plan is out of the WPS or reached by no station."""


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramOptions:
    """The program for the arm, and the arm that it is sent to.

    Parameters
    ----------
    output
        Standard digital output that switches the arc in the program for the arm, 0 to 7.
    arc
        Let the program switch that output on on the beads; else it stays off throughout.
    send_to
        The job of a real arm, to which the program is sent once it is written; Ctrl-C stops it.
    station
        The station at which that arm is, if there are several.
    """

    output: int = 0
    arc: bool = False
    send_to: Path | None = None
    station: str | None = None

    def check_options(self) -> None:
        """Check that the options go together; raises ConfigurationError if not."""
        if not 0 <= self.output <= 7:
            raise ConfigurationError("must be 0 to 7", key="--output")
        if self.station is not None and self.send_to is None:
            raise ConfigurationError("names the station of the arm of --send-to", key="--station")


def plan(
    run: Path,
    *,
    wps: Path,
    gravity: tuple[float, float, float],
    out: Path | None = None,
    after_pass: int = 0,
    reach: bool = True,
    program: ProgramOptions | None = None,
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
        Direction downwards in the frame of the run's sections, three numbers: 0 0 -1 if its z
        points up.
    out
        Directory for the plan's files; the run directory if left out.
    after_pass
        Passes that were welded before the groove was scanned: planned are those after them.
    reach
        Find out what the arm reaches from its stations, and write a program for each.
    json
        Print the plan as JSON on stdout.
    """
    program = program or ProgramOptions()
    program.check_options()
    if after_pass < 0:
        raise ConfigurationError("must be 0 or more", key="--after-pass")
    arm = None
    if program.send_to is not None:
        from tjscan.runs.plan.send import read_job_of_program_arm

        arm = read_job_of_program_arm(program.send_to, program.station, run)
    with show_phase("planning the beads"):
        import numpy as np

        from tjscan.report.plan_page import write_plan_page
        from tjscan.runs.plan.run import ArcSwitch, is_crawl_run, plan_crawl_run, plan_run

        down = np.array(gravity)
        if is_crawl_run(run):
            done = plan_crawl_run(run, wps, down, out, after_pass)
        else:
            switch = ArcSwitch(program.output, program.arc)
            done = plan_run(run, wps, down, switch, out, after_pass, reach=reach)
        page = write_plan_page(done.directory)
    if json:
        print(done.document.model_dump_json(indent=1))
    else:
        from tjscan.cli.output.plan import print_plan

        print_plan(done, page)
    wanting = bool(done.plan.findings or done.unreached_spans)
    wanting |= any(one.out_of_table for one in done.document.details)
    if arm is not None and wanting and program.arc:
        print_message(
            "nothing was sent to the arm: the plan is out of the WPS, see above; it runs "
            "without --arc only"
        )
    elif arm is not None:
        _send_program_to_arm(done, arm, program)
    if wanting:
        raise SystemExit(OUT_OF_WPS_EXIT_CODE)


def _send_program_to_arm(done: WrittenPlan, job: ScanJob, program: ProgramOptions) -> None:
    from tjscan.runs.plan.run import ArcSwitch
    from tjscan.runs.plan.send import find_station_path, send_program

    path = find_station_path(done.paths, program.station)
    switched = f"output {program.output} switches the arc" if program.arc else "the arc stays off"
    host = job.arm.driver_settings.host
    words = f"{len(path.beads)} beads of {path.station} run on {host}, {switched}"
    started = partial(print_message, f"{words}; Ctrl-C stops them")
    switch = ArcSwitch(program.output, program.arc)
    send_program(job, path, done.plan.wps, switch, started)
    print_message("the program has come to its end")
