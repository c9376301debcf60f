"""What a simulated vehicle truly does on the surface: what every plant gives."""

from __future__ import annotations

from math import cos, sin
from typing import Protocol

from tjscan.core.frames import Array, readonly_copy


class VehiclePlant(Protocol):
    """How a body on two tracks moves over a surface; the truth, which no algorithm sees.

    Its pose is that of frame v on the unrolled surface, frame w: x, y in metres and the heading
    in radians, from x towards y. z of both points into the surface, so the heading grows
    clockwise as seen by one who looks at the surface from outside.
    """

    @property
    def pose_w(self) -> Array:
        """Where it is, shape (3,): x and y in metres, and the heading in radians."""
        ...

    @property
    def torques(self) -> tuple[float, ...]:
        """Torque of the left and right motor at its sprocket, N m; empty where not modelled."""
        ...

    def advance(self, left: float, right: float, period: float) -> None:
        """Let the left and right track run for a period in seconds.

        Parameters
        ----------
        left, right : float
            Speed of the vehicle over a track that does not slip, m/s, forward positive.
        period : float
            Seconds.
        """
        ...


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
