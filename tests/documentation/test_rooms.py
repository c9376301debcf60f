"""No string names a room above its own: such an arrow runs upward, unseen by import-linter."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULE = re.compile(r"\btjscan\.(\w+)")
FREE = ("cli", "api", "__main__")
"""Rooms that nothing is above."""


def floors() -> dict[str, int]:
    """Floor of each room, from the contract of import-linter; the lowest is 0."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = next(one for one in contracts["contracts"] if one["type"] == "layers")["layers"]
    return {
        room: floor
        for floor, rooms in enumerate(reversed(layers))
        for room in re.findall(r"\w+", rooms)
    }


def named_rooms(file: Path) -> Iterator[str]:
    """Rooms whose modules are named in the strings and docstrings of a file."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from MODULE.findall(node.value)


@pytest.mark.parametrize("room", sorted(set(floors()) - set(FREE)))
def test_no_string_names_a_room_above(room: str) -> None:
    floor = floors()
    upward = {
        (file.name, named)
        for file in (ROOT / "tjscan" / room).rglob("*.py")
        for named in named_rooms(file)
        if floor.get(named, 0) > floor[room]
    }
    assert not upward
