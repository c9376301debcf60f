"""Write a run's report."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tjscan.comparison.sidecar import StatedUnitAndFrame
from tjscan.core.files import write_files_atomically
from tjscan.report.data import read_report_data
from tjscan.report.page import render_report_page

REPORT: Final = "report.html"


def write_run_report(
    directory: Path,
    reference: Path | None = None,
    tolerance: float | None = None,
    options: StatedUnitAndFrame | None = None,
) -> Path:
    """Write ``report.html`` into a run directory, and return it.

    Parameters
    ----------
    directory : Path
        A finished run, of one scan or stitched.
    reference : Path, optional
        What to compare it with, in place of the joint that the run names.
    tolerance : float, optional
        Of that comparison, metres.
    options : StatedUnitAndFrame, optional
        Unit and frame of a reference that does not state them.

    Raises
    ------
    ConfigurationError
        If there is no finished run, or the reference can't be read or compared with.
    ComparisonRefused
        If the reference does not fit.
    RecordingError
        If a recording is damaged, or the report can't be written.
    """
    page = render_report_page(read_report_data(directory, reference, tolerance, options))
    with write_files_atomically(directory) as draft:
        (draft / REPORT).write_text(page, encoding="utf-8")
    return directory / REPORT
