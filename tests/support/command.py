"""The command line, called in this process."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any
from unittest.mock import patch

from tjscan.cli import main


def tjscan(*arguments: object, pictures: bool = False) -> int:
    """Run the command line in this process and return its exit code.

    Pictures are blank unless a test looks at them: drawing them takes two thirds of a short scan.
    """
    try:
        with nullcontext() if pictures else blank_pictures():
            main([str(argument) for argument in arguments])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


@contextmanager
def blank_pictures() -> Iterator[None]:
    """Save every figure as a picture of a few points, its metadata kept."""
    from matplotlib.figure import Figure

    save = Figure.savefig

    def save_blank(figure: Figure, *target: Any, **options: Any) -> None:
        save(Figure(figsize=(0.1, 0.1)), *target, **options)

    with patch.object(Figure, "savefig", save_blank):
        yield
