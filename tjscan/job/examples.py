"""The example files that come with the program, each with the files that it names."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from importlib.metadata import files
from pathlib import Path
from typing import Any

from tjscan.core.errors import ConfigurationError, nearest_word


def examples() -> dict[str, str]:
    """Names of the examples, and the first sentence of each."""
    found = {file.stem: file for file in _examples_folder("examples").glob("*.toml")}
    return {name: _first_sentence(found[name]) for name in sorted(found)}


def files_of_example(name: str) -> dict[str, str]:
    """Names and texts of an example's files, to be written into one folder.

    Parameters
    ----------
    name : str
        Of the example.

    Raises
    ------
    ConfigurationError
        If there is none of that name.
    """
    folder, known = _examples_folder("examples"), list(examples())
    if name not in known:
        raise ConfigurationError(
            f"there is no example {name!r}; did you mean: {nearest_word(name, known)}? "
            "'tjscan init' lists them all"
        )
    texts: dict[str, str] = {}
    left = [folder / f"{name}.toml"]
    while left:
        file = left.pop()
        text = file.read_text(encoding="utf-8")
        named = [entry for entry in _strings_in(tomllib.loads(text)) if entry.endswith(".toml")]
        left += [other for entry in named if (other := folder / entry).name not in texts]
        for place in ("../cad/", "examples/"):
            text = text.replace(place, "")
        texts[file.name] = text
    return texts


def _examples_folder(name: str) -> Path:
    """The examples: in ``share/tjscan`` of an installed package, else in the checkout."""
    for file in files("tjscan") or ():
        if file.parts[-3:-1] == ("tjscan", name) and file.suffix == ".toml":
            return Path(str(file.locate())).resolve().parent
    return Path(__file__).parents[2] / name


def _strings_in(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _strings_in(inner)


def _first_sentence(file: Path) -> str:
    """First sentence of the comment at the head of a file, up to a full stop or a colon."""
    lines = []
    for line in file.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return re.split(r"(?<! al)[.:?](?: |$)", " ".join(lines), maxsplit=1)[0]
