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
    print(job, overrides, out, dry_run, json)
