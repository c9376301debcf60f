"""``tjscan report``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def report(
    run: Path,
    *,
    reference: Path | None = None,
    tolerance_mm: float | None = None,
    units: Literal["mm", "um", "m"] | None = None,
    frame: str | None = None,
) -> None:
    """Write a run's report.html again, compared with another reference if one is given.

    If it holds a weld plan, plan.html is written again too.

    Parameters
    ----------
    run
        The run directory, of one scan or stitched.
    reference
        A joint's TOML, a mesh or a cloud, in place of the joint that the run names.
    tolerance_mm
        Report the corners that are farther from it.
    units
        Unit of a reference that states none, neither itself nor in a sidecar NAME.json.
    frame
        Frame of a reference that states none: j for the joint's own, or any name.
    """
    from tjscan.cli.output.console import print_message, show_phase

    with show_phase("writing the report"):
        from tjscan.comparison.sidecar import StatedUnitAndFrame
        from tjscan.report.plan_page import PLAN, write_plan_page
        from tjscan.report.write import write_run_report
        from tjscan.result.directory import SUMMARY_FILE

        if (run / PLAN).is_file():
            print_message(f"written to {write_plan_page(run)}")
            if reference is None and not (run / SUMMARY_FILE).is_file():
                return  # the plan is not in the directory of its run
        tolerance = None if tolerance_mm is None else 1e-3 * tolerance_mm
        page = write_run_report(run, reference, tolerance, StatedUnitAndFrame(units, frame))
    print_message(f"written to {page}")
