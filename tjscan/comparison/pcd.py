"""Clouds in the PCD format of the Point Cloud Library.

Only compressed clouds are left to Open3D, once their header has been checked: its readers take the
whole process down if a header is damaged, and the one without tensors reads binary float64 as
something else.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from tjscan.core.frames import Array
from tjscan.core.mesh_files import refuse_memory

NUMPY_TYPES: Final = {
    **{f"F{size}": f"<f{size}" for size in (4, 8)},
    **{f"{kind}{size}": f"<{kind.lower()}{size}" for kind in "IU" for size in (1, 2, 4, 8)},
}
"""NumPy's name of each TYPE and SIZE."""

MOST_HEADER_LINES: Final = 100
"""Lines."""

BYTES_PER_POINT: Final = 110
BYTES_PER_COMPRESSED_POINT: Final = 260
"""Bytes of memory that reading a point takes, beside its own; as measured."""


@dataclass(frozen=True, slots=True)
class _Head:
    """What a header states: the layout of a point, how many there are, and how they are written."""

    layout: np.dtype[Any]
    points: int
    data: str


def read_pcd(path: Path) -> Array:
    """Read the points of a PCD file, shape (n, 3), in the file's unit.

    The header is checked against the size of the file before it is used.

    Raises
    ------
    ConfigurationError
        If it takes too much memory to read.
    ValueError
        If it is damaged, or of another kind.
    """
    with path.open("rb") as stream:
        head = _read_head(stream)
        rest = path.stat().st_size - stream.tell()
        rate = BYTES_PER_COMPRESSED_POINT if head.data == "binary_compressed" else BYTES_PER_POINT
        refuse_memory(path, head.points * (rate + head.layout.itemsize))
        if head.data == "ascii":
            lines = (line.decode("ascii") for line in stream)
            columns = [_first_column(head.layout, axis) for axis in "xyz"]
            return np.loadtxt(lines, usecols=columns, ndmin=2, max_rows=head.points)
        if head.data == "binary":
            if head.points * head.layout.itemsize > rest:
                raise ValueError(f"it ends before its {head.points} points do")
            data = stream.read(head.points * head.layout.itemsize)
            table = np.frombuffer(data, head.layout)
            return np.column_stack([table[axis].astype(float) for axis in "xyz"])
        compressed, whole = np.frombuffer(stream.read(8), "<u4").tolist()
        if compressed > rest - 8 or whole != head.points * head.layout.itemsize:
            raise ValueError("its sizes contradict each other")
    return _read_compressed(path)


def _read_head(stream: BinaryIO) -> _Head:
    words: dict[str, list[str]] = {}
    for _ in range(MOST_HEADER_LINES):
        line = stream.readline(10_000).decode("ascii").split()
        if line and not line[0].startswith("#"):
            words[line[0].upper()] = line[1:]
            if line[0].upper() == "DATA":
                break
    try:
        names, kinds, sizes = words["FIELDS"], words["TYPE"], words["SIZE"]
        counts = [int(word) for word in words.get("COUNT", ["1"] * len(names))]
        (points,), (data,) = (int(w) for w in words["POINTS"]), words["DATA"]
        grid = prod(int(words[key][0]) for key in ("WIDTH", "HEIGHT"))
        unique = [name if name in "xyz" else f"{name} {i}" for i, name in enumerate(names)]
        types = [NUMPY_TYPES[kind + size] for kind, size in zip(kinds, sizes, strict=True)]
        columns = zip(unique, types, counts, strict=True)
        layout = np.dtype([(n, t) if count == 1 else (n, t, (count,)) for n, t, count in columns])
    except (KeyError, IndexError) as error:
        raise ValueError(f"its header lacks {error}, or has it wrong") from None
    if points != grid or points < 1 or data not in ("ascii", "binary", "binary_compressed"):
        raise ValueError("its header contradicts itself")
    if any(axis not in names or layout[axis].shape for axis in "xyz"):
        raise ValueError("it holds no points x, y, z")
    return _Head(layout, points, data)


def _first_column(layout: np.dtype[Any], axis: str) -> int:
    """Column of a field in a text, if a field of many numbers takes as many."""
    names = list(layout.names or ())
    return sum(prod(layout[name].shape) for name in names[: names.index(axis)])


def _read_compressed(path: Path) -> Array:
    o3d: Any = import_module("open3d")
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        cloud = o3d.t.io.read_point_cloud(str(path), remove_nan_points=False)
    if "positions" not in cloud.point:
        raise ValueError("it holds no points")
    return np.asarray(cloud.point["positions"].numpy(), dtype=float)
