"""``tjscan crawl compare``."""

from __future__ import annotations

from pathlib import Path


def compare(first: Path, second: Path, *, json: bool = False) -> None:
    """Compare the passes of two crawls: deviation, speed, time and stops.

    Parameters
    ----------
    first, second
        Run directories.
    json
        Print both as JSON on stdout.
    """
    from tjscan.cli.crawl.output import print_comparison
    from tjscan.runs.crawl.results import read_passes

    print_comparison({str(place): read_passes(place) for place in (first, second)}, json=json)
