"""Points and triangles from mesh files, no further than the file itself goes.

A parser takes the more memory the more elements a file has, not the more bytes: of a text of short
numbers eighty times its size. So what reading takes is estimated before it begins. The rates were
measured with the densest files of each kind that are legal. They hold for reading and checking a
file, not for what is made of it.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from itertools import islice, takewhile
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array

MOST_MEMORY: Final = 500_000_000
"""Bytes that reading a file may take."""

MOST_HEADER_LINES: Final = 1000
"""Of a PLY."""

LONGEST_HEADER_LINE: Final = 10_000
"""Bytes of a line in such a header."""

READ_CHUNK_BYTES: Final = 1 << 16
"""Bytes that are counted at once."""

TEXT_MEMORY_RATES: Final = {
    ".stl": (6.6, 80),  # the rate of a binary STL
    ".obj": (8, 65),
    ".ply": (0, 152),
    ".xyz": (0, 36),
    ".txt": (0, 36),
    ".csv": (0, 36),
}
"""Bytes of memory for each byte and for each word of a text; the larger product counts."""

PLY_VERTEX_MEMORY: Final = 120
PLY_FACE_MEMORY: Final = 180
"""Bytes for each element of a binary PLY, beside the file's own."""

ELEMENT_MEMORY_OF_3MF: Final = 135
ATTRIBUTE_MEMORY_OF_3MF: Final = 300
"""Bytes for each element of a 3MF's model, and for each of its attributes."""

WORD_SEPARATORS: Final = bytes.maketrans(b",;/", b"   ")
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
    refuse_large_memory(path, memory_to_read(path))


def memory_to_read(path: Path) -> float:
    """Bytes of memory that reading a mesh or a table of points takes at most.

    Parameters
    ----------
    path : Path
        The file, whose ending names its kind; 0 for one that is not known here.
    """
    kind = path.suffix.lower()
    if kind == ".3mf":
        return _memory_of_3mf(path)
    if kind == ".ply" and (needed := _memory_of_binary_ply(path)) is not None:
        return needed
    by_byte, by_word = TEXT_MEMORY_RATES.get(kind, (0, 0))
    return max(by_byte * path.stat().st_size, by_word * _count_words(path)) if by_word else 0.0


def refuse_large_memory(path: Path, needed: float) -> None:
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
        ends = iter(lambda: stream.readline(LONGEST_HEADER_LINE), b"")
        lines = (line.decode("ascii", errors="replace").strip() for line in ends)
        return list(islice(takewhile(lambda line: line != "end_header", lines), MOST_HEADER_LINES))


def _memory_of_binary_ply(path: Path) -> float | None:
    """Bytes of memory that a binary PLY takes; None for a text."""
    lines = [line.split() for line in read_ply_header(path)]
    if ["format", "ascii", "1.0"] in lines:
        return None
    counts = {words[1]: int(words[2]) for words in lines if words[:1] == ["element"]}
    needed = PLY_VERTEX_MEMORY * counts.get("vertex", 0) + PLY_FACE_MEMORY * counts.get("face", 0)
    return float(needed + path.stat().st_size)


def _memory_of_3mf(path: Path) -> float:
    needed = 0
    with zipfile.ZipFile(path) as archive:
        for part in archive.infolist():
            with archive.open(part) as stream:
                for chunk in _file_chunks(stream):
                    needed += ELEMENT_MEMORY_OF_3MF * chunk.count(b"<")
                    needed += ATTRIBUTE_MEMORY_OF_3MF * chunk.count(b"=")
    return float(needed)


def _count_words(path: Path) -> int:
    with path.open("rb") as stream:
        return sum(len(chunk.translate(WORD_SEPARATORS).split()) for chunk in _file_chunks(stream))


def _file_chunks(stream: IO[bytes]) -> Iterator[bytes]:
    return iter(lambda: stream.read(READ_CHUNK_BYTES), b"")


MOST_UNPACKED_BYTES: Final = 500_000_000
"""What an archive may hold."""

MOST_UNPACKED_RATIO: Final = 30
"""Times its own size that an archive may unpack to: text of numbers shrinks to a fifth."""

SMALL_ARCHIVE_BYTES: Final = 1_000_000
"""Bytes that a small archive may unpack to in any case."""


def read_mesh_file(path: Path) -> tuple[Array, np.ndarray[Any, np.dtype[np.intp]]]:
    """Vertices and triangles of a PLY, STL, OBJ, 3MF or STEP file.

    Materials and textures that it names are not opened. What its header states of its size must
    be what it holds.

    Parameters
    ----------
    path : Path
        The file, whose ending names its kind.

    Returns
    -------
    points : ndarray, shape (n, 3)
        In the file's unit.
    triangles : ndarray, shape (m, 3)
        Indices of their corners; none for a cloud.

    Raises
    ------
    ConfigurationError
        If it is cut off, unpacks to far more than it is, or takes too much memory to read.
    Exception
        Whatever `trimesh` stumbles over.
    """
    import trimesh

    kind = path.suffix.lower()
    if kind == ".3mf":
        _check_unpacked_size(path)
    check_memory_to_read(path)
    nothing = trimesh.resolvers.ZipResolver({})
    loaded = trimesh.load(path, process=False, resolver=nothing)
    if isinstance(loaded, trimesh.Scene):
        loaded = loaded.to_mesh()
    points = np.asarray(loaded.vertices, dtype=float).reshape(-1, 3)
    faces = getattr(loaded, "faces", np.empty((0, 3)))
    if kind == ".ply":
        _check_vertex_count(path, len(points))
    return points, np.asarray(faces, dtype=np.intp).reshape(-1, 3)


def _check_vertex_count(path: Path, count: int) -> None:
    lines = [line.split() for line in read_ply_header(path)]
    stated = [words[2] for words in lines if words[:2] == ["element", "vertex"] and words[2:]]
    if stated != [str(count)]:
        raise ConfigurationError(
            f"is cut off: it holds {count} vertices, its header states {', '.join(stated)}",
            file=path,
        )


def _check_unpacked_size(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        size = sum(part.file_size for part in archive.infolist())
    most = min(MOST_UNPACKED_BYTES, MOST_UNPACKED_RATIO * path.stat().st_size + SMALL_ARCHIVE_BYTES)
    if size > most:
        raise ConfigurationError(f"unpacks to {size} bytes, {most} at most", file=path)
