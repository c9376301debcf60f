"""What people look at, in a browser: the report of a scan, and the live page."""

from __future__ import annotations

import sys

from _live_page import live_rows
from _report_page import report_rows
from _table import Row, main


def measure() -> list[Row]:
    """All rows."""
    return [*report_rows(), *live_rows()]


if __name__ == "__main__":
    sys.exit(main("pages in a browser", measure, sys.argv[1:]))
