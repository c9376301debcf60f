"""Sections in files: ``sections.csv``, and the points of clouds and sections as PLY."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from tjscan.core.errors import ConfigurationError
from tjscan.core.files import check_file_size
from tjscan.core.frames import Array, array_dataclass
from tjscan.core.manifest import check_files_unaltered
from tjscan.core.provenance import LengthUnit, Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result.section import (
    FIELD_BY_NAME,
    SECTION_FIELDS,
    UNDERIVED_SECTION_FIELDS,
    SectionQuantity,
    section_from_values,
)

COMMENT_MARK: Final = "#"
"""What the lines above the table begin with."""

SECTIONS_CSV_FIELDS: Final = tuple(
    field for field in SECTION_FIELDS if field in UNDERIVED_SECTION_FIELDS or field.name == "s"
)
"""Fields of ``sections.csv``."""

SECTIONS_CSV_COLUMNS: Final = tuple(
    column for field in SECTIONS_CSV_FIELDS for column in field.column_names()
)
"""Columns of ``sections.csv``."""

REQUIRED_COLUMNS: Final = tuple(
    column for f in SECTIONS_CSV_FIELDS if not f.later for column in f.column_names()
)
"""Those without which a file holds no sections."""

MOST_TABLE_BYTES: Final = 50_000_000
"""A larger file holds no sections: each takes a kilobyte."""

VARIANCE_INDICES: Final = (0, 3, 5)
"""Where xx, yy and zz are among the six numbers of a covariance."""

AXES_TOLERANCE: Final = 1e-6
"""How far axes printed with seven decimals may be from orthonormal."""


def sections_to_csv(
    sections: Sequence[MeasuredSection],
    unit: LengthUnit,
    fields: Iterable[SectionQuantity] = SECTION_FIELDS,
) -> str:
    """Convert sections to CSV text, a row per section; units are in the names of the columns.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In their order along the groove.
    unit : str
        Of lengths: mm or m.
    fields : iterable of SectionQuantity
        What to write of each section.
    """
    fields = tuple(fields)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([column for field in fields for column in field.column_names(unit)])
    parts = [field.formatted_columns(sections, unit) for field in fields]
    writer.writerows([cell for part in row for cell in part] for row in zip(*parts, strict=True))
    return stream.getvalue()


def write_sections_csv(
    file: Path, sections: Sequence[MeasuredSection], provenance: Provenance
) -> None:
    """Write ``sections.csv``."""
    text = sections_to_csv(sections, provenance.length, SECTIONS_CSV_FIELDS)
    provenance.write_table(file, text)


def write_smoothed_csv(
    file: Path, sections: Sequence[MeasuredSection], corners: Array, provenance: Provenance
) -> None:
    """Write ``smoothed.csv``: corners smoothed along the groove, beside those that were read.

    Parameters
    ----------
    file : Path
        The file.
    sections : sequence of MeasuredSection
        Whose corners they are.
    corners : ndarray, shape (n, 3, 3)
        p2, p3 and p4, metres; not a number where a corner is not seen.
    provenance : Provenance
        Is beside the table.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    axes = [f"{corner}_{axis}_mm" for corner in ("p2", "p3", "p4") for axis in "xyz"]
    writer.writerow(["section", *axes])
    for section, row in zip(sections, 1e3 * corners.reshape(-1, 9), strict=True):
        cells = ("" if np.isnan(value) else f"{value:.4f}" for value in row)
        writer.writerow([section.index, *cells])
    provenance.write_table(file, stream.getvalue())


def read_sections_csv(file: Path) -> tuple[MeasuredSection, ...]:
    """Read ``sections.csv``: what was written, to the digits that were printed.

    Columns may be in another order, and others beside them. Lines that begin with ``#`` above
    the table are passed over.

    Raises
    ------
    ConfigurationError
        If it is missing, lacks a column or holds what is no section; with line and column.
    RecordingError
        If it is not as it was written.
    """
    try:
        check_file_size(file, MOST_TABLE_BYTES, "sections")
        check_files_unaltered(file)
        with file.open(newline="", encoding="utf-8-sig") as stream:
            above = 0
            while (line := stream.readline()).startswith(COMMENT_MARK):
                above += 1
            reader = csv.reader(itertools.chain((line,), stream), strict=True)
            head = next(reader, [])
            _check_column_names(file, above + 1, head)
            return tuple(
                _section_of_row(_SectionRow(file, above + reader.line_num, head, cells))
                for cells in reader
                if cells
            )
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"is not UTF-8 text ({error})", file=file) from None
    except csv.Error as error:
        raise ConfigurationError(f"is no table: {error}", file=file) from None


