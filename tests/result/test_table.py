"""``sections.csv`` gives back what was written, and says where it is wrong."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured import ORIGIN, a_section

from tjscan.core.errors import ConfigurationError
from tjscan.groove.measured import MeasuredSection
from tjscan.result.section import MEASURE_FIELDS
from tjscan.result.table import SECTIONS_CSV_COLUMNS, read_sections_csv, write_sections_csv

PRINTED_MM = 0.51e-4
"""Half of the last of four decimals."""

PRINTED_AXIS = 0.51e-7
SIX_DIGITS = 1e-5
"""Relative: half of the last of six digits, twice in a covariance."""


def written(file: Path, sections: list[MeasuredSection]) -> Path:
    write_sections_csv(file, sections, ORIGIN)
    return file


@given(
    st.lists(st.integers(0, 2**32), min_size=1, max_size=4),
    st.sampled_from([None, float("nan")]),
    st.booleans(),
)
@settings(max_examples=40)
def test_sections_come_back_to_the_printed_digits(
    tmp_path_factory: pytest.TempPathFactory, seeds: list[int], azimuth: float | None, sure: bool
) -> None:
    sections = [a_section(seed, azimuth=azimuth, sure=sure) for seed in seeds]
    file = written(tmp_path_factory.mktemp("sections") / "sections.csv", sections)
    again = read_sections_csv(file)
    assert len(again) == len(sections)
    for was, now in zip(sections, again, strict=True):
        assert (now.index, now.station) == (was.index, was.station)
        np.testing.assert_allclose(np.degrees(now.azimuth), np.degrees(was.azimuth), atol=0.51e-4)
        np.testing.assert_allclose(1e3 * now.points, 1e3 * was.points, atol=PRINTED_MM)
        np.testing.assert_allclose(1e3 * now.T_r_g[:3, 3], 1e3 * was.T_r_g[:3, 3], atol=PRINTED_MM)
        np.testing.assert_allclose(now.T_r_g[:3, :3], was.T_r_g[:3, :3], atol=PRINTED_AXIS)
        np.testing.assert_allclose(now.covariances, was.covariances, rtol=SIX_DIGITS, atol=0)
        np.testing.assert_allclose(
            [field.values_in_file_units([now])[0] for field in MEASURE_FIELDS],
            [field.values_in_file_units([was])[0] for field in MEASURE_FIELDS],
            atol=0.51e-3,
        )
        # Correlations are printed with five decimals.
        floor = SIX_DIGITS * np.outer(was.sigmas, was.sigmas)
        assert (np.abs(now.measure_covariance - was.measure_covariance) <= 2 * floor).all()
        np.testing.assert_allclose(now.sigmas, was.sigmas, rtol=SIX_DIGITS, atol=0)
        assert np.degrees(now.work_angle) == pytest.approx(np.degrees(was.work_angle), abs=1e-4)
        assert 1e3 * now.rms == pytest.approx(1e3 * was.rms, abs=PRINTED_MM)


@given(st.lists(st.integers(0, 2**32), max_size=4), st.booleans())
@settings(max_examples=40)
def test_what_was_read_is_written_the_same(
    tmp_path_factory: pytest.TempPathFactory, seeds: list[int], sure: bool
) -> None:
    folder = tmp_path_factory.mktemp("sections")
    first = written(folder / "first.csv", [a_section(seed, sure=sure) for seed in seeds])
    second = written(folder / "second.csv", list(read_sections_csv(first)))
    assert second.read_bytes() == first.read_bytes()


def test_columns_may_be_moved_and_added(tmp_path: Path) -> None:
    file = written(tmp_path / "sections.csv", [a_section(1), a_section(2)])
    with file.open(encoding="utf-8", newline="") as stream:
        rows = [["note", *reversed(row)] for row in csv.reader(stream)]
    moved = tmp_path / "moved.csv"
    with moved.open("w", encoding="utf-8-sig", newline="") as stream:
        csv.writer(stream).writerows(rows)
    again = written(tmp_path / "again.csv", list(read_sections_csv(moved)))
    assert again.read_bytes() == file.read_bytes()


def cell(column: str, text: str, line: int = 3) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        rows[line - 1][SECTIONS_CSV_COLUMNS.index(column)] = text

    return change


def drop(column: str) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        for row in rows:
            del row[SECTIONS_CSV_COLUMNS.index(column)]

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (cell("p3x_mm", "wide"), "line 3, column p3x_mm: 'wide' is no number"),
        (cell("p3x_mm", ""), "line 3, column p3x_mm: is empty"),
        (cell("depth_mm", "nan"), "line 3, column depth_mm: nan can't be"),
        (cell("azimuth_deg", "361"), "line 3, column azimuth_deg: 361"),
        (cell("index", "1.5"), "line 3, column index: 1.5 is no whole number"),
        (cell("index", "-1"), "line 3, column index: -1"),
        (cell("station", " "), "line 3, column station: is empty"),
        (cell("rms_mm", "-0.1"), "line 3, column rms_mm: -0.1"),
        (cell("xg_x", "0.5"), "line 3, column xg_x: xg, yg and zg"),
        (cell("xg_x", "2"), "line 3, column xg_x: 2"),
        (cell("sigma_depth_mm", "-1"), "line 3, column sigma_depth_mm: -1"),
        (cell("corr_depth_area", "1.5"), "line 3, column corr_depth_area: 1.5"),
        (cell("cov_p3_yy_mm2", "-1"), "line 3, column cov_p3_yy_mm2: a variance"),
        (cell("p1x_mm", "p1z_mm", line=1), "line 1, column p1x_mm: is missing"),
        (lambda rows: rows[0].append("p1x_mm"), "line 1, column p1x_mm: is there twice"),
        (drop("gx_mm"), "line 1, column gx_mm: is missing"),
        (lambda rows: rows[2].pop(), f"line 3: {len(SECTIONS_CSV_COLUMNS) - 1} cells are under"),
        (lambda rows: rows.clear(), "line 1, column index: is missing"),
    ],
)
def test_a_malformed_file_is_refused_with_its_place(
    tmp_path: Path, change: Callable[[list[list[str]]], None], words: str
) -> None:
    file = written(tmp_path / "sections.csv", [a_section(1), a_section(2)])
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    change(rows)
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows(rows)
    with pytest.raises(ConfigurationError) as refused:
        read_sections_csv(file)
    assert words in str(refused.value)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b'index\n"'])
def test_what_is_no_table_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "sections.csv"
    with pytest.raises(ConfigurationError, match="can't be read"):
        read_sections_csv(file)
    file.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"sections\.csv"):
        read_sections_csv(file)


def test_a_table_says_where_it_comes_from(tmp_path: Path) -> None:
    text = written(tmp_path / "sections.csv", [a_section(1)]).read_text(encoding="utf-8")
    assert text.startswith("index,station,")  # any program that reads CSV reads it
    beside = json.loads((tmp_path / "sections.csv-metadata.json").read_text(encoding="utf-8"))
    assert beside["url"] == "sections.csv"
    assert beside["notes"] == [ORIGIN.header_entries]


def test_pandas_reads_a_table_as_documented(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    sections = [a_section(1), a_section(2)]
    table = pandas.read_csv(written(tmp_path / "sections.csv", sections))
    assert list(table.columns) == list(SECTIONS_CSV_COLUMNS)
    assert list(table["station"]) == [section.station for section in sections]
    np.testing.assert_allclose(
        table["depth_mm"], [1e3 * section.measures[2] for section in sections], atol=PRINTED_MM
    )


def test_a_table_without_lines_above_it_is_read(tmp_path: Path) -> None:
    file = written(tmp_path / "sections.csv", [a_section(1), a_section(2)])
    old = tmp_path / "old.csv"
    lines = file.read_text(encoding="utf-8").splitlines()
    old.write_text("\r\n".join([*lines, ""]), encoding="utf-8", newline="")
    again = written(tmp_path / "again.csv", list(read_sections_csv(old)))
    assert again.read_bytes() == file.read_bytes()


def test_a_table_of_an_earlier_version_lacks_what_was_found_about_the_groove(
    tmp_path: Path,
) -> None:
    file = written(tmp_path / "sections.csv", [a_section(1), a_section(2)])
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    for column in ("root_opening_mm", "model_probability", "absent", "conditions", "model"):
        drop(column)(rows)
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows(rows)
    for section in read_sections_csv(file):
        assert (section.model, section.conditions, section.absent) == ("", (), ())
        assert np.isnan(section.root_opening)
