"""``tjscan teach``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tjscan.cli.options.overrides import JobKeys, parse_overrides


def teach(
    job: Path,
    *overrides: JobKeys,
    which: Literal["first", "second"],
    station: str | None = None,
    lead_mm: tuple[float, float, float] | None = None,
    json: bool = False,
) -> None:
    """Write the arm's pose into a job file as a start pose, if the laser sees a groove.

    Lead the arm there by hand or pendant before; nothing moves. Comments in the file stay. Every
    key of the job file is an option too, for this once.

    Parameters
    ----------
    job
        The job file (TOML), which is changed.
    which
        The first or the second start pose.
    station
        Station of the arm, if the job has several.
    lead_mm
        Lead a simulated arm, which no hand can: to the pose in the job, moved by this
        much along the flange's axes. ``--lead-mm 3 0 -2``
    json
        Print the pose as JSON on stdout.
    """
    from json import dumps

    from tjscan.cli.output.console import print_message
    from tjscan.core.config import add_file_to_errors
    from tjscan.job import read_scan_job
    from tjscan.result.readings import measures_with_sigmas
    from tjscan.runs.teach import teach_pose

    with add_file_to_errors(job):
        here = read_scan_job(job, parse_overrides(overrides)).job_at_station(station)
    lead = None if lead_mm is None else [1e-3 * value for value in lead_mm]
    taught = teach_pose(here, job, which, lead)
    position, angles = taught.position_mm, taught.euler_zyx_deg
    if json:
        pose = {"which": which, "position_mm": position, "euler_zyx_deg": angles}
        print(dumps(pose, indent=2))
    measures = measures_with_sigmas(taught.groove)
    seen = ", ".join(f"{name} {value:.2f}" for name, value, _ in measures)
    print_message(f"the laser sees a groove there: {seen}")
    print_message(f"{job}: {'.'.join(taught.key)} is now {list(position)} mm, {list(angles)}°")
