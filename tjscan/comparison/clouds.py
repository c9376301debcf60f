"""Clouds, meshes and edges from files, as shapes in metres.

Of the Point Cloud Library's PCD format only compressed clouds are left to Open3D, once their header
has been checked: its readers take the whole process down if a header is damaged, and the one
without tensors reads binary float64 as something else.
"""

from __future__ import annotations

import csv
import re
import zipfile
from collections.abc import Callable
from importlib import import_module
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from tjscan.comparison import shapes
from tjscan.core import mesh_files
from tjscan.core.errors import ConfigurationError, explain_missing_package, nearest_word
from tjscan.core.files import check_file_size
from tjscan.core.frames import Array, readonly_copy
from tjscan.core.mesh_files import MOST_MEMORY
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import ClosedPolyline, FeatureEdges, feature_edges
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh
from tjscan.laser.files.format import METRES_PER_UNIT

NUMPY_TYPES: Final = {
    **{f"F{size}": f"<f{size}" for size in (4, 8)},
    **{f"{kind}{size}": f"<{kind.lower()}{size}" for kind in "IU" for size in (1, 2, 4, 8)},
}
"""NumPy's name of each TYPE and SIZE."""

MOST_HEADER_LINES: Final = 100
"""Lines."""

MEMORY_PER_PCD_POINT: Final = 110
MEMORY_PER_COMPRESSED_PCD_POINT: Final = 260
"""Bytes of memory that reading a point takes, beside its own; as measured."""


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
        layout, count, encoding = _read_pcd_header(stream)
        rest = path.stat().st_size - stream.tell()
        is_compressed = encoding == "binary_compressed"
        rate = MEMORY_PER_COMPRESSED_PCD_POINT if is_compressed else MEMORY_PER_PCD_POINT
        mesh_files.refuse_large_memory(path, count * (rate + layout.itemsize))
        if encoding == "ascii":
            lines = (line.decode("ascii") for line in stream)
            widths = [prod(layout[name].shape) for name in layout.names or ()]
            columns = [sum(widths[: (layout.names or ()).index(axis)]) for axis in "xyz"]
            return np.loadtxt(lines, usecols=columns, ndmin=2, max_rows=count)
        if encoding == "binary":
            if count * layout.itemsize > rest:
                raise ValueError(f"it ends before its {count} points do")
            data = stream.read(count * layout.itemsize)
            table = np.frombuffer(data, layout)
            return np.column_stack([table[axis].astype(float) for axis in "xyz"])
        compressed, whole = np.frombuffer(stream.read(8), "<u4").tolist()
        if compressed > rest - 8 or whole != count * layout.itemsize:
            raise ValueError("its sizes contradict each other")
    return _read_compressed(path)


def _read_pcd_header(stream: BinaryIO) -> tuple[np.dtype[Any], int, str]:
    """What a header states: the layout of a point, how many there are, and how they are written."""
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
    return layout, points, data


def _read_compressed(path: Path) -> Array:
    o3d: Any = import_module("open3d")
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        cloud = o3d.t.io.read_point_cloud(str(path), remove_nan_points=False)
    if "positions" not in cloud.point:
        raise ValueError("it holds no points")
    return np.asarray(cloud.point["positions"].numpy(), dtype=float)


MEMORY_PER_E57_POINT: Final = 120
"""Bytes of memory that reading a point of an E57 takes."""

FileContent = tuple[Array, "np.ndarray[Any, np.dtype[np.intp]] | None", tuple[str, str] | None]
"""Points, triangles or None, and the unit that the file states and the place where it does."""


