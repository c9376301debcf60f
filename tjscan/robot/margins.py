"""How far an arm's paths keep from everything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from tjscan.core.units import MM, FileKey, SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ClearanceMargins(SettingsTable):
    """Margins of a path: distances from obstacles and itself, and from singularities.

    Parameters
    ----------
    solids : float
        Distance in metres of the arm and what it carries from everything around.
    own : float
        Distance in metres of the arm from itself and from what it carries.
    singular : float
        Smallest singular value, see `Kinematics.smallest_singular_value`.

    Notes
    -----
    The defaults are assumptions about a cell that was measured with a tape.
    """

    solids: Annotated[float, Ge(0), Le(500), MM.with_key("margin_mm")] = 0.01
    own: Annotated[float, Ge(0), Le(500), MM.with_key("self_margin_mm")] = 0.005
    singular: Annotated[float, Ge(0), Le(1), FileKey("smallest_singular_value")] = 0.02
