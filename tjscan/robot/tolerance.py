"""How well a maker states where the joints of an arm are."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le

from tjscan.core.units import DEG, MM, SettingsTable

if TYPE_CHECKING:
    from tjscan.core.frames import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementTolerance(SettingsTable):
    """Standard deviations of where an arm's joints are about where its model places them.

    **The defaults are assumptions**: what a maker's calibration leaves of an arm of one metre and
    more, 0.3 to 0.5 mm RMS at the flange.

    Parameters
    ----------
    offset : float
        Of a joint's zero, radians.
    length : float
        Of the place of a joint's axis, in each direction, metres.
    twist : float
        Of the tilt of a joint's axis, each way, radians.
    """

    offset: Annotated[float, Ge(0), Le(5), DEG] = radians(0.007)
    length: Annotated[float, Ge(0), Le(5), MM] = 7.5e-5
    twist: Annotated[float, Ge(0), Le(5), DEG] = radians(0.007)

    @property
    def sigmas(self) -> Array:
        """Of one joint, shape (6,): along x, y, z; about x, y, z, where z is the joint's axis."""
        import numpy as np

        return np.array((*[self.length] * 3, self.twist, self.twist, self.offset))
