"""What towing brings to reports and studies."""

from __future__ import annotations

from typing import Final

from tjscan.core.registry import TaskPlugin

TASK: Final = TaskPlugin(
    "tow",
    report="tjscan.runs.tow.report:tow_chapter",
    study="tjscan.runs.tow.study:TOW_STUDY",
    recording="tow.mcap",
    live="tjscan.runs.live.tow:read_tow_show",
)
