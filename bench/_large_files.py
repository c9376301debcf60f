"""The largest files of shapes that are read, dense with short numbers, and the memory they take."""

from __future__ import annotations

import resource
import time
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Final

import trimesh

from tjscan.comparison.shapes import UserUnitAndFrame
from tjscan.core.mesh_files import MOST_MEMORY, memory_to_read
from tjscan.result.shapes import read_shape

FULL: Final = 0.95
"""Share of the memory allowed that a file is expected to take."""
FEW: Final = 10_000
"""Elements of a file from whose need that of a large one follows."""

Write = Callable[[Path, int], object]
"""Writes a file with so many elements."""


def _text(head: str, line: str, end: str = "") -> Write:
    return lambda file, count: file.write_text(head.format(count=count) + line * count + end)


def _binary(head: str, element: bytes) -> Write:
    def write(file: Path, count: int) -> None:
        file.write_bytes(head.format(count=count).encode() + element * count)

    return write


def _stl(file: Path, count: int) -> None:
    file.write_bytes(bytes(80) + count.to_bytes(4, "little") + bytes(50) * count)


def _3mf(file: Path, count: int) -> None:
    box = BytesIO()
    trimesh.creation.box((1.0, 2.0, 3.0)).export(box, file_type="3mf")
    with zipfile.ZipFile(box) as small, zipfile.ZipFile(file, "w") as archive:
        for name in small.namelist():
            data, one = small.read(name), b'<triangle v1="0" v2="1" v3="2"/>'
            archive.writestr(name, data.replace(b"</triangles>", one * count + b"</triangles>"))


PLY: Final = (
    "ply\nformat FORM 1.0\nelement vertex {count}\n"
    + "".join(f"property uchar {axis}\n" for axis in "xyz")
    + "end_header\n"
)
CORNERS: Final = "v 1 2 3\nv 1 3 3\nv 2 2 3\nv 2 2 4\n"
TRIANGLE: Final = "facet normal 0 0 1\nouter loop\n" + "vertex 1 2 3\n" * 3 + "endloop\nendfacet\n"

LARGE: Final[dict[str, Write]] = {
    "points.ply": _binary(PLY.replace("FORM", "binary_little_endian"), b"\1\2\3"),
    "text.ply": _text(PLY.replace("FORM", "ascii"), "1 2 3\n"),
    "binary.stl": _stl,
    "text.stl": _text("solid a\n", TRIANGLE, "endsolid a\n"),
    "points.obj": _text("", "v 1 2 3\n", "f 1 2 3\n"),
    "triangles.obj": _text(CORNERS, "f 1 2 3\n"),
    "quads.obj": _text(CORNERS, "f 1 2 3 4\n"),
    "model.3mf": _3mf,
    "points.xyz": _text("", "1 2 3\n"),
    "points.csv": _text("x,y,z\n", "1,2,3\n"),
}


def read_large_file(folder: Path, name: str) -> tuple[float, float]:
    """Megabytes of memory, and seconds, that the largest file of a kind takes to read.

    Parameters
    ----------
    folder : Path
        To write it into; removed afterwards.
    name : str
        One of `LARGE`. A process of its own reads it, or what was read before counts.
    """
    file, write = folder / name, LARGE[name]
    write(file, FEW)
    stated = UserUnitAndFrame("mm", "j")
    read_shape(file, stated)  # what it loads counts for none
    write(file, int(FULL * FEW * MOST_MEMORY / memory_to_read(file)))
    before, began = _peak(), time.process_time()
    read_shape(file, stated)
    taken = _peak() - before, time.process_time() - began
    file.unlink()
    return taken


def _peak() -> float:
    return 1024e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
