"""``tjscan tow replay``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def replay(
    run: Path,
    *overrides: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    out: Path | None = None,
    method: str | None = None,
    json: bool = False,
) -> None:
    """Plan a recorded tow anew from its poses, into a new run directory; nothing moves.

    Keys that say what a planner weighs are options: ``--weights.change 5``. The vehicles went where
    they went, so each plan is what this planner would have asked for next.

    Parameters
    ----------
    run
        The run directory of the tow, whole or cut short.
    out
        The directory to make; ``RUN-DATE`` beside the run where left out.
    method
        The planner: ours, or paper; the run's own where left out.
    json
        Print the figures as JSON on stdout.
    """
    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.cli.tow.output import print_figures
    from tjscan.report.write import write_run_report
    from tjscan.runs.scan.reprocess import dated_sibling_directory
    from tjscan.runs.tow.replay import replay_tow

    keys = parse_overrides(overrides) | ({} if method is None else {"method": method})
    directory = out or dated_sibling_directory(run)
    replay_tow(run, keys, directory, write_run_report)
    print_figures(directory, json=json)
