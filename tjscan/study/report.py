"""``report.md``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tjscan.study.row import Row


def write_report(folder: Path, rows: Sequence[Row], *, planned: int) -> None:
    """Write the report and its pictures."""
