"""Every format writes the fields that one description names, in the units that it states."""

import io
import json
from typing import Any

import numpy as np
import pytest
import trimesh
from measured import ORIGIN, a_section

from tjscan.core.frames import Array, inverse_pose
from tjscan.core.provenance import LengthUnit, Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result.export import build_sections_document
from tjscan.result.section import (
    FIELD_BY_NAME,
    SECTION_FIELDS,
    UNDERIVED_SECTION_FIELDS,
    SectionQuantity,
    section_from_values,
)
from tjscan.result.table import sections_to_csv, sections_to_ply

SECTIONS = tuple(a_section(seed) for seed in range(1, 6))
SUFFIX = {
    "mm": {"mm": "mm", "mm2": "mm2", "deg": "deg", "": ""},
    "m": {"mm": "m", "mm2": "m2", "deg": "deg", "": ""},
}
PER_SI = {"mm": 1e3, "m": 1.0, "mm2": 1e6, "m2": 1.0, "deg": 180 / np.pi, "": 1.0}
NUMBERS = [field for field in SECTION_FIELDS if not field.text]
LENGTHS = pytest.mark.parametrize("length", ["mm", "m"])
EVERY = pytest.mark.parametrize("field", NUMBERS, ids=lambda field: field.name)


def provenance(length: LengthUnit) -> Provenance:
    return Provenance(ORIGIN.program, ORIGIN.written, ORIGIN.job, ORIGIN.frame, length)


def table(length: LengthUnit) -> dict[str, list[str]]:
    """Columns of the CSV."""
    lines = sections_to_csv(SECTIONS, length).splitlines()
    rows = [line.replace('"left, upper"', "left upper").split(",") for line in lines]
    return dict(zip(rows[0], map(list, zip(*rows[1:], strict=True)), strict=True))


def document(length: LengthUnit) -> dict[str, Any]:
    """The JSON."""
    found: dict[str, Any] = json.loads(
        build_sections_document(SECTIONS, provenance(length), "run", "known").model_dump_json()
    )
    return found


def tolerance(field: SectionQuantity, values: Array, length: LengthUnit) -> Array:
    """Half of the last printed digit, in the file's unit."""
    if field.decimals is None:
        return 0.6e-5 * np.abs(values)
    shift = np.log10(PER_SI[SUFFIX["mm"][field.unit.suffix]])
    shift -= np.log10(PER_SI[SUFFIX[length][field.unit.suffix]])
    return np.full_like(values, 0.51 * 10 ** -(field.decimals + shift))


def expected(field: SectionQuantity, length: LengthUnit) -> Array:
    """What a file must hold, converted here from SI units."""
    raw = np.asarray(field.values_in_si_units(SECTIONS), dtype=float)
    return raw * PER_SI[SUFFIX[length][field.unit.suffix]]


@EVERY
@LENGTHS
def test_names_of_columns_end_in_the_unit_of_their_numbers(
    field: SectionQuantity, length: LengthUnit
) -> None:
    suffix = SUFFIX[length][field.unit.suffix]
    columns = field.column_names(length)
    assert all(not suffix or column.endswith(f"_{suffix}") for column in columns)
    found = np.array([[float(v) for v in table(length)[name]] for name in columns]).T
    values = expected(field, length).reshape(len(SECTIONS), -1)
    assert (np.abs(found - values) <= tolerance(field, values, length)).all()


@EVERY
@LENGTHS
def test_json_holds_each_field_in_the_unit_that_it_states(
    field: SectionQuantity, length: LengthUnit
) -> None:
    stated = document(length)
    assert stated["fields"][field.name]["unit"] == SUFFIX[length][field.unit.suffix]
    assert stated["fields"][field.name]["meaning"] == field.meaning
    found = np.array([section[field.name] for section in stated["sections"]], dtype=float)
    values = expected(field, length)
    assert found.shape == (len(SECTIONS), *field.shape)
    assert (np.abs(found - values) <= tolerance(field, values, length)).all()


