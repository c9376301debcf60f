"""Settings that hold metres and radians, and are written to files in millimetres and degrees.

A settings class is a frozen dataclass whose fields carry the unit of the file once::

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Plan(SettingsTable):
        step: Annotated[float, Ge(5), Le(300), MM] = 0.04

The program writes ``Plan(step=0.04)`` and reads ``plan.step`` in metres. In a file the same number
is the key ``step_mm``, between 5 and 300: bounds come before the unit and count in the file's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import degrees, radians
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, get_args, get_type_hints

import numpy as np
from annotated_types import Ge, Le

from tjscan.core.frames import Array, pose_from_euler_zyx, pose_from_rounded_matrix

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue
    from pydantic_core import CoreSchema

ROUND_TRIP_DIGITS: Final = (15, 16, 17)
"""Decimal digits that may be needed to write a number so that it is read as the same again."""


@dataclass(frozen=True, slots=True)
class FileUnit:
    """The unit in which a file holds a number, or numbers in tuples; the last item of `Annotated`.

    Parameters
    ----------
    suffix : str
        What the key in the file ends in.
    factor : float
        What one of it is in SI units.
    key : str, optional
        The whole key in the file, if it is not the field's name and the suffix.
    """

    suffix: str
    factor: float = 1.0
    key: str | None = None

    def with_key(self, key: str) -> FileUnit:
        """Return the same unit for a field that is in the file under another key."""
        return replace(self, key=key)

    def to_si(self, value: Any) -> Any:
        """Convert from the file's unit to SI; numbers in tuples too, and nothing to nothing."""
        if isinstance(value, tuple):
            return tuple(map(self.to_si, value))
        return value if value is None or self.factor == 1.0 else value * self.factor

    def to_file(self, value: Any) -> Any:
        """Convert from SI to the file's unit, with the fewest digits that read back as the same."""
        if isinstance(value, tuple | list):
            return tuple(map(self.to_file, value))
        if value is None or self.factor == 1.0:
            return value
        for digits in ROUND_TRIP_DIGITS:
            shortest = float(f"{value / self.factor:.{digits}g}")
            if self.to_si(shortest) == value:
                break
        return shortest

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Check in the file's unit, convert after that, and convert back when it is written."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(
            self.to_si,
            _accept_lists_and_words(handler(source)),
            serialization=core_schema.plain_serializer_function_ser_schema(self.to_file),
        )


@dataclass(frozen=True, slots=True)
class FileKey:
    """Key in the file of a field without a unit, if it is not the field's name."""

    name: str


@dataclass(frozen=True, slots=True)
class ChosenByName:
    """Marks a field whose value a file chooses by name among given ones.

    Parameters
    ----------
    values : mapping
        What can be named; each value has its name as its attribute ``name``.
    """

    values: Mapping[str, Any]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        """One of the names becomes its value, and a value is written as its name."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(
            self.values.__getitem__,
            core_schema.literal_schema(list(self.values)),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda v: v.name),
        )


@dataclass(frozen=True, slots=True)
class NotInFile:
    """Marks a field that no file holds: the program sets it, or its default counts."""


@dataclass(frozen=True, slots=True)
class ZeroOrAtLeast:
    """A bound in the file's unit: zero, or so much either way; less is of another unit.

    Parameters
    ----------
    least : float
        The smallest size that is not zero.
    """

    least: float

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Refuse what is nearer to zero, and not zero."""
        from pydantic_core import PydanticCustomError, core_schema

        def check(value: Any) -> Any:
            if 0 < abs(value) < self.least:
                bound = {"ge": self.least}
                raise PydanticCustomError("too_near_zero", "must be 0, or {ge} and more", bound)
            return value

        return core_schema.no_info_after_validator_function(check, handler(source))


@dataclass(frozen=True, slots=True)
class ListOrWordInFile:
    """Marks a tuple that a file holds as a list, or an enumeration that it holds as a word."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Make an exception from being strict about types."""
        schema: Any = dict(handler.resolve_ref_schema(handler(source)))
        schema.pop("ref", None)  # a schema of its own: elsewhere the type stays strict
        return _accept_lists_and_words(schema)  # type: ignore[no-any-return]


