"""What a method of following a joint does, whichever it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

from tjscan.core.frames import Array
from tjscan.crawler.slip_estimator import SlipEstimate
from tjscan.vehicle.vehicle import Twist, VehicleState

SURE_SIGMAS: Final = 3.0
"""Standard deviations within which something surely is."""


@dataclass(frozen=True, slots=True)
class OffsetEstimate:
    """The estimated place of the laser, or of the torch, beside the joint.

    Parameters
    ----------
    offset, sigma : float
        From the joint, positive to the right, metres, and its standard deviation.
    """

    offset: float
    sigma: float

    def surely_within(self, limit: float) -> bool:
        """Whether the joint surely lies within a distance of it, metres."""
        return abs(self.offset) + SURE_SIGMAS * self.sigma < limit


@dataclass(frozen=True, slots=True)
class TorchEstimate(OffsetEstimate):
    """The estimated place of the torch beside the joint.

    Parameters
    ----------
    heading : float
        Angle from the joint to the vehicle, radians, clockwise positive.
    """

    heading: float


class FollowingMethod(Protocol):
    """Estimates where the torch is, and steers so that it comes to the joint."""

    def move(self, state: VehicleState, period: float, commanded: Twist) -> tuple[float, float]:
        """Take in a period of motion.

        Parameters
        ----------
        state : VehicleState
            At its end: what encoders and inertial sensors show.
        period : float
            Seconds.
        commanded : Twist
            What the drives were asked for meanwhile.

        Returns
        -------
        gyro, down : float
            How far a sample of gyro and inclinometer was off from what was expected, over the
            standard deviation of a mean over `INERTIAL_MEAN_TIME`; 0 without one.
        """

    def read(self, d: float, sigma: float) -> tuple[float, float] | None:
        """Take in a reading of the joint: laser minus joint, and its sigma; metres.

        Returns
        -------
        surprise, aside : float
            How far it was off from what was expected, as far as the estimate's own uncertainty does
            not explain it; and how far readings went aside by more than the vehicle's motion
            explains, whatever the estimate made of them; metres. None if the method can't tell.
        """

    def follow_bend(self) -> bool:
        """Take the joint for one that bends about where the laser sees it, and begin again.

        All that was estimated is forgotten but where else it bends: the bend was taken for slip.

        Returns
        -------
        bool
            Whether it does so: not if it is known to bend there, for then something else is wrong,
            or if the method knows straight joints alone.
        """

    def check_slip(self) -> None:
        """Look whether a vehicle can slip as was learned.

        Raises
        ------
        CrawlStopped
            If it can't, by what was stated of it: the joint was taken for another one.
        """

    def keep_state(self) -> None:
        """Keep what is estimated now, so that it is smoothed by what is measured later."""

    def smoothed_offsets(self) -> tuple[Array, Array]:
        """Offset of the torch at each kept state, by all that was measured since; then forget them.

        Returns
        -------
        offsets, sigmas : ndarray, shape (n,)
            From the joint, positive to the right, and their standard deviations, metres; n is 0 if
            the method can't state them.
        """

    def forget_place(self) -> None:
        """Forget where the vehicle is beside the joint, not how it slips: it was moved by hand."""

    @property
    def torch(self) -> TorchEstimate:
        """The estimated place of the torch."""

    @property
    def laser(self) -> OffsetEstimate:
        """The estimated place of the laser, whether it sees the joint or not."""

    @property
    def slip(self) -> SlipEstimate | None:
        """The estimated slip of the vehicle; None if the method estimates none."""

    @property
    def laser_to_centre(self) -> tuple[float, float]:
        """How far the laser is ahead of the centre of rotation, and its standard deviation, metres.

        NaN by a method that does not estimate it as the paper does.
        """

    def turn_rate(self, speed: float, *, turns_back: bool = False) -> float:
        """Turn rate to ask of the tracks at a speed, rad/s.

        Parameters
        ----------
        speed : float
            Forward, m/s.
        turns_back : bool, optional
            Whether the vehicle is about to turn back.
        """
