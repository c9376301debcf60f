"""What the scan brings to reports and studies."""

from __future__ import annotations

from typing import Final

from tjscan.core.registry import Task

TASK: Final = Task(
    "scan",
    report="tjscan.runs.scan_report:scan_chapter",
    study="tjscan.runs.scan_study.kind:SCAN_STUDY",
)
