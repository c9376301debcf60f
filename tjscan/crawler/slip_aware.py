"""Follow a joint with a vehicle that slips, and learn how it slips."""

from __future__ import annotations

from math import sqrt
from typing import Final

from tjscan.crawler.method import LaserEstimate, TorchEstimate
from tjscan.crawler.odometry_filter import OdometryFilter
from tjscan.crawler.slip_estimator import SlipEstimate, SlipEstimator, SlipUncertainty
from tjscan.crawler.slip_model import CrawlerGeometry, SlipState, laser_offset
from tjscan.crawler.steering import SteeringSettings, track_turn_rate
from tjscan.vehicle.vehicle import Twist

DRIVE_LAG: Final = 0.05
"""Seconds: time constant of the drives (assumption)."""


class SlipAwareMethod:
    """A `FollowingMethod` that knows slip, crab and the joint's curvature.

    Parameters
    ----------
    geometry : CrawlerGeometry
    estimate : SlipEstimate
        What is known at first: from a calibration, or `SlipEstimate.before_any_reading`.
    uncertainty : SlipUncertainty
    steering : SteeringSettings
    """

    def __init__(
        self,
        geometry: CrawlerGeometry,
        estimate: SlipEstimate,
        uncertainty: SlipUncertainty,
        steering: SteeringSettings,
    ) -> None:
        self._estimator = SlipEstimator(geometry, estimate, uncertainty)
        self._uncertainty, self._steering = uncertainty, steering
        self._odometry = OdometryFilter(DRIVE_LAG)

    @property
    def slip(self) -> SlipEstimate:
        """What is known now."""
        return self._estimator.estimate

    def move(self, odometry: Twist, period: float, commanded: Twist) -> None:
        """Take in a period of motion; see `FollowingMethod.move`."""
        self._estimator.move(self._odometry.smooth(odometry, period, commanded))

    def read(self, d: float, sigma: float) -> None:
        """Take in a reading of the joint."""
        self._estimator.read(d, sigma)

    def set_down_anew(self) -> None:
        """Forget where the vehicle is; see `FollowingMethod.set_down_anew`."""
        self._estimator.estimate = self.slip.at_new_start(self._uncertainty)
        self._odometry = OdometryFilter(DRIVE_LAG)

    @property
    def torch(self) -> TorchEstimate:
        """The estimated place of the torch."""
        slip = self.slip
        return TorchEstimate(
            float(slip.x[SlipState.OFFSET]),
            slip.sigma(SlipState.OFFSET),
            float(slip.x[SlipState.HEADING]),
        )

    @property
    def laser(self) -> LaserEstimate:
        """The estimated place of the laser."""
        offset, H = laser_offset(self.slip.x, self._estimator.geometry)
        return LaserEstimate(offset, sqrt(float(H @ self.slip.P @ H)))

    def turn_rate(self, speed: float, *, turns_back: bool = False) -> float:
        """Turn rate to ask of the tracks; see `FollowingMethod.turn_rate`."""
        return track_turn_rate(
            self.slip.x,
            speed,
            self._estimator.geometry,
            self._steering,
            turns_back=turns_back,
        )
