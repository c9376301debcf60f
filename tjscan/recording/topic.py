"""A topic: a name, a schema, and how its messages become bytes and bytes its messages."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from datetime import datetime
from enum import StrEnum
from math import isfinite, nan
from operator import methodcaller
from types import UnionType
from typing import (
    Annotated,
    Any,
    Final,
    Generic,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from tjscan.core.frames import Array, ArrayForm, readonly_copy
from tjscan.laser.profile import Profile

LARGEST_NUMBER: Final = 1e9
"""Metres, radians or seconds: what is larger was not measured."""

LARGEST_RECORDED_COUNT: Final = 1_000_000
"""Of sections, passes, places or iterations: counts and numbers begin at 0."""

ORTHONORMALITY_TOLERANCE: Final = 1e-6
"""How far from a rotation the axes of a pose may be that was written to the last digit."""


class ValueCodec(NamedTuple):
    """How a value becomes JSON, and JSON the value.

    Parameters
    ----------
    schema : mapping
        JSON schema, spelt out to its leaves.
    encode : callable
        Gives what `json` writes.
    decode : callable
        Gives the value; raises ValueError, KeyError or TypeError if it is damaged.
    """

    schema: Mapping[str, Any]
    encode: Callable[[Any], Any]
    decode: Callable[[Any], Any]


def value_codec(kind: Any, decimals: int | None = None) -> ValueCodec:
    """Codec of a type.

    Parameters
    ----------
    kind : type
        As a field is annotated: a plain type, an enum of strings, a dataclass, an array with or
        without its form, a tuple of these, or one of these or None.
    decimals : int, optional
        To which arrays are rounded when they are written.

    Raises
    ------
    TypeError
        If such values are not recorded.
    """
    if kind in PLAIN_CODECS:
        return PLAIN_CODECS[kind]
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        form = next((one for one in arguments[1:] if isinstance(one, ArrayForm)), None)
        if form is None:
            return value_codec(arguments[0], decimals)
        return _array_codec(form, decimals) if form.shape else UNKNOWN_FLOAT_CODEC
    if kind == Array:
        return _array_codec(ArrayForm(), decimals)
    if origin in (Union, UnionType) and arguments[-1] is type(None):
        return _optional_codec(value_codec(arguments[0], decimals))
    if origin is tuple:
        return _tuple_codec(value_codec(arguments[0], decimals))
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return ValueCodec({"type": "string"}, str, kind)
    if is_dataclass(kind):
        return dataclass_codec(kind, decimals)
    raise TypeError(f"{kind} is not recorded")


def dataclass_codec(kind: Any, decimals: int | None = None) -> ValueCodec:
    """Codec of a dataclass, field by field; for the parameters see `value_codec`."""
    hints = get_type_hints(kind, include_extras=True)
    codecs = {field.name: value_codec(hints[field.name], decimals) for field in fields(kind)}
    optional = {field.name for field in fields(kind) if field.default is not MISSING}
    schemas = {name: codec.schema for name, codec in codecs.items()}
    return ValueCodec(
        {"type": "object", "title": f"tjscan.{kind.__name__}", "properties": schemas},
        lambda message: {name: one.encode(getattr(message, name)) for name, one in codecs.items()},
        lambda content: kind(
            **{
                name: one.decode(content[name])
                for name, one in codecs.items()
                # Older programs did not write it.
                if name in _checked_instance(content, dict) or name not in optional
            }
        ),
    )


def _array_codec(form: ArrayForm, decimals: int | None) -> ValueCodec:
    def encode(values: Array) -> list[float | None]:
        numbers = np.asarray(values, dtype=float)
        if decimals is not None:
            numbers = np.round(numbers, decimals)
        flat: list[float | None] = numbers.ravel().tolist()
        return [_null_if_unknown(number) for number in flat] if form.may_be_unknown else flat

    def decode(values: Any) -> Array:
        numbers = np.array(values, dtype=float)
        known = numbers[~np.isnan(numbers)] if form.may_be_unknown else numbers
        if not np.all(np.abs(known) <= LARGEST_NUMBER):
            raise ValueError(f"numbers that can't be measured: {numbers[:16]}")
        array = readonly_copy(np.reshape(numbers, form.shape))
        if form.is_pose:
            _check_pose(array)
        return array

    return ValueCodec({"type": "array", "items": {"type": "number"}}, encode, decode)


def _check_pose(T: Array) -> None:
    if not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=ORTHONORMALITY_TOLERANCE):
        raise ValueError("a pose has axes of length one, square to each other")
    if not np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
        raise ValueError("the last row of a pose is 0 0 0 1")


def _optional_codec(codec: ValueCodec) -> ValueCodec:
    """Codec of a value or None, which is an empty list."""
    if codec.schema["type"] == "array":
        return ValueCodec(
            codec.schema,
            lambda value: [] if value is None else codec.encode(value),
            lambda content: codec.decode(content) if content else None,
        )
    listed = _tuple_codec(codec)
    return ValueCodec(
        listed.schema,
        lambda value: listed.encode(() if value is None else (value,)),
        lambda content: next(iter(listed.decode(content)), None),
    )


def _tuple_codec(codec: ValueCodec) -> ValueCodec:
    if codec.schema["type"] == "array":
        raise TypeError("lists of lists are not recorded")
    return ValueCodec(
        {"type": "array", "items": codec.schema},
        lambda values: list(map(codec.encode, values)),
        lambda content: tuple(map(codec.decode, _checked_instance(content, list))),
    )


def _null_if_unknown(number: float | None) -> float | None:
    return number if number is not None and isfinite(number) else None


def _to_float(value: Any) -> float:
    number = float(value)
    if not abs(number) <= LARGEST_NUMBER:
        raise ValueError(f"{number} can't be measured")
    return number


def _checked_count(value: Any) -> int:
    if type(value) is not int or not 0 <= value <= LARGEST_RECORDED_COUNT:
        raise ValueError(f"{value!r} is no number of a section, a pass or anything else counted")
    return value


def _checked_instance(value: Any, kind: type[Any]) -> Any:
    if not isinstance(value, kind):
        raise ValueError(f"{value!r} is no {kind.__name__}")
    return value


UNKNOWN_FLOAT_CODEC: Final = ValueCodec(
    {"type": "number"}, _null_if_unknown, lambda value: nan if value is None else _to_float(value)
)
"""Of a number that may be NaN, which JSON has as null."""

PROFILE_FIELDS: Final = ("time", "time_uncertainty")
"""What is written of a profile: its points are a message of their own, which viewers draw."""

PLAIN_CODECS: Final[Mapping[Any, ValueCodec]] = {
    bool: ValueCodec({"type": "boolean"}, bool, lambda value: _checked_instance(value, bool)),
    int: ValueCodec({"type": "integer"}, int, _checked_count),
    float: ValueCodec({"type": "number"}, float, _to_float),
    str: ValueCodec({"type": "string"}, str, lambda value: _checked_instance(value, str)),
    datetime: ValueCodec({"type": "string"}, datetime.isoformat, datetime.fromisoformat),
    Profile: ValueCodec(
        {"type": "object", "properties": {name: {"type": "number"} for name in PROFILE_FIELDS}},
        lambda profile: {name: getattr(profile, name) for name in PROFILE_FIELDS},
        lambda content: Profile(
            np.empty(0),
            np.empty(0),
            time=_to_float(content["time"]),
            time_uncertainty=_to_float(content["time_uncertainty"]),
        ),
    ),
}
"""Codecs of types that hold no others."""


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Topic(Generic[T]):
    """A topic of a recording: its name and schema, and how messages are encoded and decoded.

    Parameters
    ----------
    name : str
        For instance ``/profile``.
    schema_name : str
        Name of the schema, for instance ``foxglove.PointCloud``.
    message_encoding : str
        Of the messages: ``protobuf`` or ``json``.
    schema_bytes : bytes
        The schema itself: a FileDescriptorSet, or a JSON schema.
    encode : callable
        Bytes of a message.
    decode : callable
        The message that bytes hold; raises what `read_messages` reports if they hold none.
    """

    name: str
    schema_name: str
    message_encoding: Literal["protobuf", "json"]
    schema_bytes: bytes
    encode: Callable[[T], bytes]
    decode: Callable[[bytes], T]

    @classmethod
    def of(cls, name: str, kind: type[T], *, decimals: int | None = None) -> Topic[T]:
        """Make a topic of a class: schema and codec follow from its fields.

        Parameters
        ----------
        name : str
            Of the topic.
        kind : type
            A dataclass, whose messages are JSON (see `value_codec` for what its fields may be), or
            a generated protobuf class, for instance ``foxglove.PointCloud``.
        decimals : int, optional
            To which the arrays of a dataclass are rounded when they are written.
        """
        if issubclass(kind, Message):
            definition = build_file_descriptor_set(kind).SerializeToString()
            encode = methodcaller("SerializeToString")
            schema_name = kind.DESCRIPTOR.full_name
            return cls(name, schema_name, "protobuf", definition, encode, kind.FromString)
        codec = dataclass_codec(kind, decimals)
        return cls(
            name,
            codec.schema["title"],
            "json",
            json.dumps(codec.schema).encode(),
            lambda message: json.dumps(codec.encode(message), allow_nan=False).encode(),
            lambda data: codec.decode(json.loads(data)),
        )
