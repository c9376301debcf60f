"""The report of the paper's joint in a browser: how large it is, what it asks for, how it turns."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from _browser import changed_share, open_file, printed_pages, started_browser
from _table import Row

from tjscan.cli import main as tjscan

EXAMPLES: Final = Path(__file__).parents[1] / "examples"

MOST_BYTES: Final = 3_000_000
MOST_SHEETS: Final = 6
LEAST_TURNED: Final = 0.02
"""Share of the view's pixels that a drag changes: the groove alone covers more."""


def report_rows() -> Iterator[Row]:
    """Scan the paper's joint, and look at its report in Chromium."""
    with TemporaryDirectory() as folder:
        file = report_of("paper", Path(folder))
        stitched = report_of("whole-joint", Path(folder))
        yield Row("report.html", file.stat().st_size / 1e6, MOST_BYTES / 1e6, "MB")
        with started_browser() as browser:
            watched = open_file(browser, file)
            view = "#view3d .stage"
            before = watched.picture(view)
            watched.drag("#view3d canvas", 120, 30)
            turned = watched.picture(view)
            watched.page.get_by_text("reset view").click()
            again = watched.picture(view)
            sheets = printed_pages(watched.page)
            yield Row("requests of the report, opened from disk", len(watched.requests), 0)
            yield Row("errors and warnings on its console", len(watched.faults), 0)
            yield Row(
                "pixels that a drag changes", changed_share(before, turned), 1, "", LEAST_TURNED
            )
            yield Row("pixels that differ once the view is reset", changed_share(before, again), 0)
            yield Row("sheets of A4", sheets, MOST_SHEETS)
            sheets = printed_pages(open_file(browser, stitched).page)
            yield Row("… of a whole joint, stitched from two stations", sheets, MOST_SHEETS)


def report_of(example: str, folder: Path) -> Path:
    """Scan as an example says; gives the report."""
    run = folder / example
    try:
        with redirect_stderr(StringIO()):
            tjscan(["scan", str(EXAMPLES / f"{example}.toml"), "--out", str(run)])
    except SystemExit as stop:
        if stop.code:
            raise
    return run / "report.html"
