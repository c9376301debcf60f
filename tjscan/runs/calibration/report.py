"""What the report of a run shows of its hand-eye calibration."""

from __future__ import annotations

from pathlib import Path

from tjscan.calibration.file import read_calibration
from tjscan.result.chapter import ReportChapter
from tjscan.result.directory import CALIBRATION
from tjscan.runs.scan.results import calibration_label


def calibration_chapter(directory: Path) -> ReportChapter:
    """Make the calibration's chapter of a report; see `tjscan.result.chapter.ChapterWriter`."""
    file = directory / CALIBRATION
    if not file.is_file():
        return ReportChapter(
            facts=(("calibration", "stated in the job; its uncertainty is not known"),),
            findings=(
                "The sensor's pose on the flange is stated in the job and was not calibrated with "
                "this program: its error is in every point, and is not known.",
            ),
        )
    found = read_calibration(file)
    return ReportChapter(
        facts=(
            (
                "calibration",
                f"{calibration_label(directory)}, {found.lines} lines: the sensor's pose on the "
                f"flange is known to {found.sigma_position_mm:.3f} mm and "
                f"{found.sigma_rotation_deg:.4f}° (one standard deviation)",
            ),
        )
    )