def read_shape_file(path: Path, options: shapes.UserUnitAndFrame | None = None) -> shapes.Shape:
    """Read a shape from a joint's TOML, a mesh, a cloud or ``edges.csv``.

    Parameters
    ----------
    path : Path
        PLY, PCD, XYZ, CSV, STL, OBJ, 3MF; STEP and E57 where their extras are installed.
    options : UserUnitAndFrame, optional
        Unit and frame of a file that does not state them.

    Raises
    ------
    ConfigurationError
        If it is missing, damaged or empty, takes more memory to read than `MOST_MEMORY`, or
        nothing states its unit or its frame.
    """
    options = options or shapes.UserUnitAndFrame()
    kind = path.suffix.lower()
    if kind == ".toml":
        return _joint_shape(read_joint(path), shapes.UnitAndFrame("mm", "the joint's file", "j"))
    if not path.exists():
        near = nearest_word(path.name, [f.name for f in path.parent.glob("*")][:1000])
        raise ConfigurationError(f"there is no such file; near it: {near}", file=path)
    check_file_size(path, MOST_MEMORY, "points and triangles")
    if kind == ".json":
        if (joint := shapes.read_sidecar(path).joint) is None:
            raise ConfigurationError("describes no joint: name the file it belongs to", file=path)
        return _joint_shape(joint, shapes.UnitAndFrame("mm", "the joint's sidecar", "j"))
    if kind not in READERS_BY_SUFFIX:
        known = " ".join(sorted(READERS_BY_SUFFIX))
        message = f"can't read {kind or 'a file without ending'}; {known}"
        raise ConfigurationError(message, file=path)
    if kind == ".csv" and (edges := _read_edges(path)) is not None:
        stated = shapes.UnitAndFrame("mm", "the names of its columns", "j")
        return shapes.Shape(path.name, stated, edges=edges, is_in_joint_frame=True)
    try:
        points, triangles, own = READERS_BY_SUFFIX[kind](path)
        points = points.reshape(-1, 3)
    except ConfigurationError:
        raise
    except Exception as error:  # parsers raise whatever they stumble on
        reason = f"{type(error).__name__}: {error}".strip(": ")
        raise ConfigurationError(f"is damaged, or is no {kind[1:]}: {reason}", file=path) from None
    sidecar = shapes.find_sidecar(path)
    stated = shapes.resolve_unit_and_frame(path, options, sidecar, own)
    scaled = METRES_PER_UNIT[stated.unit] * points
    if triangles is not None:
        _check_triangles(path, scaled, triangles)
        # The edges of a joint are in frame j, whatever the sidecar states of the mesh.
        joint = sidecar.joint if sidecar is not None and stated.frame == "j" else None
        edges = None if joint is None else feature_edges(joint)
        mesh = shapes.Mesh(readonly_copy(scaled), triangles)
        return shapes.Shape(
            path.name, stated, mesh=mesh, edges=edges, is_in_joint_frame=edges is not None
        )
    finite = np.isfinite(scaled).all(axis=1)
    if not finite.any():
        raise ConfigurationError("holds no point", file=path)
    dropped = int((~finite).sum())
    return shapes.Shape(path.name, stated, readonly_copy(scaled[finite]), dropped=dropped)


def _joint_shape(joint: JointDefinition, stated: shapes.UnitAndFrame) -> shapes.Shape:
    built = build_joint_mesh(joint)
    mesh = shapes.Mesh(built.vertices, built.triangles.astype(np.intp))
    return shapes.Shape(
        joint.name, stated, mesh=mesh, edges=feature_edges(joint), is_in_joint_frame=True
    )


