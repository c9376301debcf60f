"""From a laser's clock to the host's, and from there to the cell's, with what is not known.

The laser's clock is read at the beginning of each capture, between two readings of the host's. No
model of the clocks is kept, so nothing has to be learned, and a laser that was restarted is right
at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

CLOCK_DRIFT: Final = 1e-4
"""How much two clocks may differ in rate: quartz is within 50 parts in a million."""


@dataclass(frozen=True, slots=True)
class HostInterval:
    """Span of the host's clock within which something happened, in seconds.

    Parameters
    ----------
    begin, end : float
        Earliest and latest.
    """

    begin: float
    end: float

    @property
    def middle(self) -> float:
        """The middle of the span."""
        return (self.begin + self.end) / 2

    @property
    def half(self) -> float:
        """Half its length."""
        return (self.end - self.begin) / 2


def host_time_of_exposure(ticks: int, ticks_per_second: int, read: HostInterval) -> HostInterval:
    """When a profile was exposed, on the host's clock.

    Parameters
    ----------
    ticks : int
        Of the laser's clock from its reading to the exposure.
    ticks_per_second : int
        Of the laser's clock.
    read : HostInterval
        When the laser's clock was read.
    """
    later = ticks / ticks_per_second
    spread = CLOCK_DRIFT * abs(later)
    return HostInterval(read.begin + later - spread, read.end + later + spread)


def cell_time_of_exposure(
    exposed: float, uncertainty: float, cell: float, cell_read: HostInterval
) -> tuple[float, float]:
    """When a profile was exposed on the cell's clock, and how far off that may be, in seconds.

    Parameters
    ----------
    exposed, uncertainty : float
        The same on the host's clock.
    cell : float
        What the cell's clock showed.
    cell_read : HostInterval
        When it was read, on the host's clock.
    """
    return cell + (exposed - cell_read.middle), uncertainty + cell_read.half
