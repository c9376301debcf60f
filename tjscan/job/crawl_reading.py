"""From a crawl job's file to the job; on its own, for it loads what only a crawler needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tjscan.job.crawl_job import CrawlJob
from tjscan.job.reading import read_job_table


def read_crawl_job(file: Path, overrides: dict[str, Any] | None = None) -> CrawlJob:
    """Read the job of a crawler, with single keys replaced; see `read_scan_job`."""
    return read_job_table(CrawlJob, file, overrides)