@LENGTHS
def test_every_format_says_where_it_comes_from(length: LengthUnit) -> None:
    stated = provenance(length)
    assert (
        Provenance.from_comment_lines(sections_to_ply(SECTIONS, stated).decode(), "comment")
        == stated
    )
    found = document(length)["provenance"]
    assert (found["program"], found["job"]) == (stated.program, stated.job)
    assert (found["frame"], found["length"], found["angle"]) == ("j", length, "deg")
    assert found["written"] == "2026-03-04T05:06:07Z"


def same(now: MeasuredSection, was: MeasuredSection) -> None:
    """Both are one section, to the printed digits."""
    assert (now.index, now.station) == (was.index, was.station)
    for field in UNDERIVED_SECTION_FIELDS:
        if field.text:
            assert getattr(now, field.name) == getattr(was, field.name)
            continue
        a, b = field.values_in_file_units([now]), field.values_in_file_units([was])
        assert (np.abs(a - b) <= 2 * tolerance(field, b, "mm") + 1e-12).all(), field.name


@LENGTHS
def test_sections_come_back_from_csv_and_json(length: LengthUnit) -> None:
    cells, written = table(length), document(length)["sections"]
    for k, was in enumerate(SECTIONS):
        texts = [field.name for field in UNDERIVED_SECTION_FIELDS if field.text]
        from_csv: dict[str, Any] = {name: cells[name][k] for name in texts} | {
            "station": was.station
        }
        from_json: dict[str, Any] = {name: written[k][name] for name in texts}
        for field in UNDERIVED_SECTION_FIELDS:
            if field.text:
                continue
            factor = field.unit_for_lengths(length).factor
            numbers = [float(cells[name][k]) for name in field.column_names(length)]
            from_csv[field.name] = factor * np.reshape(numbers, field.shape)
            from_json[field.name] = factor * np.asarray(written[k][field.name])
        same(section_from_values(from_csv), was)
        same(section_from_values(from_json), was)


@LENGTHS
def test_points_come_back_from_ply(length: LengthUnit) -> None:
    text = sections_to_ply(SECTIONS, provenance(length))
    cloud = trimesh.load(io.BytesIO(text), file_type="ply", process=False)
    points = expected(FIELD_BY_NAME["points"], length).reshape(-1, 3)
    allowed = tolerance(FIELD_BY_NAME["points"], points, length)
    assert (np.abs(cloud.vertices - points) <= allowed + 1e-12).all()
    data = cloud.metadata["_ply_raw"]["vertex"]["data"]
    sigmas = expected(FIELD_BY_NAME["corner_sigmas"], length)
    found = data["sigma"].reshape(-1, 5)
    np.testing.assert_allclose(found[:, 1:4], sigmas, rtol=1e-5)
    assert np.isnan(found[:, [0, 4]]).all()
    np.testing.assert_allclose(
        data["azimuth"].reshape(-1, 5)[:, 0], expected(FIELD_BY_NAME["azimuth"], length), atol=1e-4
    )


def test_each_column_stands_once() -> None:
    columns = [column for field in SECTION_FIELDS for column in field.column_names()]
    assert len(set(columns)) == len(columns)


def test_an_unknown_azimuth_is_left_empty() -> None:
    sections = [a_section(1, azimuth=float("nan")), a_section(2)]
    assert FIELD_BY_NAME["azimuth"].formatted_columns(sections)[0] == [""]
    text = build_sections_document(sections, ORIGIN, "run", "known").model_dump_json()
    assert json.loads(text)["sections"][0]["azimuth"] is None


def test_axes_are_those_of_frame_g() -> None:
    section = SECTIONS[0]
    axes = FIELD_BY_NAME["axes"].values_in_file_units([section])[0]
    np.testing.assert_allclose(axes, inverse_pose(section.T_r_g)[:3, :3])
