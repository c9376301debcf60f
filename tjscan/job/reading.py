"""From a file of tables, with single keys replaced, to its checked values; of any kind of job."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml, validate_table
from tjscan.core.errors import ConfigurationError

MUTUALLY_EXCLUSIVE_KEYS: Final = {"calibration.file": "T_f_s_mm", "calibration.T_f_s_mm": "file"}
"""The key of the same table that each of these excludes, so that it goes when this is set."""

M = TypeVar("M", bound=StrictFileModel)


class FileKind(NamedTuple):
    """A kind of TOML file, recognised by its tables.

    Parameters
    ----------
    word : str
        Chooses it on the command line.
    name : str
        With its article.
    own_tables : set of str
        Tables or keys that every such file has, and that no file of another kind has together.
    use : str
        What such a file is for.
    """

    word: str
    name: str
    own_tables: set[str]
    use: str


FILE_KINDS: Final = (
    FileKind("joint", "a joint", {"leg", "brace"}, "a job names it under joint.file"),
    FileKind(
        "chain",
        "a chain of a calibration and a scan",
        {"calibrate", "scan"},
        "run it with 'tjscan chain'",
    ),
    FileKind("weld", "a job of a weld", {"scan", "weld"}, "run it with 'tjscan weld'"),
    FileKind("scan", "a job of a scan", {"scan"}, "run it with 'tjscan scan'"),
    FileKind("crawl", "a job of a crawler", {"vehicle", "weld"}, "run it with 'tjscan crawl run'"),
    FileKind("tow", "a job of towing vehicles", {"area", "seam"}, "run it with 'tjscan tow run'"),
    FileKind(
        "recorded",
        "a job of a calibration from recorded profiles",
        {"recorded"},
        "run it with 'tjscan calibrate'",
    ),
    FileKind("calibrate", "a job of a calibration", {"board"}, "run it with 'tjscan calibrate'"),
    FileKind("accept", "a job of an acceptance", {"artefact"}, "run it with 'tjscan accept'"),
    FileKind("study", "a study", {"job"}, "run it with 'tjscan study'"),
    FileKind(
        "wps",
        "a welding procedure specification",
        {"arc", "bead"},
        "plan with it: 'tjscan plan RUN --wps'",
    ),
)
"""The kinds of files that people write."""


def kind_of_other_file(tables: Collection[str], known: Collection[str]) -> FileKind | None:
    """Kind of a file that is not of the expected kind; None if its tables fit no other kind.

    Parameters
    ----------
    tables : collection of str
        Tables and keys of the file.
    known : collection of str
        Tables and keys of the expected kind.
    """
    kind = next((kind for kind in FILE_KINDS if kind.own_tables <= set(tables)), None)
    return None if kind is None or kind.own_tables <= set(known) else kind


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
            table = _inner_table(table, name, key)
        if isinstance(table, list):
            raise ConfigurationError(
                f"is an array of tables; name one: {'.'.join(tables)}.NAME.{last}", key=key
            )
        table[last] = value
        if key in MUTUALLY_EXCLUSIVE_KEYS:
            table.pop(MUTUALLY_EXCLUSIVE_KEYS[key], None)


def _inner_table(tables: Any, name: str, key: str) -> Any:
    """A table in a table; in an array of tables the one of that name, or number from 0."""
    if isinstance(tables, dict):
        found = tables.setdefault(name, {})
    else:
        named = {casefolded_name(str(one.get("name"))): one for one in tables if type(one) is dict}
        numbered = {str(number): one for number, one in enumerate(tables)}
        found = named.get(casefolded_name(name), numbered.get(name))
        if found is None:
            known = f"; there are: {', '.join(named)}" if named else ""
            raise ConfigurationError(f"no table of it is called {name}{known}", key=key)
    if not isinstance(found, dict | list):
        raise ConfigurationError(f"{name} is no table", key=key)
    return found


def casefolded_name(name: str) -> str:
    """Station name without upper case, as folders of some systems and options have it."""
    return name.casefold().replace("-", "_")
