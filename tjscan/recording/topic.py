"""A topic: a name, a schema, and how its messages become bytes and bytes its messages."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from operator import methodcaller
from typing import Any, Generic, Literal, TypeVar, cast

from google.protobuf.message import DecodeError, Message
from mcap_protobuf.schema import build_file_descriptor_set

from tjscan.recording.codec import dataclass_codec

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
        The message that bytes hold; raises ValueError, KeyError, TypeError or OverflowError if
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
            return cast("Topic[T]", _protobuf_topic(name, kind))
        codec = dataclass_codec(kind, decimals)
        schema: str = codec.schema["title"]

        def decode(data: bytes) -> T:
            try:
                content = json.loads(data)
            except RecursionError as error:
                raise ValueError("nested too deeply") from error
            if not isinstance(content, dict):
                raise ValueError(f"no fields of {schema}")
            return cast("T", codec.decode(content))

        definition = json.dumps(codec.schema).encode()
        return cls(name, schema, "json", definition, codec.json_bytes, decode)


def _protobuf_topic(name: str, kind: type[Message]) -> Topic[Any]:
    def decode(data: bytes) -> Message:
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
        methodcaller("SerializeToString"),
        decode,
    )
