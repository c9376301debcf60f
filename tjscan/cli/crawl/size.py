"""``tjscan crawl size``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def size(
    job: Path,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    json: bool = False,
) -> None:
    """Check a crawler's grip, friction, pull, power, peel and the torque of its turns.

    Ends with exit code 3 where a rule is broken.

    Parameters
    ----------
    job
        The job file (TOML); its table [size] holds magnets, masses and motors.
    json
        Print the figures as JSON on stdout.
    """
    from tjscan.cli.crawl.output import print_size
    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.crawler.sizing import size_crawler
    from tjscan.job.crawl.job import read_crawl_job

    parsed = read_crawl_job(job, parse_overrides(overrides))
    figures = size_crawler(parsed.size, parsed.vehicle.tracks, parsed.steering.least_radius)
    print_size(figures, json=json)
    if not all(figure.holds for figure in figures):
        raise SystemExit(3)
