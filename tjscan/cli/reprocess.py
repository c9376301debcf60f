"""``tjscan reprocess``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def reprocess(
    run: Path,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Read a run's recorded profiles again with other settings, into a new directory.

    Keys of the job that say how profiles are read are options: ``--groove.noise-mm 0.1``; so is
    ``--calibration.file``. The run itself stays as it is.

    Parameters
    ----------
    run
        The run directory, whole or cut short, of one station or of several.
    out
        The directory to make; ``RUN-DATE`` beside the run where left out.
    json
        Print the summary as JSON on stdout.
    """
    from tjscan.cli.console import report, say
    from tjscan.cli.overrides import parse_overrides
    from tjscan.cli.stitching_words import report_stitching
    from tjscan.runs.reprocess import reprocess as read_again

    done = read_again(run, parse_overrides(overrides), out)
    for found in done.stations:
        for index, error in found.lost.items():
            say(f"section {index}: {error}")
    if done.stitched is not None:
        report_stitching(done.stitched, done.directory, json=json)
        return
    for found in done.stations:
        report(found.summary, found.directory, json=json)
    if any(found.lost for found in done.stations):
        raise SystemExit(1)
