"""What the main process and the client exchange, and how their clocks relate.

The laser's clock is read at the beginning of each capture, between two readings of the host's. No
model of the clocks is kept, so nothing has to be learned, and a laser that was restarted is right
at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tjscan.core.devices import DeviceIdentity


@dataclass(frozen=True, slots=True)
class StatedAxis:
    """What a laser states about one coordinate; none if it lacks the feature.

    Parameters
    ----------
    scale, offset : float or None
        In the laser's unit.
    low, high : float or None
        Least and greatest number that it transmits.
    invalid : float or None
        Number of a missing point, if it marks them by one.
    """

    scale: float | None = None
    offset: float | None = None
    low: float | None = None
    high: float | None = None
    invalid: float | None = None


@dataclass(frozen=True, slots=True)
class ConnectedLaser:
    """What is known of a laser once it is connected and set up.

    Parameters
    ----------
    identity : DeviceIdentity
        Who it is.
    address : str
        Its IP address.
    pixel_format : str
        What it sends; empty if that does not describe its payload.
    columns, rows : int
        Points of a row, and rows of a block; 0 if not stated.
    packet_size : int
        Bytes of a packet of the stream, headers included.
    unit, output_mode : str or None
        Of its coordinates.
    x, z : StatedAxis
        What it states about its numbers.
    exposure : float or None
        Seconds.
    latches : bool
        Whether its clock can be read.
    ticks_per_second : int
        Of its clock; 0 if not stated.
    """

    identity: DeviceIdentity
    address: str
    pixel_format: str
    columns: int
    rows: int
    packet_size: int
    unit: str | None
    output_mode: str | None
    x: StatedAxis
    z: StatedAxis
    exposure: float | None
    latches: bool
    ticks_per_second: int = 0


@dataclass(frozen=True, slots=True)
class StampedBlock:
    """A block as it came, and when it was exposed on the laser's own clock.

    Parameters
    ----------
    data : bytes
        Its payload.
    pixel_format : str
        Its format.
    columns, rows : int
        Points of a row, and rows.
    number : int
        Of the block: those that follow one another in a stream rise by one.
    ticks : int
        Of the laser's clock when its exposure began; 0 if it does not say.
    came : float
        When it came, in seconds of `time.monotonic`.
    """

    data: bytes
    pixel_format: str
    columns: int
    rows: int
    number: int
    ticks: int
    came: float


@dataclass(frozen=True, slots=True)
class CapturedBlock:
    """A block that was exposed after it was asked for.

    Parameters
    ----------
    block : StampedBlock
        What came.
    exposed : float
        Host's clock when it was exposed, in seconds of `time.monotonic`.
    uncertainty : float
        How far off that may be, in seconds.
    attempts : int
        Triggers that it took.
    x, z : StatedAxis
        What the laser states about its numbers then.
    """

    block: StampedBlock
    exposed: float
    uncertainty: float
    attempts: int
    x: StatedAxis
    z: StatedAxis


LARGEST_CLOCK_DRIFT: Final = 1e-4
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
    def midpoint(self) -> float:
        """The middle of the span."""
        return (self.begin + self.end) / 2

    @property
    def half_length(self) -> float:
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
    spread = LARGEST_CLOCK_DRIFT * abs(later)
    return HostInterval(read.begin + later - spread, read.end + later + spread)


def exposure_on_cell_clock(
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
    return cell + (exposed - cell_read.midpoint), uncertainty + cell_read.half_length
