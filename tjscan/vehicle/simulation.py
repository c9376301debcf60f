"""What a simulated vehicle needs to know of itself and of the surface it drives on."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians
from typing import Annotated, Final, Literal

from annotated_types import Ge, Le

from tjscan.core.units import DEG, FileUnit, SettingsTable
from tjscan.vehicle.drives import DriveSettings
from tjscan.vehicle.pad_plant import PadSettings
from tjscan.vehicle.slip_plant import SlipSettings
from tjscan.vehicle.steel import Outline, ProximitySettings, SurfacePoint

DEG_S: Final = FileUnit("deg_s", radians(1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSimulationSettings(SettingsTable):
    """The table [simulation.vehicle]: where a simulated vehicle stands, and how it moves.

    Parameters
    ----------
    start : tuple of float
        x and y of its origin on the unrolled surface, frame w, metres.
    heading : float
        From x of w towards y of w, radians: clockwise seen from outside.
    plant : str
        ``slip``: the tracks slip by given ratios. ``pads``: by the friction of each pad.
    slip : SlipSettings
        For the plant ``slip``.
    pads : PadSettings
        For the plant ``pads``; of the other they give the motors' torques alone.
    drives : DriveSettings
        How the tracks follow.
    encoder_noise : float
        Standard deviation of a sprocket's rate as its encoder shows it, rad/s. Assumption.
    proximity : ProximitySettings
        Sensors at the corners.
    steel : tuple of points
        Outline of the steel in frame w, metres; without one there is steel everywhere.
    """

    start: SurfacePoint = (0.0, 0.0)
    heading: Annotated[float, Ge(-360), Le(360), DEG] = 0.0
    plant: Literal["slip", "pads"] = "slip"
    slip: SlipSettings = field(default_factory=SlipSettings)
    pads: PadSettings = field(default_factory=PadSettings)
    drives: DriveSettings = field(default_factory=DriveSettings)
    encoder_noise: Annotated[float, Ge(0), Le(60), DEG_S] = 2e-3
    proximity: ProximitySettings = field(default_factory=ProximitySettings)
    steel: Outline = ()
