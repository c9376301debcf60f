"""``tjscan crawl replay``."""

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
    """Feed a recorded crawl through another estimator, into a new run directory; nothing moves.

    Keys of the job that say what is known of slip and of the joint's course are options:
    ``--slip.crab-mrad 2``. ``tjscan crawl compare RUN OUT`` then shows both.

    Parameters
    ----------
    run
        The run directory of the crawl, whole or cut short.
    out
        The directory to make; ``RUN-DATE`` beside the run where left out.
    method
        The estimator: slip-aware, or paper for that of Kermorgant (2018); the run's own where
        left out.
    json
        Print the passes as JSON on stdout.
    """
    from tjscan.cli.crawl.output import print_passes
    from tjscan.cli.options.overrides import parse_overrides
    from tjscan.report.write import write_run_report
    from tjscan.runs.crawl.replay import replay_crawl
    from tjscan.runs.scan.reprocess import dated_sibling_directory

    keys = parse_overrides(overrides) | ({} if method is None else {"method": method})
    directory = out or dated_sibling_directory(run)
    replay_crawl(run, keys, directory, write_run_report)
    print_passes(directory, json=json)
