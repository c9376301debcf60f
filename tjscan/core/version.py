"""The program's version, as files and the command line state it."""

from __future__ import annotations

from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Final

PROGRAM_VERSION: Final = "0.1.0"

SOURCE_SUFFIXES: Final = frozenset((".py", ".c", ".urdf"))
"""Of the program's files that decide what it computes."""


@cache
def program_code() -> str:
    """Version of the program, and the beginning of the SHA-256 of its source."""
    package = Path(__file__).parents[1]
    digest = sha256()
    for file in sorted(package.rglob("*")):
        if file.suffix in SOURCE_SUFFIXES:
            digest.update(file.relative_to(package).as_posix().encode() + b"\0")
            digest.update(file.read_bytes())
    return f"{PROGRAM_VERSION} {digest.hexdigest()[:12]}"
