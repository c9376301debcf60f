"""What a simulated arm needs to know of itself."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Annotated

from annotated_types import Ge, Le

from tjscan.core.units import DEG, MM, SettingsTable

JointAngles = Annotated[tuple[Annotated[float, Ge(-720), Le(720)], ...], DEG]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmSimulationSettings(SettingsTable):
    """The table [simulation.arm]: home position and repeatability of the simulated arm.

    Parameters
    ----------
    home : tuple of float
        Joint angles it starts with, radians.
    repeatability : float
        Root mean square of the distance between the true and the reported flange, metres.
        Assumption, after the ±0.05 mm the maker states for a UR10e.
    angular_repeatability : float
        The same of the angle, radians. Assumption: about the above over half a metre of arm.
    realtime : bool
        Whether moves take as long as they say.
    """

    home: JointAngles
    repeatability: Annotated[float, Ge(0), Le(5), MM] = 5e-5
    angular_repeatability: Annotated[float, Ge(0), Le(5), DEG.with_key("repeatability_deg")] = (
        radians(0.006)
    )
    realtime: bool = False
