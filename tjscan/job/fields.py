"""Number types that job files share."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Gt, Le

from tjscan.core.units import FARTHEST_MM

LengthMm = Annotated[float, Gt(0), Le(FARTHEST_MM)]
"""In the unit of the file; a unit after it converts it."""
