"""From a tow job's file to the job; on its own, for it loads what only a tow needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tjscan.core.config import add_file_to_errors
from tjscan.core.extras import package_missing
from tjscan.job.reading import read_job_table
from tjscan.job.tow_checks import check_tow_job
from tjscan.job.tow_job import EXTRA, TowJob


def read_tow_job(file: Path, overrides: dict[str, Any] | None = None) -> TowJob:
    """Read the job of a tow, with single keys replaced; see `read_scan_job`.

    Raises
    ------
    ConfigurationError
        If it can't be read, or asks for what can't be towed.
    """
    job = read_job_table(TowJob, file, overrides)
    with add_file_to_errors(file):
        try:
            check_tow_job(job)
        except ModuleNotFoundError as error:
            raise package_missing(error, "towing", EXTRA) from None
    return job
