"""Smooth what the encoders show by what was asked of the drives."""

from __future__ import annotations

from math import copysign, exp
from typing import Final

from tjscan.crawler.slip_model import SETTLING_LENGTH, TrackOdometry
from tjscan.vehicle.vehicle import REST, Twist

AVERAGING_TIME: Final = 0.5
"""Seconds over which encoders are averaged about what was asked."""


SPEED_RAMP: Final = 2e-3
TURN_RAMP: Final = 10e-3
"""m/s and rad/s: encoders this far from what was asked show a ramp, not noise, and count alone."""

CREEPING_SPEED: Final = 1e-3
"""m/s: what is slower shows no curvature, its turn being divided by hardly anything."""


class OdometryFilter:
    """The tracks' motion: what drives of a known lag make of a command, corrected by the encoders.

    Noise of the encoders would else bias the yaw efficiency, which multiplies it: errors in a
    regressor make its coefficient too small.

    Parameters
    ----------
    drive_lag : float
        Time constant of the drives, seconds.
    """

    def __init__(self, drive_lag: float) -> None:
        self._lag = drive_lag
        self._speed = self._turn_rate = 0.0
        self._way, self._recent_turn = 0.0, 0.0

    def smooth(self, measured: Twist, period: float, commanded: Twist = REST) -> TrackOdometry:
        """Motion over the period that has just passed.

        Parameters
        ----------
        measured : Twist
            What the encoders show.
        period : float
            Seconds.
        commanded : Twist
            What the drives were asked for meanwhile.
        """
        follow, correct = min(period / self._lag, 1.0), min(period / AVERAGING_TIME, 1.0)
        speed = self._speed + follow * (commanded.speed - self._speed)
        turn_rate = self._turn_rate + follow * (commanded.turn_rate - self._turn_rate)
        ramps = (
            abs(measured.speed - speed) > SPEED_RAMP
            or abs(measured.turn_rate - turn_rate) > TURN_RAMP
        )
        correct = 1.0 if ramps else correct
        self._speed = speed + correct * (measured.speed - speed)
        self._turn_rate = turn_rate + correct * (measured.turn_rate - turn_rate)
        turned_back = False
        if abs(self._speed) > CREEPING_SPEED:
            way = copysign(1.0, self._speed)
            turned_back = way == -self._way
            if way != self._way:
                self._way, self._recent_turn = way, 0.0
            new = 1 - exp(-abs(self._speed) * period / SETTLING_LENGTH)
            self._recent_turn += new * (self._turn_rate / abs(self._speed) - self._recent_turn)
        return TrackOdometry(self._speed, self._turn_rate, period, self._recent_turn, turned_back)
