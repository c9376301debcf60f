"""``sections.csv``: a row per section, in mm and degrees, in the frame of the result."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.files import check_size
from tjscan.core.frames import Array, pose
from tjscan.groove.measured import MeasuredSection

MEASURES: Final = ("groove_angle", "root_width", "depth", "area")
UNITS: Final = ("deg", "mm", "mm", "mm2")
IN_FILE: Final = np.array((180 / np.pi, 1e3, 1e3, 1e6))
"""From radians, metres and square metres to the units of the measures in the file."""

AXES: Final = ("xg", "yg", "zg")
"""Of frame g: square to the section's plane, up the brace's wall, and out of that wall."""

MOST_BYTES: Final = 50_000_000
"""A larger file holds no sections: each takes a kilobyte."""

_PAIRS: Final = np.triu_indices(4, 1)
_SIX: Final = np.triu_indices(3)
_ROUNDED: Final = 1e-6
"""How far axes printed with seven decimals may be from orthonormal."""

POINTS: Final = tuple(f"p{i}{axis}_mm" for i in range(1, 6) for axis in "xyz")
ORIGIN: Final = tuple(f"g{axis}_mm" for axis in "xyz")
ROTATION: Final = tuple(f"{name}_{axis}" for name in AXES for axis in "xyz")
COVARIANCES: Final = tuple(
    f"cov_p{i}_{'xyz'[a]}{'xyz'[b]}_mm2" for i in (2, 3, 4) for a, b in zip(*_SIX, strict=True)
)
VALUES: Final = tuple(f"{name}_{unit}" for name, unit in zip(MEASURES, UNITS, strict=True))
SIGMAS: Final = tuple(f"sigma_{name}" for name in VALUES)
CORRELATIONS: Final = tuple(
    f"corr_{MEASURES[a]}_{MEASURES[b]}" for a, b in zip(*_PAIRS, strict=True)
)

COLUMNS: Final = (
    "index",
    "station",
    "azimuth_deg",
    "s_mm",
    *POINTS,
    *VALUES,
    "work_angle_deg",
    "rms_mm",
    *ORIGIN,
    *ROTATION,
    *SIGMAS,
    *CORRELATIONS,
    *COVARIANCES,
)


def rows(sections: Sequence[MeasuredSection]) -> Iterator[list[str]]:
    """One row of text per section, in the order of COLUMNS."""
    for section, along in zip(sections, lengths(sections), strict=True):
        azimuth, spread = np.degrees(section.azimuth), section.sigmas
        yield [
            str(section.index),
            section.station,
            "" if np.isnan(azimuth) else _fixed(azimuth, 4),
            _fixed(1e3 * along, 4),
            *(_fixed(v, 4) for v in 1e3 * section.points.ravel()),
            *(_fixed(v, n) for v, n in zip(IN_FILE * section.measures, (4, 4, 4, 3), strict=True)),
            _fixed(np.degrees(section.work_angle), 4),
            _fixed(1e3 * section.rms, 4),
            *(_fixed(v, 4) for v in 1e3 * section.T_r_g[:3, 3]),
            *(_fixed(v, 7) for v in section.T_r_g[:3, :3].T.ravel()),
            *(f"{v:.6g}" for v in IN_FILE * spread),
            *(_fixed(v, 5) for v in _correlations(section.measure_covariance, spread)),
            *(f"{v:.6g}" for v in 1e6 * section.covariances[:, *_SIX].ravel()),
        ]


def lengths(sections: Sequence[MeasuredSection]) -> Array:
    """Length in metres of the chain of groove origins up to each section, shape (n,).

    Taken between the origins as they are printed, so that a file agrees with itself.
    """
    origins = np.array([section.T_r_g[:3, 3] for section in sections]).reshape(-1, 3)
    steps = np.linalg.norm(np.diff(np.round(1e3 * origins, 4), axis=0), axis=1)
    return np.concatenate(([0.0], 1e-3 * steps.cumsum()))[: len(sections)]


def write_sections(file: Path, sections: Sequence[MeasuredSection]) -> None:
    """Write ``sections.csv``."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        writer.writerows(rows(sections))


def read_sections(file: Path) -> tuple[MeasuredSection, ...]:
    """Read ``sections.csv``: what was written, to the digits that were printed.

    Columns may stand in another order, and others beside them.

    Raises
    ------
    ConfigurationError
        If it is missing, lacks a column or holds what is no section; with line and column.
    """
    try:
        check_size(file, MOST_BYTES, "sections")
        with file.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream, strict=True)
            head = next(reader, [])
            _check_head(file, head)
            return tuple(
                _section(_Row(file, reader.line_num, head, cells)) for cells in reader if cells
            )
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"is not UTF-8 text ({error})", file=file) from None
    except csv.Error as error:
        raise ConfigurationError(f"is no table: {error}", file=file) from None


