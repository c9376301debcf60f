"""Lead a vehicle to its pose: a PID controller with the pose's own velocity fed forward."""

from __future__ import annotations

from math import cos, hypot, sin

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.tables import FollowingSettings
from tjscan.vehicle.vehicle import Twist


def wrap_angle(angle: float) -> float:
    """The same angle between -π and π."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def twist_from_velocity(velocity_w: Array, heading: float) -> Twist:
    """Velocity in frame w, (m/s, m/s, rad/s), as the twist of a vehicle of that heading."""
    x, y, turn = velocity_w
    c, s = cos(heading), sin(heading)
    return Twist(float(c * x + s * y), float(turn), float(-s * x + c * y))


def velocity_from_twist(twist: Twist, heading: float) -> Array:
    """A twist's velocity in frame w, (m/s, m/s, rad/s), shape (3,)."""
    c, s, x, y = cos(heading), sin(heading), twist.speed, twist.sideways
    return np.array((c * x - s * y, s * x + c * y, twist.turn_rate))


class PoseFollower:
    """Leads one vehicle to poses that change slowly.

    Parameters
    ----------
    settings : FollowingSettings
        Its gains.
    top_speed : float
        Of the vehicle, m/s.
    top_turn_rate : float
        rad/s.
    """

    def __init__(self, settings: FollowingSettings, top_speed: float, top_turn_rate: float) -> None:
        self._settings, self._top_speed, self._top_turn = settings, top_speed, top_turn_rate
        self.reset()

    def reset(self) -> None:
        """Forget the errors so far, for instance after a halt."""
        self._sum = np.zeros(3)
        self._error: Array | None = None

    def follow(self, pose: Array, target: Array, next_target: Array, period: float) -> Twist:
        """Twist for the next period.

        Parameters
        ----------
        pose : ndarray, shape (3,)
            Of the vehicle now: x, y, heading.
        target, next_target : ndarray, shape (3,)
            Where it is to be now, and at the period's end.
        period : float
            Seconds.
        """
        gains = self._settings
        error = _pose_difference(target, pose)
        ahead = _pose_difference(next_target, target) / period
        slope = np.zeros(3) if self._error is None else (error - self._error) / period
        self._error = error
        sums = self._sum + error * period
        asked = (
            ahead + gains.proportional * error + gains.integral * sums + gains.derivative * slope
        )
        speed = hypot(asked[0], asked[1])
        share = min(1.0, self._top_speed / speed if speed else 1.0)
        turn = float(np.clip(asked[2], -self._top_turn, self._top_turn))
        if share == 1.0 and turn == asked[2]:
            self._sum = sums  # if the vehicle is at its limit the sum would run away
        velocity = np.array((share * asked[0], share * asked[1], turn))
        return twist_from_velocity(velocity, pose[2] + turn * period / 2)


def _pose_difference(to: Array, start: Array) -> Array:
    return np.array((to[0] - start[0], to[1] - start[1], wrap_angle(to[2] - start[2])))
