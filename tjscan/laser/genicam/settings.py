"""How to reach a GenICam laser, and how to read its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, MinLen

from tjscan.core.units import MICROSECONDS, MILLISECONDS, MM, SECONDS, SettingsTable

FeatureValue = str | int | float | bool


@dataclass(frozen=True, slots=True, kw_only=True)
class GigeSettings(SettingsTable):
    """What all lasers behind GigE Vision share.

    Parameters
    ----------
    address, serial : str, optional
        Which laser: its IP address, its serial number, or both. Where there is a serial number,
        no other laser is accepted, and calibrations hold for this one.
    trigger : str
        ``software``: one profile for each trigger. ``fresh``: it runs free, and what was exposed
        before the call is thrown away.
    attempts : int
        Triggers until a profile that does not come is given up.
    timeout : float
        Seconds to wait for the profile of one trigger.
    connect_limit : float
        Seconds a connection may take.
    packet_size : int, optional
        Bytes of a packet of the stream; what the laser has set where left out.
    features : mapping
        Any further feature by its name, set when it connects.
    """

    address: Annotated[str | None, MinLen(1)] = None
    serial: Annotated[str | None, MinLen(1)] = None
    trigger: Literal["software", "fresh"] = "software"
    attempts: Annotated[int, Ge(1), Le(20)] = 3
    timeout: Annotated[float, Ge(10), Le(10_000), MILLISECONDS] = 0.3
    connect_limit: Annotated[float, Ge(1), Le(120), SECONDS.with_key("connect_s")] = 10.0
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
    pixel_format : str, optional
        Name of the format; where left out, the first of Coord3D_AC16, Coord3D_AC32f and
        Coord3D_C16 that the laser has.
    exposure : float, optional
        Seconds of exposure; what the laser has set where left out.
    rows : int
        Rows of a block, of which the first is the profile; for lasers that send no fewer.
    scale, offset : tuple of float, optional
        Of x and z, in metres per count and metres, instead of what the laser states.
    invalid : float, optional
        Raw z of a missing point, instead of what the laser states.
    axis_limits : bool
        Whether points outside the laser's Scan3dAxisMin and Scan3dAxisMax are missing.
    flip_x, flip_z : bool
        Whether the laser's axes point against those of frame s.
    """

    pixel_format: Annotated[str | None, MinLen(1)] = None
    exposure: Annotated[float | None, Gt(0), Le(10_000_000), MICROSECONDS] = None
    rows: Annotated[int, Ge(1), Le(10_000)] = 1
    scale: Annotated[Pair | None, MM] = None
    offset: Annotated[Pair | None, MM] = None
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
