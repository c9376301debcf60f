"""JSON schemas of configuration files, from which editors complete, check and explain keys."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from docstring_parser import Docstring, DocstringStyle, parse

SCHEMA_DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"

_SI_UNITS_IN_DOCSTRING: Final = re.compile(
    r"[,;]?\s+(?:in )?(?:square )?(?:metres|radians|m/s²?)(?: and (?:radians|m/s²?))?(?=[.,;:]|$)"
    r"|\s+\((?:metres|radians)\)|\s+in (?:metres|radians)(?= )|\s+Metres, radians\."
)
"""A docstring states which units the program keeps; the file has the ones that its keys end in."""


def describe_table(
    schema: dict[str, Any],
    table: type[Any],
    keys: Mapping[str, str],
    to_file: Mapping[str, Callable[[Any], Any]] | None = None,
) -> None:
    """Make the schema of a class that of its table in a file, explained by the docstrings.

    Parameters
    ----------
    schema : dict
        JSON schema of the table; changed in place.
    table : type
        The class; its and its bases' docstrings are numpydoc.
    keys : mapping of str to str
        Key in the file of each field; others are in no file.
    to_file : mapping, optional
        What brings a key's default into the unit of the file, for keys that have one.
    """
    properties = schema["properties"]
    for hidden in properties.keys() - set(keys.values()):
        del properties[hidden]
    for key, value in properties.items():
        if isinstance(value.get("default"), dict):
            del value["default"]  # a table's keys have their own
        elif "default" in value and to_file and key in to_file:
            value["default"] = to_file[key](value["default"])
    if text := _parsed_docstring(table).description:
        schema["description"] = _SI_UNITS_IN_DOCSTRING.sub("", text.strip())
    for entry in (
        entry for base in reversed(table.__mro__) for entry in _parsed_docstring(base).params
    ):
        for name in entry.arg_name.split(", "):
            if name in keys and keys[name] in properties:
                text = _SI_UNITS_IN_DOCSTRING.sub("", " ".join((entry.description or "").split()))
                properties[keys[name]]["description"] = text


def _parsed_docstring(table: type[Any]) -> Docstring:
    return parse(table.__doc__ or "", DocstringStyle.NUMPYDOC)