def _read_edges(path: Path) -> FeatureEdges | None:
    """``edges.csv`` of a joint; None if the file is another table."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        if stream.readline(1000).strip() != "edge,azimuth_deg,x_mm,y_mm,z_mm":
            return None
        lines: dict[str, list[list[float]]] = {"p2": [], "p3": [], "p4": []}
        try:
            for name, *values in csv.reader(stream):
                lines[name].append([float(value) for value in values])
            azimuth, *_ = (np.radians(np.array(line)[:, 0]) for line in lines.values())
            p2, p3, p4 = (ClosedPolyline(1e-3 * np.array(line)[:, 1:]) for line in lines.values())
        except (ValueError, KeyError, IndexError, csv.Error) as error:
            raise ConfigurationError(f"is damaged: {error!r}", file=path) from None
    return FeatureEdges(azimuth, p2, p3, p4)


def _read_mesh(path: Path) -> FileContent:
    points, triangles = mesh_files.read_mesh_file(path)
    return points, triangles if len(triangles) else None, None


def _read_ply(path: Path) -> FileContent:
    """PLY states its unit if this program wrote it, in a comment."""
    points, triangles, _ = _read_mesh(path)
    for line in mesh_files.read_ply_header(path):
        if line.startswith("comment units: "):
            unit = line.removeprefix("comment units: ").split(",")[0].strip()
            if unit in METRES_PER_UNIT:
                return points, triangles, (unit, "its header")
    return points, triangles, None


def _read_3mf(path: Path) -> FileContent:
    """3MF states its unit in the model, millimetre if it states none."""
    with zipfile.ZipFile(path) as archive:
        model = next(name for name in archive.namelist() if name.lower().endswith(".model"))
        with archive.open(model) as stream:
            head = stream.read(10_000).decode("utf-8", errors="replace")
    match = re.search(r"<model\b[^>]*\bunit=[\"'](\w+)[\"']", head)
    word = match[1] if match else "millimeter"
    unit = {"millimeter": "mm", "micron": "um", "meter": "m"}.get(word)
    if unit is None:
        raise ConfigurationError(f"is in {word}; write it in millimetres", file=path, key="unit")
    points, triangles, _ = _read_mesh(path)
    return points, triangles, (unit, "the model in it")


def _read_step(path: Path) -> FileContent:
    """STEP states its unit; it is triangulated to metres on the way in."""
    with explain_missing_package("reading STEP", "step"):
        import_module("cascadio")
    points, triangles, _ = _read_mesh(path)
    return points, triangles, ("m", "its conversion to triangles")


def _read_e57(path: Path) -> FileContent:
    """E57 is in metres by its standard (ASTM E2807); all scans, each in its pose."""
    with explain_missing_package("reading E57", "e57"):
        file = import_module("pye57").E57(str(path))
    points_of_all = sum(file.get_header(i).point_count for i in range(file.scan_count))
    mesh_files.refuse_large_memory(path, MEMORY_PER_E57_POINT * points_of_all)
    scans = [file.read_scan(i, ignore_missing_fields=True) for i in range(file.scan_count)]
    points = [np.column_stack([s[f"cartesian{axis}"] for axis in "XYZ"]) for s in scans]
    return np.concatenate(points), None, ("m", "its standard")


_DECIMAL_COMMAS: Final = re.compile(r"\s*(?:[+-]?\d+,\d+(?:[eE][+-]?\d+)?\s+){3}")
"""Three numbers between blanks; between commas alone these would be six."""


def _read_xyz(path: Path) -> FileContent:
    """Three numbers per line, and more that don't matter; separated by spaces, commas or both.

    Between semicolons, and in numbers that blanks separate, a comma is the decimal one.
    """
    mesh_files.check_memory_to_read(path)
    with path.open(encoding="utf-8") as stream:
        lines = (
            line.replace(",", "." if ";" in line or _DECIMAL_COMMAS.match(line) else " ")
            for line in stream
        )
        lines = (line.replace(";", " ") for line in lines)
        return np.loadtxt(lines, usecols=(0, 1, 2), ndmin=2, comments=("#", "//")), None, None


def _read_csv(path: Path) -> FileContent:
    """Columns x, y, z, with a unit in their names or without."""
    mesh_files.check_memory_to_read(path)
    with path.open(newline="", encoding="utf-8-sig") as stream:
        lines = iter(lambda: stream.readline(mesh_files.LONGEST_HEADER_LINE + 1), "")
        head = next((line for line in lines if not line.startswith("#")), "")
        if len(head) > mesh_files.LONGEST_HEADER_LINE:
            raise ConfigurationError("its first line is far too long for a header", file=path)
        mark = ";" if ";" in head else ","
        names = [name.strip().lower() for name in next(csv.reader([head], delimiter=mark), [])]
        unit_words = "|".join(METRES_PER_UNIT)
        places, units = [], set()
        for axis in "xyz":
            form = rf"{axis}(?:_[bfstgj])?(?:[_ ]*[\[(]?({unit_words})[\])]?)?"
            found = [(i, match[1]) for i, n in enumerate(names) if (match := re.fullmatch(form, n))]
            if not found:
                message = f"has no column {axis} (found: {', '.join(names[:12])})"
                raise ConfigurationError(message, file=path, key=axis)
            places.append(found[0][0])
            units.add(found[0][1])
        if len(units) > 1:
            raise ConfigurationError("its columns are in different units", file=path)
        rows = stream if mark == "," else (line.replace(",", ".") for line in stream)
        values = np.loadtxt(rows, delimiter=mark, usecols=places, ndmin=2)
    unit = units.pop()
    return values, None, None if unit is None else (unit, "the names of its columns")


def _check_triangles(path: Path, points: Array, triangles: Array | Any) -> None:
    if not np.isfinite(points).all():
        raise ConfigurationError("holds vertices that are no finite points", file=path)
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise ConfigurationError("has triangles without vertices", file=path)


READERS_BY_SUFFIX: Final[dict[str, Callable[[Path], FileContent]]] = {
    ".ply": _read_ply,
    ".stl": _read_mesh,
    ".obj": _read_mesh,
    ".3mf": _read_3mf,
    ".step": _read_step,
    ".stp": _read_step,
    ".e57": _read_e57,
    ".pcd": lambda path: (read_pcd(path), None, None),
    ".xyz": _read_xyz,
    ".txt": _read_xyz,
    ".csv": _read_csv,
}
"""What reads which ending."""
