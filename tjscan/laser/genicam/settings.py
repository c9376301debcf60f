"""The job tables [laser.genicam] and [laser.scancontrol]."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Final, Literal

from annotated_types import Ge, Gt, Le, MinLen

from tjscan.core import units
from tjscan.core.units import SettingsTable

FeatureValue = str | int | float | bool
Trigger = Literal["software", "fresh"]
FieldName = Literal["z", "x", "threshold", "intensity", "width", "moment0", "moment1"]


@dataclass(frozen=True, slots=True)
class ScanControlScale:
    """What one count is worth, and z of the middle of the counts.

    Parameters
    ----------
    scale : float
        Metres for each count, of x and z.
    offset : float
        z of the raw number 32768, in metres.
    """

    scale: float
    offset: float


SCANCONTROL_SCALES: Final = {
    "2600-10": ScanControlScale(0.5e-6, 0.055),
    "2600-25": ScanControlScale(1e-6, 0.065),
    "2600-50": ScanControlScale(2e-6, 0.095),
    "2600-100": ScanControlScale(5e-6, 0.250),
}
"""Of the models that the specification lists."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GigeSettings(SettingsTable):
    """What all lasers behind GigE Vision share.

    Parameters
    ----------
    address, serial : str, optional
        Which laser: its IP address, its serial number, or both. If there is a serial number,
        no other laser is accepted, and calibrations hold for this one.
    attempts : int
        Triggers until a profile that does not come is given up. A network that loses one packet
        in twenty loses one trigger's leader or trailer in ten, and five in a row in 10^5.
    timeout : float
        Seconds to wait for the profile of one trigger.
    connect_limit : float
        Seconds a connection may take.
    packet_size : int, optional
        Bytes of a packet of the stream; what the laser has set if left out.
    features : mapping
        Any further feature by its name, set when it connects.
    """

    address: Annotated[str | None, MinLen(1)] = None
    serial: Annotated[str | None, MinLen(1)] = None
    attempts: Annotated[int, Ge(1), Le(20)] = 5
    timeout: Annotated[float, Ge(10), Le(10_000), units.MILLISECONDS] = 0.3
    connect_limit: Annotated[float, Ge(1), Le(120), units.SECONDS.with_key("connect_s")] = 10.0
    packet_size: Annotated[int | None, Ge(576), Le(9000)] = None
    features: Mapping[str, FeatureValue] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.address is None and self.serial is None:
            raise ValueError("needs address or serial: which laser it is")


Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class GenicamSettings(GigeSettings):
    """The table [laser.genicam].

    Parameters
    ----------
    trigger : str
        ``software``: one profile for each trigger. ``fresh``: it runs free, and what was exposed
        before the call is thrown away.
    pixel_format : str, optional
        Name of the format; if left out, the first of Coord3D_AC16, Coord3D_AC32f and
        Coord3D_C16 that the laser has.
    exposure : float, optional
        Seconds of exposure; what the laser has set if left out.
    rows : int
        Rows of a block, the first one the profile; for lasers that send no fewer.
    scale, offset : tuple of float, optional
        Of x and z, in metres per count and metres, instead of what the laser states.
    invalid : float, optional
        Raw z of a missing point, instead of what the laser states.
    axis_limits : bool
        Whether points outside the laser's Scan3dAxisMin and Scan3dAxisMax are missing.
    flip_x, flip_z : bool
        Whether the laser's axes point against the axes of frame s.
    """

    trigger: Trigger = "software"
    pixel_format: Annotated[str | None, MinLen(1)] = None
    exposure: Annotated[float | None, Gt(0), Le(10_000_000), units.MICROSECONDS] = None
    rows: Annotated[int, Ge(1), Le(10_000)] = 1
    scale: Annotated[Pair | None, units.MM] = None
    offset: Annotated[Pair | None, units.MM] = None
    invalid: float | None = None
    axis_limits: bool = True
    flip_x: bool = False
    flip_z: bool = False

    def __post_init__(self) -> None:
        GigeSettings.__post_init__(self)
        if (self.scale is None) != (self.offset is None):
            raise ValueError("scale_mm and offset_mm need each other: [x, z]")
        if self.scale is not None and not all(self.scale):
            raise ValueError("scale_mm can't be 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanControlSettings(GigeSettings):
    """The table [laser.scancontrol], as the sensor is set up.

    It runs free: it knows no trigger by software.

    Parameters
    ----------
    model : str, optional
        One of those whose scale the specification lists, such as ``2600-100``.
    scale, offset : float, optional
        What a count is, and z of the middle of the counts, metres; of other models.
    layout : str
        ``full`` profile, or ``container``.
    points : int
        Points of a profile.
    reflection : int
        Which of the four reflections of a full profile, from 1.
    fields : tuple of str
        Of the container.
    time_stamp, little_endian : bool
        Whether a container's rows end in a time stamp, and how its numbers are stored.
    flip_x, flip_z : bool
        Whether the axes are turned round.
    registers : mapping
        Registers to write when it connects, by their addresses such as ``0xf0f0081c``.
    margin : float
        Seconds from the call to the first time stamp of the stream that counts.
    """

    model: Annotated[str | None, MinLen(1)] = None
    scale: Annotated[float | None, Gt(0), Le(1), units.MM] = None
    offset: Annotated[float | None, Ge(0), Le(5000), units.MM] = None
    layout: Literal["full", "container"] = "full"
    points: Literal[80, 160, 320, 640] = 640
    reflection: Annotated[int, Ge(1), Le(4)] = 1
    fields: Annotated[tuple[FieldName, ...], MinLen(2), units.LIST_OR_WORD_IN_FILE] = (
        "z",
        "x",
    )
    time_stamp: bool = True
    little_endian: bool = False
    flip_x: bool = False
    flip_z: bool = False
    registers: Mapping[str, Annotated[int, Ge(0), Le(0xFFFF_FFFF)]] = field(default_factory=dict)
    margin: Annotated[float, Ge(0), Le(10_000), units.MILLISECONDS] = 0.04

    def __post_init__(self) -> None:
        GigeSettings.__post_init__(self)
        stated = self.scale is not None and self.offset is not None
        if (self.scale is None) != (self.offset is None) or stated == (self.model is not None):
            raise ValueError("needs either model, or scale_mm and offset_mm from its manual")
        if self.model is not None and self.model not in SCANCONTROL_SCALES:
            raise ValueError(
                f"model is one of {', '.join(SCANCONTROL_SCALES)}; else state scale_mm, offset_mm"
            )
        if not {"z", "x"} <= set(self.fields):
            raise ValueError("fields need z and x")
        for address in self.registers:
            if re.fullmatch("0x[0-9a-fA-F]{1,8}", address) is None:
                raise ValueError(f"{address!r} is no address, such as 0xf0f0081c")

    @property
    def count_scale(self) -> ScanControlScale:
        """Scale and offset of its model, or those that the job states."""
        if self.scale is not None and self.offset is not None:
            return ScanControlScale(self.scale, self.offset)
        return SCANCONTROL_SCALES[str(self.model)]
