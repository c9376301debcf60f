"""``tjscan stitch``."""

from __future__ import annotations

from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tjscan.stitching.stations import StitchSettings


def stitch(
    run: Path,
    *runs: Path,
    out: Path | None = None,
    repeatability_mm: float = 0.05,
    repeatability_deg: float = 0.0057,
    out_of_round_mm: float = 0.02,
    json: bool = False,
) -> None:
    """Stitch what was scanned from several stations into one groove, in the joint's own frame.

    Parameters
    ----------
    run
        The run directory of one station, or one that holds the runs of all stations.
    runs
        Further run directories of single stations.
    out
        The directory to make; ``runs/stitched-DATE`` if left out.
    repeatability_mm
        Root mean square error of the position that the arm reports.
    repeatability_deg
        The same of its orientation.
    out_of_round_mm
        Deviation of the tubes' walls from a circle that is assumed at least; a larger one is
        estimated from the scans.
    json
        Print the summary and the stations as JSON on stdout.
    """
    from tjscan.cli.output.console import show_phase
    from tjscan.core.errors import ConfigurationError

    with show_phase("loading what stitches"):
        from tjscan.cli.output.scan import print_stitched_groove
        from tjscan.report.write import write_run_report
        from tjscan.runs.run import default_run_directory
        from tjscan.runs.stations.stitch import stitch_run_directories

    directory = out or default_run_directory(Path("stitched"))
    if directory.exists() and any(directory.iterdir()):
        raise ConfigurationError(
            "is not empty; a result never overwrites another. Choose another --out", file=directory
        )
    settings = _settings(repeatability_mm, repeatability_deg, out_of_round_mm)
    with show_phase("stitching"):
        done = stitch_run_directories((run, *runs), directory, settings, write_run_report)
    print_stitched_groove(done, directory, json=json)


def _settings(
    repeatability_mm: float, repeatability_deg: float, out_of_round_mm: float
) -> StitchSettings:
    from tjscan.core.errors import ConfigurationError
    from tjscan.joint.tubes.fit import ArmRepeatability
    from tjscan.stitching.stations import DEFAULT_STITCH_SETTINGS, StitchSettings

    for name, value, most in (
        ("repeatability-mm", repeatability_mm, 5.0),
        ("repeatability-deg", repeatability_deg, 1.0),
        ("out-of-round-mm", out_of_round_mm, 1e3 * DEFAULT_STITCH_SETTINGS.most_out_of_round),
    ):
        if not 0 < value <= most:
            raise ConfigurationError(f"must be more than 0, {most:g} at most", key=f"--{name}")
    return StitchSettings(
        ArmRepeatability(1e-3 * repeatability_mm, radians(repeatability_deg)),
        1e-3 * out_of_round_mm,
    )
