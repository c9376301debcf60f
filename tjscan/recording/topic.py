"""A topic: a name, a schema, and how its messages become bytes and bytes its messages."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, Literal, TypeVar

from google.protobuf.message import DecodeError, Message
from mcap_protobuf.schema import build_file_descriptor_set

T = TypeVar("T")
M = TypeVar("M", bound=Message)

TEXT_SCHEMA: Final = {"type": "string"}
INTEGER_SCHEMA: Final = {"type": "integer"}
NUMBER_SCHEMA: Final = {"type": "number"}
BOOLEAN_SCHEMA: Final = {"type": "boolean"}
NUMBERS_SCHEMA: Final = {"type": "array", "items": NUMBER_SCHEMA}
TEXTS_SCHEMA: Final = {"type": "array", "items": TEXT_SCHEMA}


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
        The message that bytes hold; raises ValueError, KeyError, TypeError or OverflowError where
        they hold none.
    """

    name: str
    schema_name: str
    message_encoding: Literal["protobuf", "json"]
    schema_bytes: bytes
    encode: Callable[[T], bytes]
    decode: Callable[[bytes], T]

    @property
    def schema_encoding(self) -> str:
        """Name that MCAP has for the language of the schema: ``jsonschema`` or ``protobuf``."""
        return "jsonschema" if self.message_encoding == "json" else self.message_encoding


def make_protobuf_topic(name: str, kind: type[M]) -> Topic[M]:
    """A topic whose messages are of a generated protobuf class.

    Parameters
    ----------
    name : str
        Of the topic.
    kind : type
        The class, for instance ``foxglove.PointCloud``.
    """

    def decode(data: bytes) -> M:
        try:
            return kind.FromString(data)
        except DecodeError as error:
            raise ValueError(f"no {kind.DESCRIPTOR.full_name}: {error}") from error

    definition = build_file_descriptor_set(kind).SerializeToString()
    return Topic(
        name,
        kind.DESCRIPTOR.full_name,
        "protobuf",
        definition,
        lambda message: message.SerializeToString(),
        decode,
    )


def make_json_topic(
    name: str,
    schema: str,
    fields: Mapping[str, Mapping[str, Any]],
    to_fields: Callable[[T], dict[str, Any]],
    from_fields: Callable[[dict[str, Any]], T],
) -> Topic[T]:
    """A topic whose messages are JSON objects.

    Parameters
    ----------
    name, schema : str
        Of the topic and of its schema.
    fields : mapping
        JSON schema of each field, spelt out to its leaves: Foxglove refuses schemas that leave
        anything open.
    to_fields, from_fields : callable
        The fields of a message, and the message of fields.
    """

    def decode(data: bytes) -> T:
        try:
            content = json.loads(data)
        except RecursionError as error:
            raise ValueError("nested too deeply") from error
        if not isinstance(content, dict):
            raise ValueError(f"no fields of {schema}")
        return from_fields(content)

    return Topic(
        name,
        schema,
        "json",
        json.dumps(json_object_schema(schema, **fields)).encode(),
        lambda message: json.dumps(to_fields(message), allow_nan=False).encode(),
        decode,
    )


def json_object_schema(title: str, **fields: Mapping[str, Any]) -> dict[str, Any]:
    """JSON schema of an object with these fields."""
    return {"type": "object", "title": title, "properties": dict(fields)}
