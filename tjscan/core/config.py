"""TOML files as frozen pydantic models, with errors that name file, key and the nearest choice."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Self, TypeVar, get_args

import pydantic
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails

from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.files import read_small_file
from tjscan.core.manifest import check_files_unaltered
from tjscan.core.toml_hints import encoding_hint, list_hint, number_hint, syntax_hint, unit_hint
from tjscan.core.units import SettingsTable


class StrictFileModel(pydantic.BaseModel):
    """Base of the models of configuration files: frozen, strict about types, closed."""

    model_config = pydantic.ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False
    )

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Yield key and message of what does not go together; the first is refused."""
        yield from ()

    @pydantic.model_validator(mode="after")
    def _refuse_contradictions(self) -> Self:
        for key, message in self.contradictions():
            raise ConfigurationError(message, key=key)
        return self

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: pydantic.GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The file's JSON schema, its keys explained by the class's docstring."""
        from tjscan.core.json_schema import describe_table

        schema = handler(core_schema)
        keys = {name: field.alias or name for name, field in cls.model_fields.items()}
        describe_table(handler.resolve_ref_schema(schema), cls, keys)
        return schema


J = TypeVar("J")
M = TypeVar("M", bound=StrictFileModel | SettingsTable)

PYDANTIC_UNKNOWN_KEY_ERRORS: Final = ("extra_forbidden", "unexpected_keyword_argument")
"""What pydantic calls a key that a table does not have."""

MOST_CONFIGURATION_BYTES: Final = 1_000_000
"""No configuration is larger; a larger file is something else given by mistake."""

LONGEST_LINE_CHARACTERS: Final = 5000
"""Characters. A key of thousands of parts would keep the parser busy for minutes."""

QUOTED_VALUE_CHARACTERS: Final = 200
"""Characters of a wrong value that a message repeats."""


def read_toml(file: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    ConfigurationError
        If the file is missing, no file, too large, not UTF-8 or not TOML.
    """
    text = ""
    try:
        content = read_small_file(file, MOST_CONFIGURATION_BYTES, "a configuration")
        if (hint := encoding_hint(content)) is not None:
            raise ConfigurationError(hint, file=file)
        text = content.decode()
        if max(map(len, text.splitlines()), default=0) > LONGEST_LINE_CHARACTERS:
            raise ConfigurationError(
                f"has a line of more than {LONGEST_LINE_CHARACTERS} characters", file=file
            )
        return tomllib.loads(text)
    except FileNotFoundError:
        near = nearest_word(file.name, [f.name for f in file.parent.glob("*.toml")])
        meant = f" Did you mean: {near}?" if near else ""
        raise ConfigurationError(f"there is no such file.{meant}", file=file) from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigurationError(
            f"line {line} is not UTF-8 text: save the file as UTF-8 ({error})", file=file
        ) from None
    except (ValueError, RecursionError) as error:  # not of its own kind alone: huge numbers, nests
        hint = syntax_hint(text, str(error))
        raise ConfigurationError(f"is not valid TOML: {error}{hint}", file=file) from None
    except NotADirectoryError:
        raise ConfigurationError(
            "is a file; give the directory that it is in", file=file.parent
        ) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None


def validate_table(model: type[M], data: Mapping[str, Any], file: Path | None = None) -> M:
    """Check a table's keys and values against its model and return an instance of it.

    Parameters
    ----------
    model : type
        A `StrictFileModel`, or `SettingsTable`.
    data : mapping
        Keys and values as they are in the file.
    file : Path, optional
        Where they are, for messages.

    Raises
    ------
    ConfigurationError
        For the first key that is unknown, missing, or of a wrong type or value.
    """
    try:
        return pydantic.TypeAdapter(model).validate_python(dict(data))
    except pydantic.ValidationError as error:
        # A misspelt key is both unknown and missing: report the former.
        first = min(error.errors(), key=lambda e: e["type"] not in PYDANTIC_UNKNOWN_KEY_ERRORS)
        key = ".".join(str(part) for part in first["loc"])
        message = _list_positions_in_words(first["loc"]) + _explain_error(model, first)
        raise ConfigurationError(message, file=file, key=key or None) from None


