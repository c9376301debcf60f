"""From a tow job's file to the job; on its own, for it loads what only a tow needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tjscan.job.reading import read_job_table
from tjscan.job.tow_job import TowJob


def read_tow_job(file: Path, overrides: dict[str, Any] | None = None) -> TowJob:
    """Read the job of a tow, with single keys replaced; see `read_scan_job`."""
    return read_job_table(TowJob, file, overrides)
