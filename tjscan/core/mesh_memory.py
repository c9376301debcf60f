"""What reading a mesh or a cloud takes of memory, known before it is read.

A parser takes the more memory the more elements a file has, not the more bytes: of a text of short
numbers eighty times its size. The rates below were measured with the densest files of each kind
that are legal, and hold for reading and checking them, not for what is made of them.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from itertools import islice, takewhile
from pathlib import Path
from typing import IO, Final

from tjscan.core.errors import ConfigurationError

MOST_MEMORY: Final = 500_000_000
"""Bytes that reading a file may take."""

MOST_HEADER_LINES: Final = 1000
"""Of a PLY."""

LONGEST_LINE: Final = 10_000
"""Bytes of a line in such a header."""

CHUNK: Final = 1 << 16
"""Bytes that are counted at once."""

BINARY_STL: Final = 6.6
"""Bytes for each of a binary STL."""

STL_WORD: Final = 80
OBJ_WORD: Final = 65
PLY_WORD: Final = 152
TABLE_WORD: Final = 36
"""Bytes for each word of a text."""

OBJ_BYTE: Final = 8
"""Bytes for each of an OBJ of long words."""

PLY_VERTEX: Final = 120
PLY_FACE: Final = 180
"""Bytes for each element of a binary PLY, beside those of the file."""

MODEL_ELEMENT: Final = 135
MODEL_ATTRIBUTE: Final = 300
"""Bytes for each element of a 3MF's model, and for each of its attributes."""

SEPARATORS: Final = bytes.maketrans(b",;/", b"   ")
"""What separates words, beside white space."""


def check_memory_to_read(path: Path) -> None:
    """Refuse a mesh or cloud that would take more than `MOST_MEMORY` to read.

    Raises
    ------
    ConfigurationError
        If it would.
    zipfile.BadZipFile
        If it should be an archive, and is none.
    """
    refuse_memory(path, memory_to_read(path))


def memory_to_read(path: Path) -> float:
    """Bytes of memory that reading a mesh or a table of points takes at most.

    Parameters
    ----------
    path : Path
        The file, whose ending names its kind; 0 for one that is not known here.
    """
    estimate = _ESTIMATES.get(path.suffix.lower())
    return 0.0 if estimate is None else estimate(path)


def refuse_memory(path: Path, needed: float) -> None:
    """Refuse a file that needs so many bytes of memory, if that is more than `MOST_MEMORY`."""
    if needed > MOST_MEMORY:
        raise ConfigurationError(
            f"would take {1e-6 * needed:.0f} MB of memory to read, {1e-6 * MOST_MEMORY:.0f} at "
            "most: thin it out, or cut out what is near the joint",
            file=path,
        )


def read_ply_header(path: Path) -> list[str]:
    """Lines of a PLY file's header."""
    with path.open("rb") as stream:
        ends = iter(lambda: stream.readline(LONGEST_LINE), b"")
        lines = (line.decode("ascii", errors="replace").strip() for line in ends)
        return list(islice(takewhile(lambda line: line != "end_header", lines), MOST_HEADER_LINES))


def _of_stl(path: Path) -> float:
    return max(BINARY_STL * path.stat().st_size, STL_WORD * _words(path))


def _of_obj(path: Path) -> float:
    return max(OBJ_BYTE * path.stat().st_size, OBJ_WORD * _words(path))


def _of_table(path: Path) -> float:
    return TABLE_WORD * _words(path)


def _of_ply(path: Path) -> float:
    lines = [line.split() for line in read_ply_header(path)]
    if ["format", "ascii", "1.0"] in lines:
        return PLY_WORD * _words(path)
    counts = {words[1]: int(words[2]) for words in lines if words[:1] == ["element"]}
    needed = PLY_VERTEX * counts.get("vertex", 0) + PLY_FACE * counts.get("face", 0)
    return float(needed + path.stat().st_size)


def _of_3mf(path: Path) -> float:
    needed = 0
    with zipfile.ZipFile(path) as archive:
        for part in archive.infolist():
            with archive.open(part) as stream:
                for chunk in _chunks(stream):
                    needed += MODEL_ELEMENT * chunk.count(b"<")
                    needed += MODEL_ATTRIBUTE * chunk.count(b"=")
    return float(needed)


def _words(path: Path) -> int:
    with path.open("rb") as stream:
        return sum(len(chunk.translate(SEPARATORS).split()) for chunk in _chunks(stream))


def _chunks(stream: IO[bytes]) -> Iterator[bytes]:
    return iter(lambda: stream.read(CHUNK), b"")


_ESTIMATES: Final[dict[str, Callable[[Path], float]]] = {
    ".stl": _of_stl,
    ".obj": _of_obj,
    ".ply": _of_ply,
    ".3mf": _of_3mf,
    ".xyz": _of_table,
    ".txt": _of_table,
    ".csv": _of_table,
}
