"""``tjscan scan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def scan(
    job: Path,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    out: Path | None = None,
    dry_run: bool = False,
    json: bool = False,
) -> None:
    """Scan a groove as a job file says.

    Every key of the job file is an option too: ``--scan.step-mm 20``.

    Parameters
    ----------
    job
        The job file (TOML).
    out
        The run directory to make; ``runs/JOB-DATE`` where left out.
    dry_run
        Check the job and the reach of the taught poses, and move nothing.
    json
        Print the summary as JSON on stdout.
    """
    from tjscan.cli.console import report, say, watching
    from tjscan.cli.overrides import parse_overrides
    from tjscan.job import read_job
    from tjscan.result.directory import default_directory
    from tjscan.run import check_job, plan_of, run_job

    parsed = read_job(job, parse_overrides(overrides))
    if dry_run:
        check_job(parsed, job)
        say(f"{job}: the job is sound and the arm reaches both taught poses")
        return
    directory = out or default_directory(job)
    with watching(plan_of(parsed)) as watch:
        summary = run_job(parsed, job, directory, watch)
    report(summary, directory, json=json)
    if not summary.complete:
        raise SystemExit(1)
