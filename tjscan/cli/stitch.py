"""``tjscan stitch``."""

from __future__ import annotations

from pathlib import Path


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
        The run directory of one station, or one that holds those of all stations.
    runs
        Further run directories of single stations.
    out
        The directory to make; ``runs/stitched-DATE`` where left out.
    repeatability_mm
        How well the arm says where it stands, root mean square.
    repeatability_deg
        The same of its angle.
    out_of_round_mm
        How far the tubes' walls bulge from a circle, at least; more is found where it must be.
    json
        Print the summary and the stations as JSON on stdout.
    """
    from math import radians

    from tjscan.cli.stitching_words import report_stitching
    from tjscan.core.errors import ConfigurationError
    from tjscan.joint.tubes.walls import Repeatability
    from tjscan.runs.directory import default_directory
    from tjscan.runs.stitch import stitch_runs
    from tjscan.stitching.settings import DEFAULT, StitchSettings

    directory = out or default_directory(Path("stitched"))
    if directory.exists() and any(directory.iterdir()):
        raise ConfigurationError(
            "is not empty; a result never overwrites another. Choose another --out", file=directory
        )
    for name, value, most in (
        ("repeatability-mm", repeatability_mm, 5.0),
        ("repeatability-deg", repeatability_deg, 1.0),
        ("out-of-round-mm", out_of_round_mm, 1e3 * DEFAULT.most_out_of_round),
    ):
        if not 0 < value <= most:
            raise ConfigurationError(f"must be more than 0, {most:g} at most", key=f"--{name}")
    done = stitch_runs(
        (run, *runs),
        directory,
        StitchSettings(
            Repeatability(1e-3 * repeatability_mm, radians(repeatability_deg)),
            1e-3 * out_of_round_mm,
        ),
    )
    report_stitching(done, directory, json=json)