def read_unaltered_json(model: type[J], file: Path, most: int, what: str) -> J:
    """Read a JSON file of a run directory that this program wrote, into a dataclass.

    Parameters
    ----------
    model : type
        The dataclass.
    file : Path
        The file.
    most : int
        Bytes of the largest file of its kind.
    what : str
        What it should be, in words, such as ``summary of a scan``.

    Raises
    ------
    ConfigurationError
        If it is missing, or is something else.
    RecordingError
        If it is not as it was written.
    """
    try:
        content = read_small_file(file, most, f"a {what}")
        check_files_unaltered(file)
        return pydantic.TypeAdapter(model).validate_json(content)
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or None
        raise ConfigurationError(
            f"is no {what}, or damaged: {first['msg']}", file=file, key=key
        ) from None


def table_to_dict(table: StrictFileModel | SettingsTable) -> dict[str, Any]:
    """Convert a table's model to the keys and values of its file; keys without a value left out."""
    found: dict[str, Any] = pydantic.TypeAdapter(type(table)).dump_python(
        table, mode="json", exclude_none=True, by_alias=True
    )
    return found


@contextmanager
def add_file_to_errors(file: Path | None = None, *, key: str | None = None) -> Iterator[None]:
    """Add a file to configuration errors of the block that name none, and state which key it is.

    Parameters
    ----------
    file : Path, optional
        The file that was read.
    key : str, optional
        The key whose value was read.
    """
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(
            error.message, file=error.file or file, key=key or error.key
        ) from None


def _explain_error(model: Any, detail: ErrorDetails) -> str:
    """One sentence that states what is wrong with a key and what would be right."""
    if detail["type"] in PYDANTIC_UNKNOWN_KEY_ERRORS:
        known = _known_keys_at(model, [str(part) for part in detail["loc"][:-1]])
        key = str(detail["loc"][-1])
        radius = key.replace("diameter", "radius")
        meant = f"{radius}, half of it" if radius != key else nearest_word(key, known)
        return f"unknown key; did you mean: {meant}?"
    if detail["type"] in ("model_type", "model_attributes_type", "dataclass_type"):
        return f"must be a table (found {_shortened_repr(detail['input'])})"
    if detail["type"] in ("tuple_type", "list_type"):
        return f"must be a list, as [1.0, 2.0] (found {_shortened_repr(detail['input'])})"
    if detail["type"] == "missing":
        return "this key is required"
    if detail["type"] == "literal_error":
        return f"{_shortened_repr(detail['input'])} is none of {detail['ctx']['expected']}"
    message = detail["msg"].removeprefix("Value error, ")
    message = f"{message[:1].lower()}{message[1:]}"
    found = detail["input"]
    if isinstance(found, dict):
        return message
    return f"{message} (found {_shortened_repr(found)}){_hint_for_value(detail)}"


def _hint_for_value(detail: ErrorDetails) -> str:
    """What a wrong value most likely is, with what to write; empty if nothing is recognised."""
    found, bounds = detail["input"], detail.get("ctx", {})
    if detail["type"] == "too_long":
        return list_hint(found, bounds["max_length"])
    if detail["type"] in ("float_type", "int_type"):
        return number_hint(found)
    key = next((part for part in reversed(detail["loc"]) if isinstance(part, str)), "")
    least, most = (bounds.get(f"{which}e", bounds.get(f"{which}t")) for which in "gl")
    return unit_hint(key, found, least, most)


def _list_positions_in_words(path: Sequence[int | str]) -> str:
    """Which entries of lists a path leads through, counted from 1; a key counts them from 0."""
    pairs = pairwise(path)
    return "".join(f"{name} number {i + 1}: " for name, i in pairs if isinstance(i, int))


def _shortened_repr(value: Any) -> str:
    """A value in a message, cut short; nests of any depth and numbers of any length."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        return f"a {type(value).__name__} of great size"
    return text if len(text) <= QUOTED_VALUE_CHARACTERS else f"{text[:QUOTED_VALUE_CHARACTERS]}…"


def _known_keys_at(model: Any, path: Sequence[str]) -> list[str]:
    """Known keys of the table at a dotted path."""
    for part in path:
        inner = list(_tables_in_type(_types_of_keys(model).get(part)))
        model = inner[0] if inner else model
    return list(_types_of_keys(model))


def _types_of_keys(model: Any) -> Mapping[str, Any]:
    """Type of each key of a table."""
    if issubclass(model, SettingsTable):
        found: Mapping[str, Any] = model.file_key_types()
        return found
    return {name: field.annotation for name, field in model.model_fields.items()}


def _tables_in_type(hint: Any) -> Iterator[type[StrictFileModel | SettingsTable]]:
    """The tables that are in a type, however deep."""
    if isinstance(hint, type) and issubclass(hint, StrictFileModel | SettingsTable):
        yield hint
    for part in get_args(hint):
        yield from _tables_in_type(part)
