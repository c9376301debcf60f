"""What the crawler brings to reports and studies."""

from __future__ import annotations

from typing import Final

from tjscan.core.registry import TaskPlugin

TASK: Final = TaskPlugin(
    "crawl",
    report="tjscan.runs.crawl.report:crawl_chapter",
    study="tjscan.runs.crawl.study:CRAWL_STUDY",
    recording="crawl.mcap",
    live="tjscan.runs.live.crawl:read_crawl_show",
)
