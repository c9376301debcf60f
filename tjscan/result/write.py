"""Write what a scan found into its run directory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tjscan.comparison.distance import corner_errors
from tjscan.files import drafted
from tjscan.frames import transform
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import feature_edges
from tjscan.result.cloud import groove_points, write_cloud
from tjscan.result.frame import ResultFrame
from tjscan.result.outline import joint_outline
from tjscan.result.picture import draw_scan, write_picture
from tjscan.result.sections import write_sections
from tjscan.result.summary import Summary, summarise, write_summary
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.scanner import ScanResult


def write_results(
    directory: Path,
    result: ScanResult,
    plan: ScanPlan,
    frame: ResultFrame,
    joint: JointDefinition | None,
) -> Summary:
    """Write ``sections.csv``, ``groove.ply``, ``scan.png`` and ``summary.json``, all or none.

    Raises
    ------
    RecordingError
        If a file can't be written.
    """
    points = groove_points(result.sections, frame)
    corners = np.array([transform(frame.T_from_b, scan.points_b) for scan in result.sections])
    error = None if joint is None else corner_errors(corners, feature_edges(joint))
    outline = [] if joint is None else joint_outline(joint)
    summary = summarise(result, plan, frame, error)
    with drafted(directory) as draft:
        write_sections(draft / "sections.csv", result.sections, frame)
        write_cloud(draft / "groove.ply", points)
        write_picture(draft / "scan.png", draw_scan(result, frame, points, outline))
        write_summary(draft / "summary.json", summary)
    return summary
