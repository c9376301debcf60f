"""``tjscan crawl calibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def calibrate(
    job: Path,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Shuttle along a joint and learn how the crawler slips; ``calibration`` of a job names it.

    Parameters
    ----------
    job
        The job file (TOML).
    out
        The directory to make; ``runs/JOB-DATE`` where left out.
    json
        Print the calibration as JSON on stdout.
    """
    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.job.crawl.job import read_crawl_job

    parsed = read_crawl_job(job, parse_overrides(overrides))
    from tjscan.cli.crawl.output import print_slip_calibration, watch_crawl
    from tjscan.runs.crawl.run import calibrate_slip
    from tjscan.runs.run import default_run_directory

    directory = out or default_run_directory(job)
    with watch_crawl(parsed, job) as context:
        found = calibrate_slip(context, directory)
    print_slip_calibration(found, directory, json=json)
