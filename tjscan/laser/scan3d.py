"""From the numbers that a GenICam sensor sends to a profile in frame s.

Formats as in GenICam's Pixel Format Naming Convention; scale, offset, invalid value and limits as
in its Standard Features Naming Convention (SFNC), chapter 3D Scan Control: coordinate = raw value
times Scan3dCoordinateScale plus Scan3dCoordinateOffset. A is x, C is z. Data is little-endian.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import Final

import numpy as np

from tjscan.core.errors import ProfileFormatRefused
from tjscan.core.frames import Array
from tjscan.laser.profile import Profile

MOST_POINTS_IN_ROW: Final = 65_536
"""Longer rows are refused: no line laser has as many columns."""


@dataclass(frozen=True, slots=True)
class CoordinateFormat:
    """Layout of one point.

    Parameters
    ----------
    code : int
        Of the pixel format.
    dtype : str
        Of each number.
    components : str
        What the numbers of a point are, A, B or C.
    """

    code: int
    dtype: str
    components: str

    @property
    def point_size(self) -> int:
        """Bytes of a point."""
        return np.dtype(self.dtype).itemsize * len(self.components)

    def raw_range(self, axis: AxisScale) -> tuple[float, float]:
        """Least and greatest raw number of an axis: its limits, and what its numbers hold."""
        kind = np.dtype(self.dtype)
        low, high = (0.0, float(np.iinfo(kind).max)) if kind.kind == "u" else (-inf, inf)
        return max(low, axis.low), min(high, axis.high)

    @property
    def has_x(self) -> bool:
        """Whether points state x; where they do not, x follows from the column."""
        return "A" in self.components


COORDINATE_FORMATS: Final = {
    "Coord3D_AC16": CoordinateFormat(0x022000BB, "<u2", "AC"),
    "Coord3D_AC32f": CoordinateFormat(0x024000C2, "<f4", "AC"),
    "Coord3D_ABC32f": CoordinateFormat(0x026000C0, "<f4", "ABC"),
    "Coord3D_C16": CoordinateFormat(0x011000B8, "<u2", "C"),
    "Coord3D_C32f": CoordinateFormat(0x012000BF, "<f4", "C"),
    "Mono16": CoordinateFormat(0x01100007, "<u2", "C"),
}
"""Formats that can be read, by name. Mono16 holds heights in some sensors, and brightness in
others: it is read if a job states its scale."""


@dataclass(frozen=True, slots=True)
class AxisScale:
    """How the raw numbers of one axis become metres in frame s.

    Parameters
    ----------
    scale, offset : float
        Coordinate = scale * raw + offset, in metres; where points state no x, its raw number is
        the column.
    low, high : float
        Raw numbers outside of these are missing points: SFNC states its Scan3dAxisMin and
        Scan3dAxisMax as transmitted.
    """

    scale: float
    offset: float = 0.0
    low: float = -inf
    high: float = inf

    def __post_init__(self) -> None:
        if not (isfinite(self.scale) and isfinite(self.offset) and self.scale != 0):
            raise ProfileFormatRefused(
                f"a scale of {1e3 * self.scale:g} mm and an offset of {1e3 * self.offset:g} mm "
                "give no coordinates"
            )

    def flipped_axis(self) -> AxisScale:
        """The same axis pointing the other way."""
        return AxisScale(-self.scale, -self.offset, self.low, self.high)

    def coordinates_of_raw(self, raw: Array) -> Array:
        """Coordinates of raw numbers, in metres; NaN outside the limits."""
        with np.errstate(over="ignore", invalid="ignore"):
            found = self.scale * raw + self.offset
            return np.where((raw >= self.low) & (raw <= self.high), found, np.nan)


@dataclass(frozen=True, slots=True)
class Scan3dScales:
    """What a sensor, or the job, states about its numbers.

    Parameters
    ----------
    x, z : AxisScale
        The two axes.
    invalid : float, optional
        Raw z of a point that is missing. Numbers that are no number are missing anyway.
    """

    x: AxisScale
    z: AxisScale
    invalid: float | None = None


def profile_of_row(raw: bytes, pixel_format: str, scales: Scan3dScales) -> Profile:
    """Profile from the bytes of one row, whose time these do not hold.

    Parameters
    ----------
    raw : bytes
        The points of the row, one after another.
    pixel_format : str
        One of `COORDINATE_FORMATS`.
    scales : Scan3dScales
        What the numbers mean.

    Raises
    ------
    ProfileFormatRefused
        If the format is not one of these, or the bytes are not whole points.
    """
    layout = COORDINATE_FORMATS.get(pixel_format)
    if layout is None:
        raise ProfileFormatRefused(
            f"the laser sends {pixel_format}; what can be read is {', '.join(COORDINATE_FORMATS)}. "
            "Set laser.genicam.pixel_format to one that it has"
        )
    count, rest = divmod(len(raw), layout.point_size)
    if rest or not 0 < count <= MOST_POINTS_IN_ROW:
        raise ProfileFormatRefused(
            f"{len(raw)} bytes are no row of 1 to {MOST_POINTS_IN_ROW} points in {pixel_format} "
            f"({layout.point_size} bytes each)"
        )
    with np.errstate(invalid="ignore"):  # a signalling NaN is one like others
        table = np.frombuffer(raw, dtype=layout.dtype).reshape(count, -1).astype(np.float64)
    raw_z = table[:, layout.components.index("C")]
    raw_x = table[:, 0] if layout.has_x else np.arange(count, dtype=np.float64)
    x, z = scales.x.coordinates_of_raw(raw_x), scales.z.coordinates_of_raw(raw_z)
    missing = ~(np.isfinite(x) & np.isfinite(z))
    if scales.invalid is not None:
        missing |= raw_z == scales.invalid
    x[missing] = z[missing] = np.nan
    return Profile(x, z)
