"""What every bench prints: one row per bar, as a table or as JSON; it fails when a bar does."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Row:
    """One bar.

    Parameters
    ----------
    name : str
        What is measured, and on what.
    measured : float
        What came out; NaN never holds.
    limit : float
        The largest value that holds.
    unit : str
        Of both.
    at_least : float, optional
        The smallest value that holds.
    slowdown : float, optional
        For times, see `Stopwatch.slowdown`: measured / slowdown is held against the limit.
    """

    name: str
    measured: float
    limit: float
    unit: str = ""
    at_least: float = -math.inf
    slowdown: float = 1.0

    @property
    def judged(self) -> float:
        """What is held against the limit."""
        return self.measured / self.slowdown

    @property
    def holds(self) -> bool:
        """Whether the bar is met."""
        return bool(self.at_least <= self.judged <= self.limit)

    @property
    def bound(self) -> str:
        """The limit in words."""
        if math.isinf(self.at_least):
            return f"≤ {self.limit:g}"
        if math.isinf(self.limit):
            return f"≥ {self.at_least:g}"
        return f"{self.at_least:g} to {self.limit:g}"


NAME: Final = 70
"""Columns of the table that a name takes; a longer one moves the rest of its row."""


def main(title: str, measure: Callable[[], Iterable[Row]], arguments: list[str]) -> int:
    """Measure, print, and return the exit code: 0 when every bar holds, 1 when one does not.

    Parameters
    ----------
    title : str
        What the bench is about.
    measure : callable
        Gives the rows; each is printed as soon as it comes.
    arguments : list of str
        Of the command line; ``--json`` prints JSON in the end instead of a table.
    """
    unknown = [word for word in arguments if word != "--json"]
    if unknown:
        print(f"unknown option {unknown[0]}; the only one is --json", file=sys.stderr)
        return 2
    as_json, rows = "--json" in arguments, []
    if not as_json:
        print(f"\n{title}", flush=True)
    for row in measure():
        rows.append(row)
        if not as_json:
            print(_line(row), flush=True)
    if as_json:
        # JSON knows no infinity and no NaN.
        listed = [
            {
                k: None if isinstance(v, float) and not math.isfinite(v) else v
                for k, v in one.items()
            }
            for one in ({**asdict(row), "holds": row.holds} for row in rows)
        ]
        print(json.dumps({"bench": title, "rows": listed}, indent=2, ensure_ascii=False))
    return 0 if all(row.holds for row in rows) else 1


def numbers_to_draw(arguments: list[str], word: str, count: int, *, first: int) -> range:
    """Numbers from ``--first N`` on, as many as ``word N`` states, two if ``--quick``.

    Parameters
    ----------
    arguments : list of str
        Of the command line; these options are taken out of it.
    word : str
        Name of the option that states how many.
    count, first : int
        What counts if they are left out.
    """
    stated = {word: count, "--first": first}
    if "--quick" in arguments:
        arguments.remove("--quick")
        stated[word] = 2
    for option in stated:
        if option in arguments:
            at = arguments.index(option)
            stated[option] = int(arguments[at + 1])
            del arguments[at : at + 2]
    return range(stated["--first"], stated["--first"] + stated[word])


def _line(row: Row) -> str:
    measured = f"{row.judged:.3g} {row.unit}".strip()
    verdict = "holds" if row.holds else "FALLS SHORT"
    if row.slowdown != 1:
        verdict += (
            f" ({row.measured:.3g} {row.unit} here, where the reference task takes "
            f"{row.slowdown:.2g} times as long as usual)"
        )
    return f"  {row.name:<{NAME}}  {measured:>12}  {row.bound + ' ' + row.unit:<16} {verdict}"
