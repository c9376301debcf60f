"""From a file of tables, with single keys replaced, to its checked values; of any kind of job."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, TypeVar

from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.job.kinds import kind_of_other_file

EXCLUDING_KEYS: Final = {"calibration.file": "T_f_s_mm", "calibration.T_f_s_mm": "file"}
"""The key of the same table that each of these excludes, so that it goes when this is set."""

M = TypeVar("M", bound=StrictFileModel)


def read_job(model: type[M], file: Path, overrides: dict[str, Any] | None = None) -> M:
    """Read a job of any kind, with single keys replaced.

    Parameters
    ----------
    model : type
        The kind of job.
    file : Path
        The TOML file.
    overrides : dict, optional
        Dotted keys such as ``scan.step_mm`` and their values. One of two keys that exclude each
        other displaces the other.

    Raises
    ------
    ConfigurationError
        If the file can't be read, is of another kind, or a key is unknown, missing or of a wrong
        type or value.
    """
    data = read_toml(file)
    if (other := kind_of_other_file(data, model.model_fields)) is not None:
        raise ConfigurationError(f"is {other.name}: {other.use}", file=file)
    with add_file_to_errors(file):
        replace_keys(data, overrides or {})
        return validate_table(model, data, file)


def replace_keys(data: dict[str, Any], overrides: dict[str, Any]) -> None:
    """Replace single keys of a file's tables, in place.

    Parameters
    ----------
    data : dict
        The tables.
    overrides : dict
        Dotted keys and their values.

    Raises
    ------
    ConfigurationError
        If there is no place for a key.
    """
    for key, value in overrides.items():
        *tables, last = key.split(".")
        table: Any = data
        for name in tables:
            table = _inner(table, name, key)
        if isinstance(table, list):
            raise ConfigurationError(
                f"is an array of tables; name one: {'.'.join(tables)}.NAME.{last}", key=key
            )
        table[last] = value
        if key in EXCLUDING_KEYS:
            table.pop(EXCLUDING_KEYS[key], None)


def _inner(tables: Any, name: str, key: str) -> Any:
    """A table in a table; in an array of tables the one of that name, or number from 0."""
    if isinstance(tables, dict):
        return _table(tables.setdefault(name, {}), name, key)
    named = {
        casefolded_name(str(entry.get("name"))): entry
        for entry in tables
        if isinstance(entry, dict)
    }
    if (
        (found := named.get(casefolded_name(name))) is None
        and name.isdigit()
        and int(name) < len(tables)
    ):
        found = tables[int(name)]
    if found is None:
        known = f"; there are: {', '.join(named)}" if named else ""
        raise ConfigurationError(f"no table of it is called {name}{known}", key=key)
    return _table(found, name, key)


def _table(found: Any, name: str, key: str) -> Any:
    if not isinstance(found, dict | list):
        raise ConfigurationError(f"{name} is no table", key=key)
    return found


def casefolded_name(name: str) -> str:
    """Station name without upper case, as folders of some systems and options have it."""
    return name.casefold().replace("-", "_")
