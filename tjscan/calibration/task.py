"""What the calibration brings to reports."""

from __future__ import annotations

from typing import Final

from tjscan.core.registry import TaskPlugin

TASK: Final = TaskPlugin(
    "calibrate",
    report="tjscan.runs.calibration.report:calibration_chapter",
    recording="measured.mcap",
    result="calibration.toml",
    page="tjscan.runs.calibration.report:calibration_page",
    live="tjscan.runs.live.calibration:read_calibration_show",
)
