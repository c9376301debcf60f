"""The two axes that carry the torch across the joint, and the arc."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol, Self


class TorchAxes(AbstractContextManager["TorchAxes"], Protocol):
    """Torch on its axes, with its arc: the arc is out when it connects, and when it disconnects."""

    @property
    def arc(self) -> bool:
        """Whether the arc burns."""

    def move(self, y: float, z: float, period: float) -> float:
        """Go towards a place, for a period; returns where the torch is across the joint now.

        Parameters
        ----------
        y : float
            To the right of the vehicle's middle, metres.
        z : float
            Out of the hull, metres.
        period : float
            Seconds until the next call.

        Raises
        ------
        VehicleFault
            If it reports a fault, or nothing any more.
        """

    def set_arc(self, *, burning: bool) -> None:
        """Strike the arc, or end it."""


@dataclass
class TorchJog:
    """How far a person has the torch beside its path, by hand.

    Parameters
    ----------
    limit : float
        To either side, metres.
    offset : float, optional
        To the right, metres.
    """

    limit: float
    offset: float = 0.0

    def move(self, by: float) -> None:
        """Go on to the right by metres, up to the limit."""
        self.offset = min(max(self.offset + by, -self.limit), self.limit)


class FixedTorch:
    """A torch without axes that a crawler carries along its middle; a welder strikes the arc."""

    arc = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.arc = False

    def move(self, y: float, z: float, period: float) -> float:
        """Stay in the middle."""
        return 0.0

    def set_arc(self, *, burning: bool) -> None:
        """Note what the event asks of the welder."""
        self.arc = burning


class SimulatedTorchAxes(FixedTorch):
    """Torch axes that go where they are sent as fast as they can, within their reach.

    Parameters
    ----------
    reach : float
        To either side of the vehicle's middle, metres.
    speed : float
        Across the joint, m/s.
    """

    def __init__(self, reach: float, speed: float) -> None:
        self._reach, self._speed = reach, speed
        self.y = self.z = 0.0

    def move(self, y: float, z: float, period: float) -> float:
        """Go towards a place; see `TorchAxes.move`."""
        step = self._speed * period
        wanted = min(max(y, -self._reach), self._reach)
        self.y += min(max(wanted - self.y, -step), step)
        self.z = z
        return self.y
