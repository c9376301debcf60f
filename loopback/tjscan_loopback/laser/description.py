"""The loopback laser's description of itself: GenICam XML, schema 1.1, features as SFNC names them.

Each feature is a register of its own, from `memory.OWN_REGISTERS` on. The registers of Scan3d are
selected by coordinate: A, B and C follow one another.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tjscan.core.version import PROGRAM_VERSION
from tjscan.laser.scan3d import COORDINATE_FORMATS
from tjscan_loopback.laser.gvsp import IMAGE_CHUNK
from tjscan_loopback.laser.memory import OWN_REGISTERS, TIME_CONTROL, TIME_HIGH

ACQUISITION_START, ACQUISITION_STOP, ACQUISITION_MODE = (
    OWN_REGISTERS + at for at in (0x00, 0x04, 0x08)
)
TRIGGER_SELECTOR, TRIGGER_MODE, TRIGGER_SOURCE = (OWN_REGISTERS + at for at in (0x0C, 0x10, 0x14))
SOFTWARE_TRIGGER, PIXEL_FORMAT, IMAGE_WIDTH, IMAGE_HEIGHT = (
    OWN_REGISTERS + at for at in (0x18, 0x1C, 0x20, 0x24)
)
EXPOSURE_TIME, FRAME_RATE = OWN_REGISTERS + 0x28, OWN_REGISTERS + 0x30
SCAN_TYPE, PAYLOAD_SIZE = OWN_REGISTERS + 0x38, OWN_REGISTERS + 0x3C
CHUNK_MODE, CHUNK_SELECTOR, CHUNK_ENABLE = (OWN_REGISTERS + at for at in (0x40, 0x44, 0x48))
COORDINATE_SELECTOR, COORDINATE_UNIT, OUTPUT_MODE, INVALID_FLAG = (
    OWN_REGISTERS + at for at in (0x50, 0x54, 0x58, 0x5C)
)
COORDINATE_SCALE, COORDINATE_OFFSET, INVALID_VALUE, AXIS_MIN, AXIS_MAX = (
    OWN_REGISTERS + 0x100 + 0x20 * i for i in range(5)
)
"""Eight bytes for each of A, B and C."""

DISTANCE_UNITS: Final = {"Millimeter": 0, "Pixel": 2}
OUTPUT_MODES: Final = {"UncalibratedC": 0, "RectifiedC_Linescan": 7, "CalibratedAC_Linescan": 3}
TRIGGER_SOURCES: Final = {"Software": 0, "Line0": 1}

CHUNK_NUMBERS: Final = {"Image": IMAGE_CHUNK, "FrameID": 2, "Timestamp": 3, "EncoderValue": 4}
"""Numbers of the chunks behind a block, in their order."""


def description(
    *, columns: int, most_rows: int, with_scan3d: bool = True, with_trigger: bool = True
) -> bytes:
    """GenICam description of the sensor.

    Parameters
    ----------
    columns : int
        Points of a row.
    most_rows : int
        Rows that one block may hold.
    with_scan3d : bool
        Whether it has the features of Scan3d.
    with_trigger : bool
        Whether a program can trigger it.
    """
    formats = {name: form.code for name, form in COORDINATE_FORMATS.items()}
    on_off = {"Off": 0, "On": 1}
    groups = {
        "DeviceControl": [
            _enumeration("DeviceScanType", SCAN_TYPE, {"Linescan3D": 4}, access="RO"),
            _text("DeviceVendorName", 0x48),
            _text("DeviceModelName", 0x68),
            _text("DeviceSerialNumber", 0xD8, 16),
            _text("DeviceVersion", 0x88),
            _command("TimestampLatch", TIME_CONTROL, 2),
            _integer("TimestampLatchValue", TIME_HIGH, access="RO", size=8),
        ],
        "ImageFormatControl": [
            _enumeration("PixelFormat", PIXEL_FORMAT, formats),
            _integer("Width", IMAGE_WIDTH, low=columns, high=columns, access="RO"),
            _integer("Height", IMAGE_HEIGHT, low=1, high=most_rows),
            _integer("PayloadSize", PAYLOAD_SIZE, access="RO"),
        ],
        "AcquisitionControl": [
            _enumeration("AcquisitionMode", ACQUISITION_MODE, {"Continuous": 0}),
            _command("AcquisitionStart", ACQUISITION_START),
            _command("AcquisitionStop", ACQUISITION_STOP),
            _float("AcquisitionFrameRate", FRAME_RATE, low=1.0, high=2000.0),
            _float("ExposureTime", EXPOSURE_TIME, low=1.0, high=40_000.0),
        ],
        "ChunkDataControl": [
            _boolean("ChunkModeActive", CHUNK_MODE),
            _enumeration("ChunkSelector", CHUNK_SELECTOR, CHUNK_NUMBERS),
            _boolean("ChunkEnable", CHUNK_ENABLE),
            *(_chunk(f"Chunk{name}") for name in CHUNK_NUMBERS if name != "Image"),
        ],
    }
    if with_trigger:
        groups["AcquisitionControl"] += [
            _enumeration("TriggerSelector", TRIGGER_SELECTOR, {"FrameStart": 0}),
            _enumeration("TriggerMode", TRIGGER_MODE, on_off),
            _enumeration("TriggerSource", TRIGGER_SOURCE, TRIGGER_SOURCES),
            _command("TriggerSoftware", SOFTWARE_TRIGGER),
        ]
    if with_scan3d:
        selected = {"CoordinateA": 0, "CoordinateB": 1, "CoordinateC": 2}
        groups["Scan3dControl"] = [
            _enumeration("Scan3dCoordinateSelector", COORDINATE_SELECTOR, selected),
            _enumeration("Scan3dDistanceUnit", COORDINATE_UNIT, DISTANCE_UNITS, access="RO"),
            _enumeration("Scan3dOutputMode", OUTPUT_MODE, OUTPUT_MODES),
            _boolean("Scan3dInvalidDataFlag", INVALID_FLAG),
            _selected("Scan3dCoordinateScale", COORDINATE_SCALE),
            _selected("Scan3dCoordinateOffset", COORDINATE_OFFSET),
            _selected("Scan3dInvalidDataValue", INVALID_VALUE),
            _selected("Scan3dAxisMin", AXIS_MIN),
            _selected("Scan3dAxisMax", AXIS_MAX),
        ]
    return _document(groups).encode()


Feature = tuple[str, str]
"""Name of a feature, and the nodes that describe it."""


def _document(groups: Mapping[str, list[Feature]]) -> str:
    shown = "".join(f"<pFeature>{group}</pFeature>" for group in groups)
    body = [f'<Category Name="Root" NameSpace="Standard">{shown}</Category>']
    for group, features in groups.items():
        names = "".join(f"<pFeature>{name}</pFeature>" for name, _ in features)
        body.append(f'<Category Name="{group}" NameSpace="Standard">{names}</Category>')
        body += [nodes for _, nodes in features]
    major, minor, sub = PROGRAM_VERSION.split(".")[:3]
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<RegisterDescription xmlns="http://www.genicam.org/GenApi/Version_1_1"\n'
        ' ModelName="laser_loopback" VendorName="tjscan" ToolTip="Line laser on this machine"\n'
        ' StandardNameSpace="GEV" SchemaMajorVersion="1" SchemaMinorVersion="1"\n'
        f' SchemaSubMinorVersion="0" MajorVersion="{major}" MinorVersion="{minor}"'
        f' SubMinorVersion="{sub[0]}"\n'
        ' ProductGuid="4B1F0E7C-6C2C-4E0C-9E57-0B7D5C1C6A01"\n'
        ' VersionGuid="4B1F0E7C-6C2C-4E0C-9E57-0B7D5C1C6A02">\n'
        + "\n".join(body)
        + '\n<Port Name="Device"/>\n'
        + "".join(
            f'<Port Name="Chunk{name}Port"><ChunkID>{number}</ChunkID></Port>\n'
            for name, number in CHUNK_NUMBERS.items()
            if name != "Image"
        )
        + "</RegisterDescription>\n"
    )


def _register(address: int, size: int, access: str, more: str = "", port: str = "Device") -> str:
    return (
        f"<Address>0x{address:X}</Address>{more}<Length>{size}</Length>"
        f"<AccessMode>{access}</AccessMode><pPort>{port}</pPort><Cachable>NoCache</Cachable>"
    )


_BIG_ENDIAN: Final = "<Endianess>BigEndian</Endianess>"
_UNSIGNED_TAG: Final = f"<Sign>Unsigned</Sign>{_BIG_ENDIAN}"


def _value_register(name: str, address: int, access: str, size: int = 4) -> str:
    register = _register(address, size, access)
    return f'<IntReg Name="{name}Register">{register}{_UNSIGNED_TAG}</IntReg>'


def _standard(kind: str, name: str, inner: str) -> str:
    return f'<{kind} Name="{name}" NameSpace="Standard">{inner}</{kind}>'


def _integer(
    name: str,
    address: int,
    *,
    low: int | None = None,
    high: int | None = None,
    access: str = "RW",
    size: int = 4,
) -> Feature:
    bounds = "" if low is None else f"<Min>{low}</Min><Max>{high}</Max>"
    node = _standard("Integer", name, f"<pValue>{name}Register</pValue>{bounds}")
    return name, node + _value_register(name, address, access, size)


def _enumeration(
    name: str, address: int, entries: Mapping[str, int], *, access: str = "RW"
) -> Feature:
    listed = "".join(
        f'<EnumEntry Name="{entry}" NameSpace="Standard"><Value>{value}</Value></EnumEntry>'
        for entry, value in entries.items()
    )
    node = _standard("Enumeration", name, f"{listed}<pValue>{name}Register</pValue>")
    return name, node + _value_register(name, address, access)


def _boolean(name: str, address: int) -> Feature:
    inner = f"<pValue>{name}Register</pValue><OnValue>1</OnValue><OffValue>0</OffValue>"
    return name, _standard("Boolean", name, inner) + _value_register(name, address, "RW")


def _command(name: str, address: int, value: int = 1) -> Feature:
    inner = f"<pValue>{name}Register</pValue><CommandValue>{value}</CommandValue>"
    return name, _standard("Command", name, inner) + _value_register(name, address, "WO")


def _text(name: str, address: int, size: int = 32) -> Feature:
    return name, _standard("StringReg", name, _register(address, size, "RO"))


def _float(name: str, address: int, *, low: float, high: float) -> Feature:
    inner = f"<pValue>{name}Register</pValue><Min>{low}</Min><Max>{high}</Max>"
    register = (
        f'<FloatReg Name="{name}Register">{_register(address, 8, "RW")}{_BIG_ENDIAN}</FloatReg>'
    )
    return name, _standard("Float", name, inner) + register


def _selected(name: str, address: int) -> Feature:
    """A number of the coordinate that is selected."""
    index = '<pIndex Offset="8">Scan3dCoordinateSelectorRegister</pIndex>'
    register = _register(address, 8, "RO", index)
    node = _standard("Float", name, f"<pValue>{name}Register</pValue>")
    return name, f'{node}<FloatReg Name="{name}Register">{register}{_BIG_ENDIAN}</FloatReg>'


def _chunk(name: str) -> Feature:
    register = _register(0, 8, "RO", port=f"{name}Port")
    inner = f'<IntReg Name="{name}Register">{register}{_UNSIGNED_TAG}</IntReg>'
    return name, _standard("Integer", name, f"<pValue>{name}Register</pValue>") + inner