class _Row:
    """A line of the file, whose cells are read by the names of their columns."""

    def __init__(self, file: Path, line: int, head: Sequence[str], cells: Sequence[str]) -> None:
        self._file, self._line = file, line
        if len(cells) != len(head):
            raise self.wrong(f"{len(cells)} cells stand under {len(head)} columns: it was cut off?")
        self._cells = dict(zip(head, cells, strict=True))

    def wrong(self, message: str, column: str | None = None) -> ConfigurationError:
        """An error that says where."""
        where = f"line {self._line}" + ("" if column is None else f", column {column}")
        return ConfigurationError(message, file=self._file, key=where)

    def text(self, column: str) -> str:
        """A cell's text, not empty."""
        if not (text := self._cells[column].strip()):
            raise self.wrong("is empty", column)
        return text

    def number(self, column: str, *, least: float = -np.inf, most: float = np.inf) -> float:
        """A cell's number, within bounds."""
        text = self.text(column)
        try:
            value = float(text)
        except ValueError:
            raise self.wrong(f"{text!r} is no number", column) from None
        if not np.isfinite(value) or not least <= value <= most:
            raise self.wrong(f"{text} can't be", column)
        return value

    def numbers(
        self, columns: Sequence[str], *, least: float = -np.inf, most: float = np.inf
    ) -> Array:
        """The numbers of several cells."""
        return np.array([self.number(column, least=least, most=most) for column in columns])

    def azimuth(self, column: str) -> float:
        """An azimuth in degrees; NaN where the cell is empty."""
        if not self._cells[column].strip():
            return float("nan")
        return self.number(column, least=-360, most=360)


def _check_head(file: Path, head: Sequence[str]) -> None:
    """Refuse a first line that does not name every column once."""
    missing = [name for name in COLUMNS if name not in head]
    twice = sorted({name for name in head if head.count(name) > 1})
    if missing or twice:
        name = (missing or twice)[0]
        told = "is missing" if missing else "stands there twice"
        raise ConfigurationError(
            f"{told}: this is no sections.csv as this version writes it",
            file=file,
            key=f"line 1, column {name}",
        )


def _section(row: _Row) -> MeasuredSection:
    index = row.number("index", least=0)
    if index != int(index):
        raise row.wrong(f"{index:g} is no whole number", "index")
    R = row.numbers(ROTATION, least=-1, most=1).reshape(3, 3).T
    if not np.allclose(R.T @ R, np.eye(3), atol=_ROUNDED) or np.linalg.det(R) < 0:
        raise row.wrong("xg, yg and zg are no right-handed axes", ROTATION[0])
    spread = row.numbers(SIGMAS, least=0) / IN_FILE
    correlation = np.eye(4)
    correlation[_PAIRS] = row.numbers(CORRELATIONS, least=-1, most=1)
    correlation[_PAIRS[::-1]] = correlation[_PAIRS]
    covariances = np.empty((3, 3, 3))
    covariances[:, *_SIX] = 1e-6 * row.numbers(COVARIANCES).reshape(3, 6)
    covariances[:, *_SIX[::-1]] = covariances[:, *_SIX]
    if (bad := np.argwhere(np.diagonal(covariances, axis1=1, axis2=2) < 0)).size:
        corner, axis = bad[0]
        column = f"cov_p{corner + 2}_{2 * 'xyz'[axis]}_mm2"
        raise row.wrong("a variance is not negative", column)
    return MeasuredSection(
        index=int(index),
        station=row.text("station"),
        azimuth=float(np.radians(row.azimuth("azimuth_deg"))),
        T_r_g=pose(R, 1e-3 * row.numbers(ORIGIN)),
        points=1e-3 * row.numbers(POINTS).reshape(5, 3),
        covariances=covariances,
        measures=row.numbers(VALUES) / IN_FILE,
        measure_covariance=correlation * np.outer(spread, spread),
        work_angle=float(np.radians(row.number("work_angle_deg"))),
        rms=1e-3 * row.number("rms_mm", least=0),
    )


def _correlations(covariance: Array, spread: Array) -> Array:
    """Correlations of pairs of measures, shape (6,); zero where nothing varies."""
    scale = np.outer(spread, spread)[_PAIRS]
    ratio = np.divide(covariance[_PAIRS], scale, out=np.zeros(6), where=scale > 0)
    return np.clip(ratio, -1, 1)


def _fixed(value: float, decimals: int) -> str:
    """A number with so many decimals, and no minus before a zero."""
    text = f"{value:.{decimals}f}"
    return text if float(text) else f"{0:.{decimals}f}"
