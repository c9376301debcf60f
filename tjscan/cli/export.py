"""``tjscan export``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def export(
    run: Path,
    *,
    to: Literal["csv", "ply", "json", "weldx", "ros"],
    out: Path | None = None,
    units: Literal["mm", "m"] | None = None,
) -> None:
    """Write a run's sections for another tool: points, normals, tangents, measures, sigmas.

    Parameters
    ----------
    run
        The run directory, of one scan or stitched.
    to
        csv: a flat table. ply: points. json: a document with a schema. weldx: frames for weldx.
        ros: a folder with a PoseArray and a JointTrajectory of ROS 2, and the arm's URDF.
    out
        The file or folder to write; ``export.FORMAT`` in the run directory if left out.
    units
        Unit of its lengths, mm if left out; messages of ROS are in metres.
    """
    from tjscan.cli.output.console import print_message
    from tjscan.core.errors import ConfigurationError

    if to != "ros":
        from tjscan.result.export import export_run

        written = export_run(run, to, units or "mm", out)
    elif units == "mm":
        raise ConfigurationError("messages of ROS are in metres: leave it out", key="--units")
    else:
        from tjscan.runs.export_ros import export_run_to_ros

        written = export_run_to_ros(run, out)
    print_message(f"written to {written}")
