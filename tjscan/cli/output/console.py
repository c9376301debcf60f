"""Output of the commands: messages and progress on stderr, results on stdout."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from rich.progress import Progress

stderr = Console(stderr=True, highlight=False)


def print_message(message: str) -> None:
    """Print a message for the user on stderr."""
    stderr.print(message, markup=False, soft_wrap=True)


def show_phase(what: str) -> AbstractContextManager[object]:
    """Show on a terminal, while the block runs, what is done that takes more than a moment."""
    return stderr.status(f"{what} …")


def print_json(value: object) -> None:
    """Print data, models and dataclasses among them, as JSON on stdout."""
    from pydantic_core import to_json

    print(to_json(value, indent=2).decode())


def print_fields(
    rows: Iterable[Sequence[str]], head: Sequence[str] = (), title: str | None = None
) -> None:
    """Print rows of a name and its values as a table on stderr.

    Parameters
    ----------
    rows : iterable of sequence of str
        The cells as they are: brackets are no markup.
    head : sequence of str
        Names of the columns; without them the table has no lines.
    title : str, optional
        Printed above the table.
    """
    plain = Table(show_header=False, box=None, pad_edge=False)
    table = Table(*head, title=title) if head else plain
    for row in rows:
        table.add_row(*map(Text, row))
    stderr.print(table)


def print_figures_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows of a name and figures on stderr, the figures to the right, without lines."""
    table = Table(box=None, pad_edge=False)
    for name in head:
        table.add_column(name, justify="left" if name == head[0] else "right")
    for row in rows:
        table.add_row(*map(Text, row))
    stderr.print(table)


def print_table(rows: Sequence[Sequence[str]]) -> None:
    """Print rows on stdout in columns, never wrapped: other programs may read them."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(map(str.ljust, row, widths)).rstrip())


def progress_bars() -> Progress:
    """Progress bars on stderr, each with a description, a count and the time it has taken."""
    from rich import progress

    description = progress.TextColumn("{task.description}")
    count, taken = progress.MofNCompleteColumn(), progress.TimeElapsedColumn()
    return progress.Progress(description, progress.BarColumn(), count, taken, console=stderr)


def ask_at_terminal(what: str) -> bool:
    """Ask a person at the terminal to let a weld go on; Ctrl-C stops it instead."""
    import questionary

    return bool(questionary.confirm(f"{what}: done?").unsafe_ask())