class _SectionRow:
    """A line of the file, whose cells are read by the names of their columns."""

    def __init__(self, file: Path, line: int, head: Sequence[str], cells: Sequence[str]) -> None:
        self._file, self._line = file, line
        if len(cells) != len(head):
            raise self.row_error(
                f"{len(cells)} cells are under {len(head)} columns: it was cut off?"
            )
        self._cells = {name: cell.strip() for name, cell in zip(head, cells, strict=True)}

    def row_error(self, message: str, column: str | None = None) -> ConfigurationError:
        """An error that states its line and column."""
        place = f"line {self._line}" + ("" if column is None else f", column {column}")
        return ConfigurationError(message, file=self._file, key=place)

    def field_value(self, field: SectionQuantity) -> Array | str:
        """A field's text, or numbers in SI units and of its shape; NaN if they are left empty."""
        columns = field.column_names()
        if field.blank and not self._cells.get(columns[0]):
            return "" if field.text else np.array(np.nan)
        if field.text:
            return self._filled_cell(columns[0])
        numbers = [self._bounded_number(column, field) for column in columns]
        return np.reshape(numbers, field.shape) * field.unit.factor

    def _filled_cell(self, column: str) -> str:
        if not (text := self._cells.get(column, "")):
            raise self.row_error("is empty", column)
        return text

    def _bounded_number(self, column: str, field: SectionQuantity) -> float:
        """A cell's number, within the bounds of its field."""
        text = self._filled_cell(column)
        try:
            value = float(text)
        except ValueError:
            raise self.row_error(f"{text!r} is no number", column) from None
        if not np.isfinite(value) or not field.bounds[0] <= value <= field.bounds[1]:
            raise self.row_error(f"{text} can't be", column)
        return value


def _check_column_names(file: Path, line: int, head: Sequence[str]) -> None:
    """Refuse a head that does not name every column once."""
    missing = [name for name in REQUIRED_COLUMNS if name not in head]
    twice = sorted({name for name in head if head.count(name) > 1})
    if missing or twice:
        name = (missing or twice)[0]
        problem = "is missing" if missing else "is there twice"
        raise ConfigurationError(
            f"{problem}: this is no sections.csv as this version writes it",
            file=file,
            key=f"line {line}, column {name}",
        )


def _section_of_row(row: _SectionRow) -> MeasuredSection:
    """The section of a line, its numbers checked."""
    values = {field.name: row.field_value(field) for field in UNDERIVED_SECTION_FIELDS}
    index = float(values["index"])
    if index != int(index):
        raise row.row_error(f"{index:g} is no whole number", "index")
    R = np.asarray(values["axes"]).T
    if not np.allclose(R.T @ R, np.eye(3), atol=AXES_TOLERANCE) or np.linalg.det(R) < 0:
        column = FIELD_BY_NAME["axes"].column_names()[0]
        raise row.row_error("xg, yg and zg are no right-handed axes", column)
    variances = np.asarray(values["covariances"])[:, VARIANCE_INDICES]
    if (bad := np.argwhere(variances < 0)).size:
        corner, axis = bad[0]
        column = FIELD_BY_NAME["covariances"].column_names()[6 * corner + VARIANCE_INDICES[axis]]
        raise row.row_error("a variance is not negative", column)
    return section_from_values(values)


CORNER_NORMALS: Final = ("wall_normal", "wall_normal", "bevel_normal", "leg_normal", "leg_normal")
"""Whose normal p1 to p5 are given: that of the surface they belong to."""