NO_UNIT: Final = FileUnit("")
MM: Final = FileUnit("mm", 1e-3)
MM2: Final = FileUnit("mm2", 1e-6)
MM_S: Final = FileUnit("mm_s", 1e-3)
M_PER_MIN: Final = FileUnit("m_min", 1 / 60)
MM_S2: Final = FileUnit("mm_s2", 1e-3)
DEG: Final = FileUnit("deg", radians(1.0))
DEG_S: Final = FileUnit("deg_s", radians(1.0))
PERCENT_UNIT: Final = FileUnit("percent", 0.01)
METRE_UNIT: Final = FileUnit("m")
NEWTON: Final = FileUnit("n")
KG: Final = FileUnit("kg")
MRAD: Final = FileUnit("mrad", 1e-3)
MRAD_S: Final = FileUnit("mrad_s", 1e-3)
PER_M: Final = FileUnit("per_m")
SECONDS: Final = FileUnit("s")
HERTZ_UNIT: Final = FileUnit("hz")
MILLISECONDS: Final = FileUnit("ms", 1e-3)
MICROSECONDS: Final = FileUnit("us", 1e-6)
PPM_UNIT: Final = FileUnit("ppm", 1e-6)
LITRE_PER_MINUTE: Final = FileUnit("l_min", 1e-3 / 60)
AMPERE_UNIT: Final = FileUnit("a")
VOLT_UNIT: Final = FileUnit("v")
COLUMNS: Final = FileUnit("columns")
POINTS: Final = FileUnit("points")
NOT_IN_FILE: Final = NotInFile()
LIST_OR_WORD_IN_FILE: Final = ListOrWordInFile()


STRICT_TABLE: Final[dict[str, Any]] = {"strict": True, "extra": "forbid", "allow_inf_nan": False}
"""Pydantic's options of what comes from outside: exact types, known keys, finite numbers."""


class SettingsTable:
    """Base of frozen dataclasses that are tables of a file: closed, and strict about types.

    A check across several fields is in ``__post_init__`` and raises ValueError.
    """

    __slots__ = ()
    __pydantic_config__: ClassVar[dict[str, Any]] = {**STRICT_TABLE, "serialize_by_alias": True}

    @classmethod
    def file_key_types(cls) -> dict[str, Any]:
        """Type of each key that the table has in a file."""
        return {_key_in_file(name, hint): hint for name, hint in cls._types_in_file().items()}

    @classmethod
    def _types_in_file(cls) -> dict[str, Any]:
        """Type of each field that is in a file."""
        hints = get_type_hints(cls, include_extras=True)
        own = {field.name: hints[field.name] for field in fields(cls)}  # type: ignore[arg-type]
        return {
            name: hint
            for name, hint in own.items()
            if NOT_IN_FILE not in getattr(hint, "__metadata__", ())
        }

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The schema of a dataclass whose keys end in their units."""
        hints = get_type_hints(cls, include_extras=True)
        schema: Any = handler(source)
        table = schema
        while table["type"] != "dataclass":
            table = table["schema"]
        table["strict"] = False  # a table of a file is not of this class yet
        for field in table["schema"]["fields"]:
            hint = hints[field["name"]]
            if NOT_IN_FILE in getattr(hint, "__metadata__", ()):
                field["init"], field["serialization_exclude"] = False, True
            else:
                key = _key_in_file(field["name"], hint)
                field["validation_alias"] = field["serialization_alias"] = key
        return schema  # type: ignore[no-any-return]

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The table's JSON schema: keys and defaults as in a file, explained by the docstring."""
        from tjscan.core.json_schema import describe_table

        schema = handler(core_schema)
        types = cls._types_in_file()
        keys = {name: _key_in_file(name, hint) for name, hint in types.items()}
        marks = {key: _find_unit_or_key(types[name]) for name, key in keys.items()}
        to_file = {key: mark.to_file for key, mark in marks.items() if isinstance(mark, FileUnit)}
        describe_table(handler.resolve_ref_schema(schema), cls, keys, to_file)
        return schema


def _key_in_file(name: str, hint: Any) -> str:
    """A field's key in a file."""
    mark = _find_unit_or_key(hint)
    if isinstance(mark, FileUnit):
        return mark.key or f"{name}_{mark.suffix}"
    return name if mark is None else mark.name


def _find_unit_or_key(hint: Any) -> FileUnit | FileKey | None:
    """The unit or key that is in a type, however deep."""
    for part in (*getattr(hint, "__metadata__", ()), *get_args(hint)):
        found = part if isinstance(part, FileUnit | FileKey) else _find_unit_or_key(part)
        if found is not None:
            return found
    return None


def _accept_lists_and_words(schema: Any) -> Any:
    """A schema whose tuples a file may hold as lists, and whose enumerations as words."""
    inner = schema
    while inner["type"] not in ("tuple", "enum") and "schema" in inner:
        inner = inner["schema"]
    if inner["type"] in ("tuple", "enum"):
        inner["strict"] = False
    for item in inner.get("items_schema", ()):
        _accept_lists_and_words(item)
    return schema


