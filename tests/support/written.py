"""What a run wrote, without the lines that say when and by what it was written."""

from __future__ import annotations

from pathlib import Path


def content(file: Path) -> list[bytes]:
    """The lines of a file below those that say where it comes from."""
    lines = file.read_bytes().splitlines()
    return [line for line in lines if not line.startswith((b"#", b"comment"))]
