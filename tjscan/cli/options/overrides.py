"""Dotted options such as ``--scan.step-mm 20`` as keys of the job file."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from tjscan.core.errors import ConfigurationError

FILE_KEY_SUFFIXES: Final = (".file", ".recording", ".profiles", ".poses", ".touched")
"""Endings of keys whose values are files."""

JobKeys = Annotated[str, Parameter(allow_leading_hyphen=True, show=False)]
"""Type of the arguments of a command that are keys of its job: ``--scan.step-mm 20``."""


def parse_overrides(tokens: Sequence[str], method: str | None = None) -> dict[str, Any]:
    """Parse options that override keys of a job file into dotted keys and values.

    The path of a file counts from the working directory, as everywhere on a command line.

    Parameters
    ----------
    tokens : sequence of str
        The arguments as given.
    method : str, optional
        Value of the key ``method``, which has an option of its own.

    Raises
    ------
    ConfigurationError
        If a token is no dotted option, has no value, or one that begins as a list or a table and is
        none.
    """
    overrides: dict[str, Any] = {}
    rest = iter(tokens)
    for token in rest:
        option, equals, value = token.partition("=")
        if not option.startswith("--") or "." not in option:
            raise ConfigurationError(
                f"unknown option or argument {token!r}; "
                "a key of the job file is written --table.key VALUE"
            )
        text = value if equals else next(rest, None)
        if text is None:
            raise ConfigurationError(f"option {option} needs a value")
        key, found = option[2:].replace("-", "_"), _toml_value(option, text)
        is_path = key.endswith(FILE_KEY_SUFFIXES) and isinstance(found, str)
        overrides[key] = str(Path(found).absolute()) if is_path else found
    return overrides if method is None else overrides | {"method": method}


def _toml_value(option: str, text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError) as error:
        if text.lstrip().startswith(("[", "{")):
            raise ConfigurationError(
                f"option {option} has no value as TOML writes it, for instance [1, 2], or "
                f'[{{key = "word"}}] with an equals sign after each key: {error} (found {text!r})'
            ) from None
        return text  # a bare word