FARTHEST_DISTANCE_MM: Final = 1e5
"""A hundred metres: nothing in a cell is further."""

Coordinate = Annotated[float, Ge(-FARTHEST_DISTANCE_MM), Le(FARTHEST_DISTANCE_MM)]

Position = Annotated[tuple[Coordinate, Coordinate, Coordinate], MM]
"""Three coordinates, metres."""

EulerAngles = Annotated[tuple[Coordinate, Coordinate, Coordinate], DEG]
"""Three angles, radians."""


RIGHT_ANGLES_RAD: Final = (0.0, 1.5708, 1.570796, 3.1416, 3.14159, 3.141593)
"""None, a quarter and half a turn as radians are written; no degrees are meant so exactly."""


def refuse_radians(key: str, angles: tuple[float, ...], *, right: bool) -> None:
    """Refuse angles in degrees that were radians, and say what to write.

    Parameters
    ----------
    key : str
        Where they are in the file, degrees.
    angles : tuple of float
        Radians.
    right : bool
        Whether only right angles in radians show it, and no other angle beside them; otherwise
        any fraction does.

    Raises
    ------
    ValueError
        If none is more than a turn in radians, and it shows.
    """
    written = DEG.to_file(angles)
    sizes = [round(abs(v), 6) for v in written]
    if not any(sizes) or max(sizes) > 2 * np.pi:
        return
    if all(v in RIGHT_ANGLES_RAD for v in sizes) if right else any(round(v, 1) != v for v in sizes):
        meant = [round(degrees(v), 3) for v in written]
        raise ValueError(f"{key}: {list(written)} looks like radians: write {meant}")


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseSettings(SettingsTable):
    """Settings of a pose: position and Z-Y-X Euler angles, as robot controllers show them.

    Parameters
    ----------
    position : tuple of float
        Of the inner frame's origin in the outer frame, metres.
    euler_zyx : tuple of float
        Z-Y-X Euler angles, radians; see `pose_from_euler_zyx`.
    """

    position: Position
    euler_zyx: EulerAngles

    def __post_init__(self) -> None:
        refuse_radians("euler_zyx_deg", self.euler_zyx, right=True)

    @property
    def T(self) -> Array:
        """The pose, shape (4, 4), metres."""
        return pose_from_euler_zyx(self.position, self.euler_zyx)


MatrixRow = tuple[float, float, float, float]


def pose_from_rows_mm(rows: tuple[MatrixRow, MatrixRow, MatrixRow, MatrixRow]) -> Array:
    """Pose, shape (4, 4), metres, from the rows of a file, millimetres.

    Raises
    ------
    ValueError
        If they are no pose; see `pose_from_rounded_matrix`.
    """
    T = np.array(rows)
    T[:3, 3] *= MM.factor
    return pose_from_rounded_matrix(T)


def pose_to_rows_mm(T: Array) -> tuple[MatrixRow, MatrixRow, MatrixRow, MatrixRow]:
    """A file's rows, millimetres, from a pose, shape (4, 4), metres."""
    in_mm = T.tolist()
    for row in in_mm[:3]:
        row[3] = MM.to_file(row[3])
    a, b, c, d = map(tuple, in_mm)
    return a, b, c, d


SMALLEST_OFFSET_MM: Final = 1.0
"""No device is mounted nearer to a flange's middle, unless it is there exactly."""


class _CheckedPoseRows:
    """Refuses rows that are no pose."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        from pydantic_core import core_schema

        def check(rows: Any) -> Any:
            T = np.array(rows)
            if not np.array_equal(T[3], (0, 0, 0, 1)) and np.array_equal(T[:, 3], (0, 0, 0, 1)):
                raise ValueError("is transposed: the position is the last column, not the last row")
            pose_from_rows_mm(rows)
            if 0 < np.abs(T[:3, 3]).max() < SMALLEST_OFFSET_MM:
                meant = [float(f"{1e3 * value:.6g}") for value in T[:3, 3]]
                raise ValueError(f"its last column looks like metres: write {meant}")
            return rows

        return core_schema.no_info_after_validator_function(
            check, _accept_lists_and_words(handler(source))
        )


PoseRows = Annotated[tuple[MatrixRow, MatrixRow, MatrixRow, MatrixRow], _CheckedPoseRows()]
"""A pose as a file holds it: the four rows of its matrix, millimetres."""
