"""What the crawler brings to reports."""

from __future__ import annotations

from typing import Final

from tjscan.core.registry import TaskPlugin

TASK: Final = TaskPlugin(
    "crawl", report="tjscan.runs.crawl_report:crawl_chapter", recording="crawl.mcap"
)
