"""How a groove is looked for: the settings of a job, and how hard the search tries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from annotated_types import Ge, Gt, Le

from tjscan.core.units import MM, ChosenByName, SettingsTable
from tjscan.groove.models import GROOVE_MODELS, TEE_GROOVE, GrooveModel


@dataclass(frozen=True, slots=True)
class GrooveSettings(SettingsTable):
    """Settings for reading grooves: the table [groove].

    Parameters
    ----------
    model : GrooveModel
        What it looks like.
    noise : float
        Largest standard deviation of the range that is expected, in metres.
    minimum_points : int
        Fewest points of a profile that are worth a search.
    largest_sigma : float
        Largest standard deviation of a corner that is still an answer, in metres.
    largest_rms : float
        Largest deviation of the points from the fitted sides, in metres (rms).
    inlier_share : float
        Least share of a side's points that must lie on it.
    """

    model: Annotated[GrooveModel, ChosenByName(GROOVE_MODELS)] = TEE_GROOVE
    noise: Annotated[float, Gt(0), Le(5), MM] = 0.05e-3
    minimum_points: Annotated[int, Ge(20), Le(10_000)] = 80
    largest_sigma: Annotated[float, Gt(0), Le(10), MM] = 0.6e-3
    largest_rms: Annotated[float, Gt(0), Le(10), MM] = 0.15e-3
    inlier_share: Annotated[float, Gt(0), Le(1)] = 0.1

    def __post_init__(self) -> None:
        if not (self.noise > 0 and self.largest_sigma > 0 and self.largest_rms > 0):
            raise ValueError("noise, largest_sigma and largest_rms must be positive")

    @property
    def support_tolerance(self) -> float:
        """Distance from a hypothesis within which points support it, in metres."""
        return TOLERANCE_SIGMAS * self.noise


TOLERANCE_SIGMAS: Final = 4.0
"""The tolerance in expected standard deviations."""

DEFAULT_SETTINGS: Final = GrooveSettings()


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
