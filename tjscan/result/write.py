"""Write what was found into a run directory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tjscan.comparison.distance import corner_errors
from tjscan.core.files import drafted
from tjscan.core.frames import Array, transform
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import feature_edges
from tjscan.result.cloud import groove_points, write_cloud
from tjscan.result.directory import CLOUD, SECTIONS, SUMMARY
from tjscan.result.frame import ResultFrame
from tjscan.result.measured import MeasuredSection, measure_all
from tjscan.result.outline import joint_outline
from tjscan.result.picture import draw_groove, write_picture
from tjscan.result.sections import write_sections
from tjscan.result.summary import Summary, summarise, write_summary
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.result import ScanResult


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
    with drafted(directory, last=SUMMARY) as draft:
        write_sections(draft / SECTIONS, sections)
        write_cloud(draft / CLOUD, points)
        write_picture(draft / "scan.png", picture)
        write_summary(draft / SUMMARY, summary)


def write_scan(
    directory: Path,
    result: ScanResult,
    plan: ScanPlan,
    frame: ResultFrame,
    joint: JointDefinition | None,
    *,
    station: str = "1",
    calibration: str = "",
) -> Summary:
    """Write what a scan from one place found; raises as `write_results` does.

    Parameters
    ----------
    directory : Path
        The run directory.
    result, plan, frame
        What was found, what was asked, and the frame to tell it in.
    joint : JointDefinition, optional
        What to compare the corners with.
    station : str
        Where it was scanned from.
    calibration : str
        What the sensor's pose comes from.
    """
    sections = measure_all(result.sections, frame, station)
    points = groove_points(result.sections, frame)
    corners = np.array([section.points for section in sections])
    error = None if joint is None else corner_errors(corners, feature_edges(joint))
    summary = summarise(result, plan, frame, error, calibration)
    middle = result.sections[len(result.sections) // 2]
    picture = draw_groove(
        sections,
        points,
        frame=frame.name,
        title=f"{len(sections)} sections, {result.stop}",
        outline=() if joint is None else joint_outline(joint),
        paths=[transform(frame.T_r_b, [view.T_b_f[:3, 3] for view in result.views])],
        example=middle,
    )
    write_results(directory, sections, points, summary, picture)
    return summary
