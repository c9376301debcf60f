"""What the scan brings to reports and studies."""

from __future__ import annotations

from typing import Final

from tjscan.core.registry import TaskPlugin

TASK: Final = TaskPlugin(
    "scan",
    report="tjscan.runs.scan.report:scan_chapter",
    study="tjscan.runs.scan.study:SCAN_STUDY",
    live="tjscan.runs.live.scan:read_recorded_scan_show",
)
