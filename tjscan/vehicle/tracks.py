"""From a twist to the motors of two tracks, and back: equation (10) of Kermorgant (2018)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from tjscan.core.units import MM, SettingsTable
from tjscan.vehicle.vehicle import Twist


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackGeometry(SettingsTable):
    """Sizes of a vehicle's two tracks, as equation (10) takes them.

    Motor rates are those of the sprockets, behind the gears. The right motor is mounted mirrored:
    where both turn the same way, the vehicle turns on the spot.

    Parameters
    ----------
    sprocket_radius : float
        From the sprocket's axis to the pads' faces, metres. Assumption: the paper does not say.
    gauge : float
        Between the middles of the tracks, metres. Assumption, as above.
    """

    sprocket_radius: Annotated[float, Ge(5), Le(500), MM] = 0.05
    gauge: Annotated[float, Ge(50), Le(5000), MM] = 0.4

    def motor_rates(self, twist: Twist) -> tuple[float, float]:
        """Rates of the left and right sprocket, rad/s, that a twist asks for; eq. (10)."""
        r, b = self.sprocket_radius, self.gauge
        v, w = twist.speed, twist.turn_rate
        return v / r + b * w / (2 * r), -v / r + b * w / (2 * r)  # eq. (10)

    def twist(self, left: float, right: float) -> Twist:
        """Twist that the rates of the left and right sprocket, rad/s, show; eq. (10) inverted."""
        r, b = self.sprocket_radius, self.gauge
        return Twist(r * (left - right) / 2, r * (left + right) / b)
