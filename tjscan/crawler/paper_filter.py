"""The paper's Kalman filter, as printed: Kermorgant (2018), (9) and (10)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import cos, sin, tan
from typing import Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist

LOOP_PERIOD: Final = 0.02
"""Seconds of the paper's tracking loop, for which the process noise below holds."""

PROCESS_VARIANCES: Final = np.array((1e-6, 1e-4, 1e-12, 1e-9, 1e-10))
"""Of one period; the paper prints none (assumption)."""

ENCODER_SIGMA: Final = 2e-3
"""rad/s of a motor's encoder (assumption)."""

READING_SIGMA: Final = 0.12e-3
"""Metres of a reading of the joint (assumption)."""


class PaperState(IntEnum):
    """The place of each quantity in the paper's state, shape (5,); SI units.

    LASER_TO_CENTRE is the paper's l, OFFSET its y: of the centre of rotation from the joint.
    """

    SPEED = 0
    TURN_RATE = 1
    OFFSET = 2
    HEADING = 3
    LASER_TO_CENTRE = 4


def propagate_paper_state(x: Array, period: float) -> tuple[Array, Array]:
    """State after a period by (9), and its derivative, shape (5, 5)."""
    speed, turn_rate, _, heading, _ = x.tolist()
    after = x.copy()
    after[PaperState.OFFSET] += period * speed * sin(heading)
    after[PaperState.HEADING] += period * turn_rate
    F = np.eye(5)
    F[PaperState.OFFSET, PaperState.SPEED] = period * sin(heading)
    F[PaperState.OFFSET, PaperState.HEADING] = period * speed * cos(heading)
    F[PaperState.HEADING, PaperState.TURN_RATE] = period
    return after, F


def paper_laser_offset(x: Array) -> tuple[float, Array]:
    """Offset of the laser from the joint by (1), and its derivative, shape (5,)."""
    y, heading, ahead = x[PaperState.OFFSET], x[PaperState.HEADING], x[PaperState.LASER_TO_CENTRE]
    H = np.zeros(5)
    H[PaperState.OFFSET] = 1 / cos(heading)
    H[PaperState.HEADING] = (y * sin(heading) + ahead) / cos(heading) ** 2
    H[PaperState.LASER_TO_CENTRE] = tan(heading)
    return float(y / cos(heading) + ahead * tan(heading)), H


@dataclass(slots=True)
class PaperFilter:
    """Extended Kalman filter of `PaperState`.

    Parameters
    ----------
    tracks : TrackGeometry
        Whose radius and gauge turn the encoders' noise into that of speed and turn rate.
    x : ndarray, shape (5,)
        The first estimate.
    P : ndarray, shape (5, 5)
        Its covariance.
    """

    tracks: TrackGeometry
    x: Array
    P: Array

    def move(self, odometry: Twist, period: float) -> None:
        """Go on by a period, and take in what the encoders show at its end.

        The two rows of (10) for the encoders, solved for speed and turn rate: these have
        independent errors if the encoders have.
        """
        self.x, F = propagate_paper_state(self.x, period)
        self.P = F @ self.P @ F.T + np.diag(PROCESS_VARIANCES * (period / LOOP_PERIOD))
        r, b = self.tracks.sprocket_radius, self.tracks.gauge
        for which, value, scale in (
            (PaperState.SPEED, odometry.speed, r / 2**0.5),
            (PaperState.TURN_RATE, odometry.turn_rate, r * 2**0.5 / b),
        ):
            H = np.zeros(5)
            H[which] = 1.0
            self._correct(value - self.x[which], H, (scale * ENCODER_SIGMA) ** 2)

    def read(self, d: float) -> None:
        """Take in a reading of the joint: laser minus joint, metres."""
        expected, H = paper_laser_offset(self.x)
        self._correct(d - expected, H, READING_SIGMA**2)

    def _correct(self, difference: float, H: Array, variance: float) -> None:
        PH = self.P @ H
        gain = PH / (H @ PH + variance)
        self.x = self.x + gain * difference
        rest = np.eye(5) - np.outer(gain, H)
        self.P = rest @ self.P @ rest.T + variance * np.outer(gain, gain)
