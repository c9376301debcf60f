"""From a twist to the motors of two tracks, and back: equation (10) of Kermorgant (2018)."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import Annotated, Protocol

import numpy as np
from annotated_types import Ge, Le

from tjscan.core.frames import Array, readonly_copy
from tjscan.core.units import MM, SettingsTable
from tjscan.vehicle.vehicle import Twist


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackGeometry(SettingsTable):
    """Sizes of a vehicle's two tracks, as equation (10) takes them.

    Motor rates are the sprockets', behind the gears. The right motor is mounted mirrored:
    if both turn the same way, the vehicle turns on the spot.

    Parameters
    ----------
    sprocket_radius : float
        From the sprocket's axis to the pads' faces, metres. Assumption: the paper gives none.
    gauge : float
        Between the middles of the tracks, metres. Assumption, as above.
    pad_pitch : float
        From pad to pad of a chain, metres: at it the speed of a track ripples.
    """

    sprocket_radius: Annotated[float, Ge(5), Le(500), MM] = 0.05
    gauge: Annotated[float, Ge(50), Le(5000), MM] = 0.4
    pad_pitch: Annotated[float, Ge(5), Le(500), MM] = 0.7 / 24

    def track_speeds(self, twist: Twist) -> Array:
        """Speeds of the vehicle over its left and right track, m/s, shape (2,), without slip."""
        half = self.gauge * twist.turn_rate / 2
        return np.array((twist.speed + half, twist.speed - half))

    def twist(self, left: float, right: float) -> Twist:
        """Twist that the rates of the left and right sprocket, rad/s, show; eq. (10) inverted."""
        r, b = self.sprocket_radius, self.gauge
        return Twist(r * (left - right) / 2, r * (left + right) / b)


class VehiclePlant(Protocol):
    """How a body on two tracks moves over a surface; the truth, which no algorithm sees.

    Its pose is the pose of frame v on the unrolled surface, frame w: x, y in metres and the heading
    in radians, from x towards y. z of both points into the surface, so the heading grows
    clockwise as seen by one who looks at the surface from outside.
    """

    @property
    def pose_w(self) -> Array:
        """Where it is, shape (3,): x and y in metres, and the heading in radians."""

    @property
    def torques(self) -> tuple[float, ...]:
        """Torque of the left and right motor at its sprocket, N m; empty if not modelled."""

    def advance(self, left: float, right: float, period: float) -> None:
        """Let the left and right track run for a period in seconds.

        Parameters
        ----------
        left, right : float
            Speed of the vehicle over a track that does not slip, m/s, forward positive.
        period : float
            Seconds.
        """


def moved_pose(pose_w: Array, twist: Array, period: float) -> Array:
    """Pose x, y, heading after a twist (forward, sideways, clockwise) for a short period.

    The mean heading counts for the whole of the period.
    """
    forward, sideways, turn = twist * period
    heading = pose_w[2] + turn / 2
    c, s = cos(heading), sin(heading)
    return readonly_copy(
        (
            pose_w[0] + c * forward - s * sideways,
            pose_w[1] + s * forward + c * sideways,
            pose_w[2] + turn,
        )
    )
