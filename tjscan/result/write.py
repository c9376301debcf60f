"""Write what was found into a run directory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result import directory as run_files
from tjscan.result.picture import write_png
from tjscan.result.ply import write_cloud_ply
from tjscan.result.summary import ScanSummary, write_summary
from tjscan.result.table import write_sections_csv
from tjscan.result.uncertainty import write_budget
from tjscan.uncertainty.budget import UncertaintyBudget


def write_run_results(
    directory: Path,
    sections: Sequence[MeasuredSection],
    points: Array,
    summary: ScanSummary,
    picture: Any,
    job: str,
    budget: UncertaintyBudget,
) -> ScanSummary:
    """Write sections, cloud, picture, uncertainty budget and summary of a run, all or none.

    Parameters
    ----------
    directory : Path
        The run directory.
    sections : sequence of MeasuredSection
        In the frame that the summary names, in the order along the groove.
    points : ndarray, shape (n, 3)
        The groove's points in the same frame, metres.
    summary : ScanSummary
        The rest in a few numbers.
    picture : matplotlib Figure
        See `draw_groove_overview`.
    job : str
        The job that all of it comes from, see `job_label_of_run`.
    budget : UncertaintyBudget
        Of the sections.

    Returns
    -------
    ScanSummary
        With the provenance of its file.

    Raises
    ------
    RecordingError
        If a file can't be written.
    """
    provenance = Provenance.for_file_written_now(job, summary.frame)
    summary = replace(summary, provenance=provenance)
    with write_files_atomically(directory, last=run_files.SUMMARY_FILE, listed=True) as draft:
        write_sections_csv(draft / run_files.SECTIONS_FILE, sections, provenance)
        write_cloud_ply(draft / run_files.CLOUD_FILE, points, provenance)
        write_png(draft / run_files.SCAN_PICTURE, picture, provenance)
        write_budget(draft / run_files.BUDGET_FILE, budget, provenance)
        write_summary(draft / run_files.SUMMARY_FILE, summary)
    return summary
