"""The project's documents: their texts, and the commands that their fenced blocks give."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]

DOCUMENTS: Final = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
"""Every document that is written for people."""


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block of a document.

    Parameters
    ----------
    language : str
        What stands after its fence.
    text : str
        Its lines, without the indent of the fence.
    """

    language: str
    text: str


def fenced_blocks(document: Path) -> Iterator[Block]:
    """The fenced blocks of a document, in order."""
    text = document.read_text(encoding="utf-8")
    for found in re.finditer(r"^( *)```(\w*)\n(.*?)^\1```$", text, re.MULTILINE | re.DOTALL):
        indent, language, lines = found.groups()
        yield Block(language, re.sub(f"^{indent}", "", lines, flags=re.MULTILINE))


def without_blocks(document: Path) -> str:
    """The text of a document without its fenced blocks."""
    text = document.read_text(encoding="utf-8")
    return re.sub(r"^( *)```.*?^\1```$", "", text, flags=re.MULTILINE | re.DOTALL)


def commands_of(document: Path) -> list[str]:
    """The commands in a document's ``sh`` blocks, one a line, as the shell's own words."""
    lines = (
        line
        for block in fenced_blocks(document)
        if block.language == "sh"
        for line in block.text.replace("\\\n", " ").splitlines()
    )
    words = (shlex.split(line, comments=True) for line in lines)
    return [shlex.join(found).removeprefix(".venv/bin/") for found in words if found]
