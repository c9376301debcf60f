"""Small files that lie about their size, unpack without bound or name other files."""

from __future__ import annotations

import resource
import struct
import time
import traceback
import zipfile
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Final

import trimesh
from _fuzz import Tally

from tjscan.comparison.shapes import UserUnitAndFrame
from tjscan.core.errors import TjscanError
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.result.shapes import read_shape

READERS: Final[tuple[Callable[..., object], ...]] = (
    lambda file: read_shape(file, UserUnitAndFrame("mm", "j")),
    lambda file: read_profiles(file, ProfileFormat("mm", 0.5)),
)
"""Who reads them: what is no file of theirs is refused."""

PLY: Final = b"property float x\nproperty float y\nproperty float z\n"


def hostile_files() -> Iterator[tuple[str, bytes]]:
    """Names and contents."""
    yield from _meshes()
    yield from _archives()
    yield from _arrays()
    yield from _tables()


def read_hostile_files(folder: Path) -> Tally:
    """Give each of them to each reader."""
    tally = Tally()
    start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name, data in hostile_files():
        file = folder / name
        file.write_bytes(data)
        for read in READERS:
            began = time.process_time()
            try:
                read(file)
                tally.read += 1
            except TjscanError:
                tally.refused += 1
            except Exception:
                tally.wrong.append((data[:100], f"{name}\n{traceback.format_exc()}"))
            tally.slowest = max(tally.slowest, time.process_time() - began)
            tally.inputs += 1
    tally.grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - start)
    return tally


def _meshes() -> Iterator[tuple[str, bytes]]:
    binary, ascii_ = (
        b"ply\nformat %s 1.0\n" % form for form in (b"binary_little_endian", b"ascii")
    )
    many, few = b"element vertex 4000000000\n", b"element vertex 3\n"
    points = b"0 0 1\n1 0 1\n0 0 2\n"
    list_ = b"element face 1\nproperty list uint int vertex_indices\nend_header\n"
    yield "count.ply", binary + many + PLY + b"end_header\n" + bytes(120)
    yield "cut.ply", ascii_ + b"element vertex 1000\n" + PLY + b"end_header\n" + points
    yield "list.ply", binary + few + PLY + list_ + bytes(36) + b"\xff" * 4 + bytes(40)
    texture = b"comment TextureFile /dev/zero\n"
    yield "texture.ply", ascii_ + texture + few + PLY + b"end_header\n" + points
    yield "count.stl", bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50)
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    yield "materials.obj", b"mtllib /dev/zero\n" + corners + b"usemtl a\nf 1 2 3\n"
    yield "index.obj", corners + b"f 1 2 2000000000\n"
    yield "face.obj", corners + b"f " + b"1 " * 300_000 + b"\n"
    pcd = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 400000000\n"
        "HEIGHT 1\nPOINTS 400000000\nDATA %s\n"
    )
    for kind in ("binary", "binary_compressed", "ascii"):
        sizes = struct.pack("<II", 20, 4_800_000_000 % 2**32)
        yield f"{kind}.pcd", (pcd % kind).encode() + sizes + bytes(20)


def _archives() -> Iterator[tuple[str, bytes]]:
    entities = b"".join(
        b'<!ENTITY %c "%s">' % (98 + i, 10 * (b"&%c;" % (97 + i))) for i in range(9)
    )
    end = b"</model>"
    for name, old, new, other in (
        ("spaces", end, end + b" " * 30_000_000, b""),
        ("deep", end, b"<a>" * 100_000 + b"</a>" * 100_000 + end, b""),
        ("entities", end, b'<metadata name="x">&j;</metadata>' + end, b'"ha">' + entities),
        ("file", end, b'<metadata name="x">&a;</metadata>' + end, b'SYSTEM "file:///dev/zero">'),
    ):
        yield f"{name}.3mf", _packed(old, new, other)


def _packed(old: bytes, new: bytes, entity: bytes) -> bytes:
    """A box as 3MF, its model changed."""
    whole, changed = BytesIO(), BytesIO()
    trimesh.creation.box((10.0, 20.0, 30.0)).export(whole, file_type="3mf")
    with (
        zipfile.ZipFile(whole) as archive,
        zipfile.ZipFile(changed, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as to,
    ):
        for name in archive.namelist():
            data = archive.read(name)
            if name.endswith(".model"):
                data = data.replace(old, new)
                if entity:
                    head = b"?><!DOCTYPE model [<!ENTITY a " + entity + b"]>"
                    data = data.replace(b"?>", head, 1)
            to.writestr(name, data)
    return changed.getvalue()


def _arrays() -> Iterator[tuple[str, bytes]]:
    for i, (kind, shape) in enumerate(
        (
            *(("<f8", "(1000000000000,)"), ("<f8", f"({2**62}, {2**62})"), ("<f8", "(-1,)")),
            *(("|O", "(3,)"), ("|V0", "(1000000000,)"), ("|S0", "(1,)"), ("<f8", "(" * 3000)),
        )
    ):
        head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
        start = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head))
        yield f"{i}.npy", start + head + b"cos\nsystem\n."
    yield "head.npy", b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**32 - 1) + b"{" * 9000
    yield "archive.npy", b"PK\x03\x04" + bytes(60)
    yield "pickle.npy", b"\x80\x04\x95."


def _tables() -> Iterator[tuple[str, bytes]]:
    yield "field.csv", b"x_mm,y_mm,z_mm\n1,2," + b"3" * 200_000 + b"\n"
    yield "edges.csv", b"edge,azimuth_deg,x_mm,y_mm,z_mm\n" + b"p" * 300_000 + b",1,2,3,4\n"
    yield "commas.csv", b"," * 1_200_000
    yield "line.xyz", b"1 " * 1_500_000
    yield "lines.xyz", b"\n" * 1_000_000