PLY_SECTION_FIELDS: Final = (
    *(("double", axis) for axis in "xyz"),
    *(("float", f"n{axis}") for axis in "xyz"),
    *(("float", f"tangent_{axis}") for axis in "xyz"),
    ("float", "azimuth"),
    ("float", "sigma"),
    ("int", "section"),
    ("uchar", "corner"),
)


SIDE_COLOURS: Final = np.array(
    ((90, 120, 190), (220, 140, 60), (200, 70, 70), (110, 160, 110)), dtype=np.uint8
)
"""Red, green and blue of wall, bevel, root and leg in ``groove.ply``."""


@array_dataclass
class GrooveCloud:
    """Profile points of a groove, each with what it belongs to.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres.
    normals : ndarray, shape (n, 3)
        Of the side, towards the sensor.
    sides : ndarray of int, shape (n,)
        0 to 3: wall, bevel, root, leg.
    """

    points: Array
    normals: Array
    sides: NDArray[np.intp]

    @classmethod
    def joined(cls, clouds: Sequence[GrooveCloud]) -> Self:
        """One cloud of several."""
        parts = zip(*((one.points, one.normals, one.sides) for one in clouds), strict=True)
        return cls(*map(np.concatenate, parts))


def write_cloud_ply(file: Path, cloud: GrooveCloud, provenance: Provenance) -> None:
    """Write ``groove.ply``: points in mm, normals, and the colour of the side, as binary PLY."""
    kinds = (
        ("float", "f4", ("x", "y", "z", "nx", "ny", "nz")),
        ("uchar", "u1", ("red", "green", "blue")),
    )
    properties = [(kind, name) for kind, _, names in kinds for name in names]
    rows = np.empty(len(cloud.points), [(n, f"<{code}") for _, code, names in kinds for n in names])
    columns = np.hstack((1e3 * cloud.points, cloud.normals, SIDE_COLOURS[cloud.sides]))
    for (_, name), column in zip(properties, columns.T, strict=True):
        rows[name] = column
    head = _ply_head("binary_little_endian", provenance, len(rows), properties)
    file.write_bytes(head + rows.tobytes())


def sections_to_ply(sections: Sequence[MeasuredSection], provenance: Provenance) -> bytes:
    """The five points of every section as PLY text, with normals, tangents and uncertainty.

    `section` counts the sections from 0 and `corner` is 1 to 5 for p1 to p5. `sigma` is the
    standard deviation of the point's place, all directions together, NaN for p1 and p5, which
    are where the profile ends.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        In their order along the groove.
    provenance : Provenance
        Is in the comments; its unit of length is the file's.
    """
    n = len(sections)

    def printed(name: str) -> Array:
        cells = FIELD_BY_NAME[name].formatted_columns(sections, provenance.length)
        return np.array([[float(cell or "nan") for cell in row] for row in cells])

    sigmas = np.full((n, 5), np.nan)
    sigmas[:, 1:4] = printed("corner_sigmas")
    normals = {name: printed(name) for name in dict.fromkeys(CORNER_NORMALS)}
    columns = (
        printed("points").reshape(-1, 3),
        np.stack([normals[name] for name in CORNER_NORMALS], axis=1).reshape(-1, 3),
        np.repeat(printed("tangent"), 5, axis=0),
        np.repeat(printed("azimuth"), 5)[:, None],
        sigmas.reshape(-1, 1),
        np.repeat(np.arange(n), 5)[:, None],
        np.tile(np.arange(1, 6), n)[:, None],
    )
    lines = [" ".join(f"{value:.10g}" for value in row) for row in np.hstack(columns)]
    head = _ply_head("ascii", provenance, 5 * n, PLY_SECTION_FIELDS)
    return head + "\n".join([*lines, ""]).encode()


def _ply_head(
    form: str, provenance: Provenance, count: int, properties: Sequence[tuple[str, str]]
) -> bytes:
    lines = [
        "ply",
        f"format {form} 1.0",
        provenance.comment_lines("comment").rstrip("\n"),
        f"element vertex {count}",
        *(f"property {kind} {name}" for kind, name in properties),
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii", errors="replace")
