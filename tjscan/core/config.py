"""TOML files as frozen pydantic models, with errors that name file, key and the nearest choice."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from tjscan.core.errors import ConfigurationError, nearest
from tjscan.core.files import check_size


class FileModel(BaseModel):
    """A table of a configuration file: frozen, strict about types, closed to unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


M = TypeVar("M", bound=FileModel)

MAXIMUM_BYTES: Final = 1_000_000
"""No configuration is larger; a larger file is something else given by mistake."""

LONGEST_LINE: Final = 5000
"""Characters. A key of thousands of parts would keep the parser busy for minutes."""

MOST_TOLD: Final = 200
"""Characters of a wrong value that a message repeats."""


def read_toml(file: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    ConfigurationError
        If the file is missing, no file, too large, not UTF-8 or not TOML.
    """
    try:
        check_size(file, MAXIMUM_BYTES, "a configuration")
        text = file.read_text(encoding="utf-8")
        if max(map(len, text.splitlines()), default=0) > LONGEST_LINE:
            raise ConfigurationError(
                f"has a line of more than {LONGEST_LINE} characters", file=file
            )
        return tomllib.loads(text)
    except FileNotFoundError:
        near = nearest(file.name, [f.name for f in file.parent.glob("*.toml")])
        hint = f" Did you mean: {near}?" if near else ""
        raise ConfigurationError(f"there is no such file.{hint}", file=file) from None
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"is not UTF-8 text ({error})", file=file) from None
    except (ValueError, RecursionError) as error:  # not of its own kind alone: huge numbers, nests
        raise ConfigurationError(f"is not valid TOML: {error}", file=file) from None
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None


def validate(model: type[M], data: Mapping[str, Any], file: Path | None = None) -> M:
    """Check `data` against `model`.

    Raises
    ------
    ConfigurationError
        For the first key that is unknown, missing, or of a wrong type or value.
    """
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        # A misspelt key is both unknown and missing: say the former.
        first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigurationError(_say(model, first), file=file, key=key) from None


@contextmanager
def naming(file: Path | None = None, *, key: str | None = None) -> Iterator[None]:
    """Add a file to configuration errors of the block that name none, and say which key it is."""
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(
            error.message, file=error.file or file, key=key or error.key
        ) from None


def _say(model: type[FileModel], detail: ErrorDetails) -> str:
    """One sentence that says what is wrong with a key and what would be right."""
    if detail["type"] == "extra_forbidden":
        known = _keys_at(model, [str(part) for part in detail["loc"][:-1]])
        return f"unknown key; did you mean: {nearest(str(detail['loc'][-1]), known)}?"
    if detail["type"] in ("model_type", "model_attributes_type"):
        return f"must be a table (found {_told(detail['input'])})"
    if detail["type"] == "missing":
        return "this key is required"
    if detail["type"] == "literal_error":
        return f"{_told(detail['input'])} is none of {detail['ctx']['expected']}"
    message = detail["msg"].removeprefix("Value error, ")
    message = f"{message[:1].lower()}{message[1:]}"
    found = detail["input"]
    return message if isinstance(found, dict) else f"{message} (found {_told(found)})"


def _told(value: Any) -> str:
    """A value in a message, cut short; nests of any depth and numbers of any length."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        return f"a {type(value).__name__} of great size"
    return text if len(text) <= MOST_TOLD else f"{text[:MOST_TOLD]}…"


def _keys_at(model: type[FileModel], path: Sequence[str]) -> list[str]:
    """Known keys of the table at a dotted path."""
    for part in path:
        field = model.model_fields.get(part)
        kinds = () if field is None else (field.annotation, *get_args(field.annotation))
        inner = [k for k in kinds if isinstance(k, type) and issubclass(k, FileModel)]
        model = inner[0] if inner else model
    return list(model.model_fields)
