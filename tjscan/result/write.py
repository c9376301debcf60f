"""Write what was found into a run directory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tjscan.core.files import atomic_directory
from tjscan.core.frames import Array
from tjscan.groove.measured import MeasuredSection
from tjscan.result.cloud import write_cloud
from tjscan.result.directory import CLOUD, SECTIONS, SUMMARY
from tjscan.result.picture import write_picture
from tjscan.result.sections import write_sections
from tjscan.result.summary import Summary, write_summary


def write_results(
    directory: Path,
    sections: Sequence[MeasuredSection],
    points: Array,
    summary: Summary,
    picture: Any,
) -> None:
    """Write ``sections.csv``, ``groove.ply``, ``scan.png`` and ``summary.json``, all or none.

    Parameters
    ----------
    directory : Path
        The run directory.
    sections : sequence of MeasuredSection
        In the frame that the summary names, in the order along the groove.
    points : ndarray, shape (n, 3)
        The groove's points in the same frame, metres.
    summary : Summary
        The rest in a few numbers.
    picture : matplotlib Figure
        See `draw_groove`.

    Raises
    ------
    RecordingError
        If a file can't be written.
    """
    with atomic_directory(directory, last=SUMMARY) as draft:
        write_sections(draft / SECTIONS, sections)
        write_cloud(draft / CLOUD, points)
        write_picture(draft / "scan.png", picture)
        write_summary(draft / SUMMARY, summary)
