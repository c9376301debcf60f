"""What a crawl reports while it runs, for listeners that write it down or show it."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan
from typing import Final

from tjscan.core.array_fields import FloatOrNan
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import SlipEstimate
from tjscan.laser.profile import Profile
from tjscan.vehicle.vehicle import AT_REST, Twist, VehicleState

SET_DOWN_EVENT: Final = "set-down"
"""Name of the event that states where a vehicle was set down again, by its operator."""


@dataclass(frozen=True, slots=True)
class CrawlCycle:
    """One cycle of the control loop: what was measured, estimated and asked for.

    Parameters
    ----------
    phase : Phase
        What the crawler was doing.
    number : int
        Of the pass, from 1; 0 before the first.
    travel : float
        Along the joint from where the weld begins, by the encoders, metres.
    state : VehicleState
        What the vehicle reports.
    commanded : Twist
        What it was asked for until then.
    torch : TorchEstimate
        Estimate of where the torch's zero is beside the joint.
    torch_y : float
        Position of the torch's axis, to the right of its zero, metres.
    path : float
        How far beside the joint's centre the pass has the torch at this moment, metres.
    arc : bool
        Whether the arc burns.
    d, d_sigma : float, optional
        Laser minus joint as read, and its standard deviation, metres; NaN if it was not read.
    slip : SlipEstimate, optional
        Estimate of the vehicle's slip, if the method has any.
    profile : Profile, optional
        What the laser saw; of a recording in one cycle a millimetre.
    """

    phase: Phase
    number: int
    travel: float
    state: VehicleState
    commanded: Twist
    torch: TorchEstimate
    torch_y: float
    path: float
    arc: bool
    d: FloatOrNan = nan
    d_sigma: FloatOrNan = nan
    slip: SlipEstimate | None = None
    profile: Profile | None = None

    @property
    def was_read(self) -> bool:
        """Whether the joint was read."""
        return isfinite(self.d)

    @property
    def deviation(self) -> float:
        """Of the torch from its path, as estimated, metres, positive to the right."""
        return self.torch.offset + self.torch_y - self.path


def is_by_hand(phase: Phase, commanded: Twist) -> bool:
    """Whether a vehicle is driven by hand: nothing else moves it before a crawl begins."""
    return phase is Phase.MANUAL and commanded != AT_REST


@dataclass(frozen=True, slots=True)
class SimulatedPlace:
    """Where a simulated vehicle and its torch truly are.

    Parameters
    ----------
    pose_w : tuple of float
        x, y in metres and heading in radians of the vehicle, in frame w.
    torch : tuple of float
        Of the torch's zero: along the joint and to the right of it, metres.
    """

    pose_w: tuple[float, ...]
    torch: tuple[float, ...]
