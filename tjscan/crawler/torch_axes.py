"""The two axes that carry the torch across the joint, and the arc."""

from __future__ import annotations

from typing import Protocol

from tjscan.crawler.plan import TorchAxesSettings


class TorchAxes(Protocol):
    """Torch on its axes, with its arc."""

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
        """
        ...

    def set_arc(self, *, burning: bool) -> None:
        """Strike the arc, or end it."""
        ...


class SimulatedTorchAxes:
    """Torch axes that go where they are sent as fast as they can, within their reach.

    Parameters
    ----------
    settings : TorchAxesSettings
    """

    def __init__(self, settings: TorchAxesSettings) -> None:
        self._settings = settings
        self.y = self.z = 0.0
        self.arc = False

    def move(self, y: float, z: float, period: float) -> float:
        """Go towards a place; see `TorchAxes.move`."""
        reach, step = self._settings.reach, self._settings.speed * period
        wanted = min(max(y, -reach), reach)
        self.y += min(max(wanted - self.y, -step), step)
        self.z = z
        return self.y

    def set_arc(self, *, burning: bool) -> None:
        """Strike the arc, or end it."""
        self.arc = burning
