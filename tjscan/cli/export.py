"""``tjscan export``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def export(
    run: Path,
    *,
    to: Literal["csv", "ply", "json", "weldx"],
    out: Path | None = None,
    units: Literal["mm", "m"] = "mm",
) -> None:
    """Write a run's sections for another tool: points, normals, tangents, measures, sigmas.

    Parameters
    ----------
    run
        The run directory, of one scan or stitched.
    to
        csv: a flat table. ply: points. json: a document with a schema. weldx: frames for weldx.
    out
        The file to write; ``export.FORMAT`` in the run directory where left out.
    units
        Unit of its lengths.
    """
    from tjscan.cli.output.console import print_message
    from tjscan.result.export import export_run as export_run

    print_message(f"written to {export_run(run, to, units, out)}")
