"""What the memory of the loopback laser holds: who it is, its settings, its scales."""

from __future__ import annotations

from collections.abc import Container
from struct import pack
from typing import Final

from tjscan.core.version import PROGRAM_VERSION
from tjscan.laser.scan3d import COORDINATE_FORMATS, CoordinateFormat
from tjscan_loopback.laser import description as features
from tjscan_loopback.laser.coding import (
    INVALID_RAW,
    RAW_X,
    RAW_Z,
    STEP_MM,
    X_OFFSET_MM,
    rectified_spacing,
    rectified_x,
)
from tjscan_loopback.laser.faults import LaserFaultOrder
from tjscan_loopback.laser.memory import TICKS_LOW, Memory

VENDOR_NAME: Final = "tjscan"
MODEL_NAME: Final = "laser-loopback"

MOST_ROWS: Final = 64

_FORMATS_BY_CODE: Final = {form.code: form for form in COORDINATE_FORMATS.values()}


def initial_memory(
    host: str, serial: str, columns: int, faults: Container[LaserFaultOrder]
) -> Memory:
    """Memory of a sensor that was switched on.

    Parameters
    ----------
    host, serial : str
        Its address and serial number.
    columns : int
        Points of a profile.
    faults : container of LaserFaultOrder
        What it describes wrongly.
    """
    memory = Memory(
        host,
        vendor=VENDOR_NAME,
        model=MODEL_NAME,
        version=PROGRAM_VERSION,
        serial=serial,
        description=features.description(
            columns=columns,
            most_rows=MOST_ROWS,
            with_scan3d=LaserFaultOrder.MISSING_FEATURES not in faults,
            with_trigger=LaserFaultOrder.NO_TRIGGER not in faults,
        ),
    )
    for address, value in (
        (features.SCAN_TYPE, 4),
        (features.PIXEL_FORMAT, COORDINATE_FORMATS["Coord3D_AC16"].code),
        (features.IMAGE_WIDTH, columns),
        (features.IMAGE_HEIGHT, 1),
        (features.OUTPUT_MODE, features.OUTPUT_MODES["CalibratedAC_Linescan"]),
        (features.INVALID_FLAG, 1),
    ):
        memory.set(address, value)
    for address, number in ((features.EXPOSURE_TIME, 1000.0), (features.FRAME_RATE, 100.0)):
        memory.put(address, pack(">d", number))
    unit = "Pixel" if LaserFaultOrder.UNIT_PIXEL in faults else "Millimeter"
    memory.set(features.COORDINATE_UNIT, features.DISTANCE_UNITS[unit])
    if LaserFaultOrder.NO_CLOCK in faults:
        memory.set(TICKS_LOW, 0)
    state_scales(memory)
    return memory


def format_of(memory: Memory) -> CoordinateFormat:
    """The pixel format that is set."""
    return _FORMATS_BY_CODE.get(
        memory.get(features.PIXEL_FORMAT), COORDINATE_FORMATS["Coord3D_AC16"]
    )


def rows_of(memory: Memory) -> int:
    """Rows of a block."""
    return min(max(memory.get(features.IMAGE_HEIGHT), 1), MOST_ROWS)


def state_scales(memory: Memory) -> None:
    """State the size of a block, and scale and offset of each coordinate, in millimetres."""
    layout, columns = format_of(memory), memory.get(features.IMAGE_WIDTH)
    memory.set(features.PAYLOAD_SIZE, layout.point_size * columns * rows_of(memory))
    x = (STEP_MM, X_OFFSET_MM, *RAW_X)
    if not layout.has_x:
        first = X_OFFSET_MM + STEP_MM * float(rectified_x(columns)[0])
        x = (STEP_MM * rectified_spacing(columns), first, 0.0, columns - 1.0)
    axes = (x, (1.0, 0.0, 0.0, 0.0), (STEP_MM, 0.0, *RAW_Z))
    for i, numbers in enumerate(axes):
        places = (
            features.COORDINATE_SCALE,
            features.COORDINATE_OFFSET,
            features.AXIS_MIN,
            features.AXIS_MAX,
        )
        for address, number in zip(places, numbers, strict=True):
            memory.put(address + 8 * i, pack(">d", number))
        memory.put(features.INVALID_VALUE + 8 * i, pack(">d", float(INVALID_RAW)))
