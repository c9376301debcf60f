"""What a crawl reports while it runs, to whoever writes it down or shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Final, Protocol

from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import SlipEstimate
from tjscan.laser.profile import Profile
from tjscan.vehicle.vehicle import REST, Twist, VehicleState

SET_DOWN: Final = "set-down"
"""Name of the event that says where a vehicle was set down anew, as its operator says."""


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
        Where the torch's zero is estimated to be beside the joint.
    torch_y : float
        Where the torch's axis stands, to the right of its zero, metres.
    path : float
        How far beside the joint's centre the pass has the torch at this moment, metres.
    arc : bool
        Whether the arc burns.
    d, d_sigma : float, optional
        Laser minus joint as read, and its standard deviation, metres; NaN where it was not read.
    slip : SlipEstimate, optional
        What is estimated of the vehicle's slip, where the method knows of any.
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
    d: float = nan
    d_sigma: float = nan
    slip: SlipEstimate | None = None

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
    return phase is Phase.MANUAL and commanded != REST


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


class CrawlJournal(Protocol):
    """Receives everything of a crawl at once, in the order it happens."""

    def record_cycle(self, cycle: CrawlCycle, profile: Profile | None) -> None:
        """Note a cycle, and the profile it was read from, if one came."""
        ...

    def record_event(self, name: str, detail: str) -> None:
        """Note that something happened: a phase, a stop, a fault.

        Parameters
        ----------
        name : str
            What, in a word.
        detail : str
            The same in a sentence.
        """
        ...


class CombinedCrawlJournal:
    """Passes everything on to several journals, in their order.

    Parameters
    ----------
    journals : sequence of CrawlJournal
        The one that writes to disk comes first.
    """

    def __init__(self, journals: Sequence[CrawlJournal] = ()) -> None:
        self._journals = tuple(journals)

    def record_cycle(self, cycle: CrawlCycle, profile: Profile | None) -> None:
        """Pass a cycle on."""
        for journal in self._journals:
            journal.record_cycle(cycle, profile)

    def record_event(self, name: str, detail: str) -> None:
        """Pass an event on."""
        for journal in self._journals:
            journal.record_event(name, detail)
