"""Output of the commands: messages and progress on stderr, results on stdout."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

stderr = Console(stderr=True, highlight=False)


def print_message(message: str) -> None:
    """Print a message for the user on stderr."""
    stderr.print(message, markup=False)


def add_text_row(table: Table, *cells: str) -> None:
    """Add a row to a table, its cells as they are: brackets are no markup."""
    table.add_row(*map(Text, cells))


def progress_bars() -> Progress:
    """Progress bars on stderr, each with a description, a count and the time it has taken."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=stderr,
    )
