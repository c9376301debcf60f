"""Follow a joint as the paper does: a Kalman filter, and a PID from a virtual laser backward.

Kermorgant (2018): the filter as printed, (9) and (10), and 3.2. Its gains, its noise and where the
virtual laser is are not printed; those here are assumptions that reproduce its figures on tracks
that do not slip.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import cos, sin, sqrt, tan
from typing import Annotated, Final

import numpy as np
from annotated_types import Gt, Le

from tjscan.core.frames import Array
from tjscan.core.units import MM, SettingsTable
from tjscan.crawler.method import OffsetEstimate, TorchEstimate
from tjscan.crawler.slip_estimator import CrawlerGeometry
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist, VehicleState

FIRST_STATE_SIGMAS: Final = (1e-3, 1e-2, 5e-3, 20e-3, 50e-3)
"""Of the first estimate."""

LOOP_PERIOD: Final = 0.02
"""Seconds of the paper's tracking loop, for which the process noise below holds."""

PROCESS_VARIANCES: Final = np.array((1e-6, 1e-4, 1e-12, 1e-9, 1e-10))
"""Of one period; the paper prints none (assumption)."""

ENCODER_SIGMA: Final = 2e-3
"""rad/s of a motor's encoder (assumption)."""

READING_SIGMA: Final = 0.12e-3
"""Metres of a reading of the joint (assumption)."""

PROPORTIONAL_GAIN: Final = 1.0
INTEGRAL_GAIN: Final = 0.02
"""Of the paper's PID, rad/s per m and per m s; its derivative needs none (assumption)."""

VIRTUAL_LASER_DISTANCE: Final = 0.3
"""How far the virtual laser is behind the centre of rotation, metres: l' (assumption)."""


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
    y, heading, ahead = (x[PaperState.OFFSET], x[PaperState.HEADING], x[PaperState.LASER_TO_CENTRE])
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
        Whose radius and gauge turn the encoders' noise into noise of speed and turn rate.
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
            self._corrected(value - self.x[which], H, (scale * ENCODER_SIGMA) ** 2)

    def read(self, d: float) -> None:
        """Take in a reading of the joint: laser minus joint, metres."""
        expected, H = paper_laser_offset(self.x)
        self._corrected(d - expected, H, READING_SIGMA**2)

    def _corrected(self, difference: float, H: Array, variance: float) -> None:
        PH = self.P @ H
        gain = PH / (H @ PH + variance)
        self.x = self.x + gain * difference
        self.P = self.P - np.outer(gain, PH)


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperSettings(SettingsTable):
    """The table [paper]: what the paper's filter starts with.

    Parameters
    ----------
    laser_to_centre : float or None
        How far it takes the laser to be ahead of the centre of rotation at first, metres: the
        paper's l, which it learns; what [vehicle] states if left out.
    """

    laser_to_centre: Annotated[float | None, Gt(0), Le(5000), MM] = None


class PaperMethod:
    """A `FollowingMethod` by the paper's filter (9), (10) and control (6), (8).

    Parameters
    ----------
    geometry : CrawlerGeometry
        Where laser and torch sit.
    tracks : TrackGeometry
        Of the vehicle.
    laser_to_centre : float, optional
        As `PaperSettings` has it.
    """

    def __init__(
        self,
        geometry: CrawlerGeometry,
        tracks: TrackGeometry,
        laser_to_centre: float | None = None,
    ) -> None:
        self._geometry, self._tracks = geometry, tracks
        self._laser_to_centre = laser_to_centre
        self.forget_place()

    def forget_place(self) -> None:
        """Forget everything; see `FollowingMethod.forget_place`."""
        geometry, x = self._geometry, np.zeros(5)
        known = geometry.laser_to_torch - geometry.centre_to_torch
        x[PaperState.LASER_TO_CENTRE] = self._laser_to_centre or known
        self._filter = PaperFilter(self._tracks, x, np.diag(np.square(FIRST_STATE_SIGMAS)))
        self._d = self._integral = 0.0
        self._period, self._way = 0.01, 0.0

    def move(self, state: VehicleState, period: float, commanded: Twist) -> tuple[float, float]:
        """Take in a period of motion; see `FollowingMethod.move`."""
        self._period = period
        self._filter.move(state.odometry, period)
        return 0.0, 0.0

    def read(self, d: float, sigma: float) -> None:
        """Take in a reading of the joint."""
        self._d = d
        self._filter.read(d)

    def follow_bend(self) -> bool:
        """False; see `FollowingMethod.follow_bend`."""
        return False

    def check_slip(self) -> None:
        """The paper knows of no slip."""

    def keep_state(self) -> None:
        """The paper smooths nothing."""

    def smoothed_offsets(self) -> tuple[Array, Array]:
        """None; see `keep_state`."""
        return np.empty(0), np.empty(0)

    @property
    def torch(self) -> TorchEstimate:
        """The estimated place of the torch: d - D tan(theta)."""
        heading = float(self._filter.x[PaperState.HEADING])
        D = self._geometry.laser_to_torch
        by_heading = D * (1 + tan(heading) ** 2)
        sigma = by_heading * sqrt(self._filter.P[PaperState.HEADING, PaperState.HEADING])
        return TorchEstimate(self._d - D * tan(heading), sigma, heading)

    @property
    def laser(self) -> OffsetEstimate:
        """Where the laser was when it last saw the joint: the paper goes on from there."""
        return OffsetEstimate(self._d, self.torch.sigma)

    @property
    def slip(self) -> None:
        """The paper knows of no slip."""
        return

    @property
    def laser_to_centre(self) -> tuple[float, float]:
        """The paper's l; see `FollowingMethod.laser_to_centre`."""
        which, x, P = PaperState.LASER_TO_CENTRE, self._filter.x, self._filter.P
        return float(x[which]), sqrt(P[which, which])

    def turn_rate(self, speed: float, *, turns_back: bool = False) -> float:
        """Turn rate by (6) to (8).

        Backward the sign of the law is the other one, which the paper does not state: the virtual
        laser leads, and is turned the other way by the same turn.
        """
        way = float(np.sign(speed))
        if way != self._way:
            self._integral, self._way = 0.0, way
        error = self._control_error(way)
        self._integral += error * self._period
        return -way * (PROPORTIONAL_GAIN * error + INTEGRAL_GAIN * self._integral)

    def _control_error(self, way: float) -> float:
        """Error to control: d forward; backward d + alpha theta, alpha = -(l + l')."""
        if way >= 0:
            return self._d
        x = self._filter.x
        alpha = -(x[PaperState.LASER_TO_CENTRE] + VIRTUAL_LASER_DISTANCE)
        return float(self._d + alpha * x[PaperState.HEADING])
