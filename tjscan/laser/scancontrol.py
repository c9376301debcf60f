"""Profiles of Micro-Epsilon's scanCONTROL 26xx, 27xx and 29xx from their own payloads.

Two layouts: the full profile, 64 bytes for each point, and the rearranged container, whose rows are
profiles and whose columns are fields. Both end in a time stamp. From the maker's documents:
"Interface documentation linLLT" 0.2.0 (2017), sections 2.2 and 2.3, and "Interface Specification,
Supplement B" to the scanCONTROL 2600, revision 1.57 (2014). Numbers are big-endian.
"""

from __future__ import annotations

from struct import unpack
from typing import Final, get_args

import numpy as np

from tjscan.core.errors import ProfileFormatRefused
from tjscan.core.frames import Array
from tjscan.laser.genicam.settings import FieldName, ScanControlSettings
from tjscan.laser.profile import Profile

REFLECTION_COUNT: Final = 4
BYTES_OF_REFLECTION: Final = 16
TIME_STAMP_BYTES: Final = 16

CYCLES_PER_SECOND, OFFSETS_PER_CYCLE = 8000, 3072

RAW_COORDINATE_OF_ZERO: Final = 32_768
"""Raw number of the coordinate 0, or of the offset."""

MAX_RAW_VALUE: Final = 65_535

CONTAINER_FIELD_WORDS: Final = dict.fromkeys(get_args(FieldName), 1) | {
    "moment0": 2,
    "moment1": 2,
}
"""Fields of a container in their order, and how many numbers of 16 bits each takes for a point."""


CLOCK_TURN: Final = 128.0
"""Seconds after which the sensor's clock begins at zero again."""


def middle_of_shutter(raw: bytes) -> float:
    """Middle of the exposure by the sensor's clock, seconds, from a payload that ends in it."""
    opened, closed = (
        (word >> 25)
        + ((word >> 12 & 0x1FFF) + (word & 0xFFF) / OFFSETS_PER_CYCLE) / CYCLES_PER_SECOND
        for word in unpack(">4xI4xI", raw[-TIME_STAMP_BYTES:])
    )
    return float((opened + (closed - opened) % CLOCK_TURN / 2) % CLOCK_TURN)


def _check_time_stamp(raw: bytes) -> None:
    """Refuse 16 bytes that are no time stamp: shutter opened at byte 4, closed at byte 12.

    Each word holds seconds (7 bits), cycles of 125 us (13 bits) and offsets in a cycle (12 bits).
    """
    for word in unpack(">4xI4xI", raw):
        cycle, offset = word >> 12 & 0x1FFF, word & 0xFFF
        if cycle >= CYCLES_PER_SECOND or offset >= OFFSETS_PER_CYCLE:
            raise ProfileFormatRefused(
                f"the time stamp counts {cycle} cycles and {offset} offsets, and the clock only "
                f"below {CYCLES_PER_SECOND} and {OFFSETS_PER_CYCLE}: the payload is of another "
                "layout"
            )


def scancontrol_profile_size(settings: ScanControlSettings) -> int:
    """Bytes of one profile."""
    if settings.layout == "full":
        return settings.points * REFLECTION_COUNT * BYTES_OF_REFLECTION
    words = sum(CONTAINER_FIELD_WORDS[name] for name in settings.fields)
    return 2 * settings.points * (words + settings.time_stamp)


def parse_scancontrol(raw: bytes, settings: ScanControlSettings) -> Profile:
    """Parse a payload; of a container with many rows the first.

    Parameters
    ----------
    raw : bytes
        The payload.
    settings : ScanControlSettings
        How it is laid out, and what a count is worth.

    Returns
    -------
    Profile
        In frame s, metres; its time is not read.

    Raises
    ------
    ProfileFormatRefused
        If the payload is not of that layout, or its time stamp counts further than the clock.
    """
    size = scancontrol_profile_size(settings)
    if not raw or len(raw) % size:
        raise ProfileFormatRefused(
            f"{len(raw)} bytes are no {settings.layout} profile of {settings.points} points "
            f"({size} bytes): set laser.scancontrol as the sensor is set up"
        )
    row = raw[:size]
    if settings.layout == "full" or settings.time_stamp:
        _check_time_stamp(row[-TIME_STAMP_BYTES:])
    read = _coordinates_of_full_layout if settings.layout == "full" else _coordinates_of_container
    raw_x, raw_z = read(row, settings)
    missing = raw_z == 0  # also if the axis is turned round
    if settings.layout == "full" and settings.reflection == REFLECTION_COUNT:
        missing[-1] = True  # the time stamp is there
    scale = settings.count_scale
    x, z = (
        scale.scale * ((MAX_RAW_VALUE - values if flip else values) - RAW_COORDINATE_OF_ZERO)
        for values, flip in ((raw_x, settings.flip_x), (raw_z, settings.flip_z))
    )
    x[missing] = z[missing] = np.nan
    return Profile(x, z + scale.offset)


def _coordinates_of_full_layout(row: bytes, settings: ScanControlSettings) -> tuple[Array, Array]:
    """Raw x and z: the second word of a reflection, its position and its distance."""
    words = np.frombuffer(row, dtype=">u2").reshape(settings.points, REFLECTION_COUNT, -1)
    chosen = words[:, settings.reflection - 1].astype(np.float64)
    return chosen[:, 2], chosen[:, 3]


def _coordinates_of_container(row: bytes, settings: ScanControlSettings) -> tuple[Array, Array]:
    """Raw x and z: fields of the row, one behind the other."""
    words = np.frombuffer(row, dtype="<u2" if settings.little_endian else ">u2").astype(np.float64)
    found, begin = {}, 0
    for name in settings.fields:
        found[name] = words[begin : begin + settings.points]
        begin += CONTAINER_FIELD_WORDS[name] * settings.points
    return found["x"], found["z"]
