"""Values that the main process and the client's process exchange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tjscan.core.devices import DeviceIdentity
from tjscan.laser.genicam.settings import Trigger


@dataclass(frozen=True, slots=True)
class StreamSetup:
    """How a laser's stream is set up.

    Parameters
    ----------
    trigger : str
        As in `GigeSettings`.
    pixel_format : str, optional
        Which format to set; where left out, the first of the usual ones that it has.
    chooses_format : bool
        Whether a format is set at all.
    exposure : float, optional
        Seconds of exposure to set.
    rows : int, optional
        Rows of a block to set.
    registers : mapping of int to int
        Registers to write, by their addresses.
    margin : float, optional
        Seconds from the call to the first time stamp that counts, of a laser that runs free; its
        exposure where left out.
    """

    trigger: Trigger
    pixel_format: str | None = None
    chooses_format: bool = False
    exposure: float | None = None
    rows: int | None = None
    registers: Mapping[int, int] = field(default_factory=dict)
    margin: float | None = None


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


@dataclass(frozen=True, slots=True)
class ReceivedBlock:
    """A block that was exposed after it was asked for.

    Parameters
    ----------
    data : bytes
        Its payload.
    pixel_format : str
        Its format.
    columns, rows : int
        Points of a row, and rows.
    exposed : float
        Host's clock when it was exposed, in seconds of `time.monotonic`.
    uncertainty : float
        How far off that may be, in seconds.
    attempts : int
        Triggers that it took.
    """

    data: bytes
    pixel_format: str
    columns: int
    rows: int
    exposed: float
    uncertainty: float
    attempts: int
