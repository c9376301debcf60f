"""How hard a groove is looked for: quickly first, harder where nothing convincing comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class SearchBudget:
    """Limits of the search for a groove: numbers of hypotheses, pairs and refits.

    Parameters
    ----------
    windows : tuple of int
        Lengths of the windows that propose long sides, in points, each half the one before.
    gap_cost : float
        What an outlier costs the stretch of a long side, in points; less where reflections
        hide most of it.
    refits : int
        How often long sides are fitted again before they are judged.
    kept : int
        Most segments kept as long sides.
    pairs : int
        Most pairs of outer sides tried.
    proposals : int
        Most pairs of points that propose a line between outer sides.
    pool : int
        Most lines that may be one inner side.
    """

    windows: tuple[int, ...]
    gap_cost: float
    refits: int
    kept: int
    pairs: int
    proposals: int
    pool: int


_COARSE, _FINE = (48, 24), (48, 24, 12, 6)

SEARCH_BUDGETS: Final = (
    SearchBudget(_COARSE, gap_cost=0.35, refits=1, kept=6, pairs=3, proposals=64, pool=8),
    SearchBudget(_FINE, gap_cost=0.35, refits=2, kept=8, pairs=3, proposals=360, pool=16),
    SearchBudget(_FINE, gap_cost=0.12, refits=2, kept=16, pairs=8, proposals=360, pool=16),
)
"""One after the other, until a groove is read."""
