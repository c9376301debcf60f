"""Points and triangles from mesh files, no further than the file itself goes."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.mesh_memory import check_memory_to_read, read_ply_header

MOST_UNPACKED_BYTES: Final = 500_000_000
"""What an archive may hold."""

MOST_UNPACKED_SHARE: Final = 30
"""Times its own size that an archive may unpack to: text of numbers shrinks to a fifth."""

ROOM_FOR_HEADERS: Final = 1_000_000
"""Bytes that a small archive may unpack to in any case."""


def read_mesh_file(path: Path) -> tuple[Array, np.ndarray[Any, np.dtype[np.intp]]]:
    """Vertices and triangles of a PLY, STL, OBJ, 3MF or STEP file.

    Materials and textures that it names are not opened. What its header says of its size must
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
        _check_archive(path)
    check_memory_to_read(path)
    nothing = trimesh.resolvers.ZipResolver({})
    loaded = trimesh.load(path, process=False, resolver=nothing)
    if isinstance(loaded, trimesh.Scene):
        loaded = loaded.to_mesh()
    points = np.asarray(loaded.vertices, dtype=float).reshape(-1, 3)
    faces = getattr(loaded, "faces", np.empty((0, 3)))
    if kind == ".ply":
        _check_vertices(path, len(points))
    return points, np.asarray(faces, dtype=np.intp).reshape(-1, 3)


def _check_vertices(path: Path, count: int) -> None:
    lines = [line.split() for line in read_ply_header(path)]
    stated = [words[2] for words in lines if words[:2] == ["element", "vertex"] and words[2:]]
    if stated != [str(count)]:
        raise ConfigurationError(
            f"is cut off: it holds {count} vertices, its header says {', '.join(stated)}",
            file=path,
        )


def _check_archive(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        size = sum(part.file_size for part in archive.infolist())
    most = min(MOST_UNPACKED_BYTES, MOST_UNPACKED_SHARE * path.stat().st_size + ROOM_FOR_HEADERS)
    if size > most:
        raise ConfigurationError(f"unpacks to {size} bytes, {most} at most", file=path)
