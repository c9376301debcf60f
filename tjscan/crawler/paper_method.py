"""Follow a joint as the paper does: a PID forward, the same from a virtual laser backward.

Kermorgant (2018), 3.2. Its gains, its noise and where the virtual laser is are not printed; those
here are assumptions that reproduce its figures on tracks that do not slip.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt, tan
from typing import Final

import numpy as np

from tjscan.crawler.method import LaserEstimate, TorchEstimate
from tjscan.crawler.paper_filter import PaperFilter, PaperState
from tjscan.crawler.slip_model import CrawlerGeometry
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import Twist

FIRST_SIGMAS: Final = (1e-3, 1e-2, 5e-3, 20e-3, 50e-3)
"""Of the first estimate."""


@dataclass(frozen=True, slots=True)
class PaperGains:
    """Gains of the paper's PID, and where its virtual laser is.

    Parameters
    ----------
    proportional, integral, derivative : float
        rad/s per m, per m s, and per m/s.
    virtual_laser : float
        How far the virtual laser lies behind the centre of rotation, metres: l'.
    """

    proportional: float = 1.0
    integral: float = 0.02
    derivative: float = 0.0
    virtual_laser: float = 0.3


class PaperMethod:
    """A `FollowingMethod` by the paper's filter (9), (10) and control (6), (8).

    Parameters
    ----------
    geometry : CrawlerGeometry
        Where laser and torch sit.
    tracks : TrackGeometry
        Of the vehicle.
    gains : PaperGains, optional
    """

    def __init__(
        self, geometry: CrawlerGeometry, tracks: TrackGeometry, gains: PaperGains | None = None
    ) -> None:
        self._geometry, self._tracks = geometry, tracks
        self._gains = gains or PaperGains()
        self.set_down_anew()

    def set_down_anew(self) -> None:
        """Forget everything; see `FollowingMethod.set_down_anew`."""
        geometry, x = self._geometry, np.zeros(5)
        x[PaperState.LASER_TO_CENTRE] = geometry.laser_to_torch - geometry.centre_to_torch
        self._filter = PaperFilter(self._tracks, x, np.diag(np.square(FIRST_SIGMAS)))
        self._d = self._before = self._integral = 0.0
        self._period, self._way = 0.01, 0.0

    def move(self, odometry: Twist, period: float, commanded: Twist) -> None:
        """Take in a period of motion; see `FollowingMethod.move`."""
        self._period = period
        self._filter.move(odometry, period)

    def read(self, d: float, sigma: float) -> None:
        """Take in a reading of the joint."""
        self._d = d
        self._filter.read(d)

    @property
    def torch(self) -> TorchEstimate:
        """The estimated place of the torch: d - D tan(theta)."""
        heading = float(self._filter.x[PaperState.HEADING])
        D = self._geometry.laser_to_torch
        by_heading = D * (1 + tan(heading) ** 2)
        sigma = by_heading * sqrt(self._filter.P[PaperState.HEADING, PaperState.HEADING])
        return TorchEstimate(self._d - D * tan(heading), sigma, heading)

    @property
    def laser(self) -> LaserEstimate:
        """Where the laser was when it last saw the joint: the paper goes on from there."""
        return LaserEstimate(self._d, self.torch.sigma)

    @property
    def slip(self) -> None:
        """The paper knows of no slip."""
        return

    def turn_rate(self, speed: float, *, turns_back: bool = False) -> float:
        """Turn rate by (6) to (8).

        Backward the sign of the law is the other one, which the paper does not state: the virtual
        laser leads, and is turned the other way by the same turn.
        """
        way = float(np.sign(speed))
        if way != self._way:
            self._integral, self._way = 0.0, way
            self._before = self._error(way)
        error = self._error(way)
        self._integral += error * self._period
        slope, self._before = (error - self._before) / self._period, error
        gains = self._gains
        turn = (
            gains.proportional * error + gains.integral * self._integral + gains.derivative * slope
        )
        return -way * turn

    def _error(self, way: float) -> float:
        """Error to control: d forward; backward d + alpha theta, alpha = -(l + l')."""
        if way >= 0:
            return self._d
        x = self._filter.x
        alpha = -(x[PaperState.LASER_TO_CENTRE] + self._gains.virtual_laser)
        return float(self._d + alpha * x[PaperState.HEADING])
