"""Write a run's sections for another tool: as a table, points, JSON or a weldx file.

JSON holds every field of every section, after a schema that follows from the fields.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, create_model
from pydantic import Field as Described

from tjscan.core.config import StrictFileModel
from tjscan.core.errors import ConfigurationError, explain_missing_package
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import inverse_pose, pose_from_rounded_matrix, transform_points
from tjscan.core.provenance import LengthUnit, Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result.directory import SECTIONS_FILE, job_label_of_run
from tjscan.result.section import SECTION_FIELDS, SectionQuantity
from tjscan.result.shapes import read_finished_sections
from tjscan.result.table import sections_to_csv, sections_to_ply


class SectionFieldDescription(StrictFileModel):
    """What a field of the sections means."""

    unit: str
    meaning: str


def _type_in_json(field: SectionQuantity) -> Any:
    """The type of a field's value in JSON."""
    if field.text or field.name == "index":
        return str if field.text else int
    kind: Any = float
    for count in reversed(field.shape):
        numbers: Any = tuple.__class_getitem__((kind,) * count)
        kind = Annotated[numbers, Described(strict=False)]
    return kind | None if field.blank else kind


EXPORT_FIELDS: Final[dict[str, Any]] = {
    field.name: (_type_in_json(field), Described(description=field.meaning))
    for field in SECTION_FIELDS
}
SECTION_MODEL: Final[Any] = create_model("Section", __base__=StrictFileModel, **EXPORT_FIELDS)
EXPORT_HEAD_FIELDS: Final[dict[str, Any]] = {
    "schema_name": (Literal["tjscan.groove"], "tjscan.groove"),
    "version": (Literal[3], 3),
    "run": (str, Described(description="name of the run directory")),
    "calibration": (str, Described(description="where the sensor's pose on the flange comes from")),
    "provenance": (Provenance, ...),
    "fields": (dict[str, SectionFieldDescription], ...),
}
EXPORT_SECTION_LIST_TYPE: Final[Any] = Annotated[
    tuple[SECTION_MODEL, ...], Described(strict=False, min_length=2)
]

GROOVE_DOCUMENT: Final[type[BaseModel]] = create_model(
    "GrooveDocument",
    __base__=StrictFileModel,
    **EXPORT_HEAD_FIELDS,
    sections=(EXPORT_SECTION_LIST_TYPE, ...),
)
"""The document's model, whose schema is ``docs/export.schema.json``."""


def build_sections_document(
    sections: Sequence[MeasuredSection], provenance: Provenance, run: str, calibration: str
) -> BaseModel:
    """Build the model of the sections' JSON document, validated against `GROOVE_DOCUMENT`.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        Two or more, in their order along the groove.
    provenance : Provenance
        Of the file; its unit of length is the document's.
    run : str
        Name of the run directory.
    calibration : str
        Where the sensor's pose on the flange comes from.
    """
    unit = provenance.length
    columns = {field.name: _json_values(field, sections, unit) for field in SECTION_FIELDS}
    rows = zip(*columns.values(), strict=True)
    return GROOVE_DOCUMENT.model_validate(
        {
            "run": run,
            "calibration": calibration,
            "provenance": provenance,
            "fields": {
                one.name: {"unit": one.unit_for_lengths(unit).suffix, "meaning": one.meaning}
                for one in SECTION_FIELDS
            },
            "sections": [dict(zip(columns, row, strict=True)) for row in rows],
        }
    )


def _json_values(
    field: SectionQuantity, sections: Sequence[MeasuredSection], unit: LengthUnit
) -> list[Any]:
    """A field's value of each section, to the digits that tables print."""
    cells = field.formatted_columns(sections, unit)
    if field.text:
        return [row[0] for row in cells]
    if not field.shape:
        kind = int if field.name == "index" else float
        return [kind(row[0]) if row[0] else None for row in cells]
    return [
        np.reshape(np.array(row, dtype=float), field.shape).tolist() if all(row) else None
        for row in cells
    ]


Format = Literal["csv", "ply", "json", "weldx"]

EXPORT_FILE_STEM: Final = "export"
"""Name of the file in the run directory, if none is given."""


def export_run(
    directory: Path, to: Format, units: LengthUnit = "mm", out: Path | None = None
) -> Path:
    """Write a run's sections as a file for another tool, and return that file.

    Parameters
    ----------
    directory : Path
        The run directory, of one scan or stitched.
    to : str
        csv, ply, json or weldx.
    units : str
        Unit of its lengths: mm or m.
    out : Path, optional
        The file to write; ``export.FORMAT`` in the run directory if left out.

    Raises
    ------
    ConfigurationError
        If there is no finished run, the folder of the file does not exist, or an extra is not
        installed.
    RecordingError
        If the file can't be written; what was there before is unchanged.
    """
    summary, sections = read_finished_sections(directory)
    if len(sections) < 2:
        raise ConfigurationError(
            "two sections or more are needed to find the groove's direction",
            file=directory / SECTIONS_FILE,
        )
    run, calibration = directory.resolve().name, summary.calibration
    provenance = Provenance.for_file_written_now(job_label_of_run(directory), summary.frame, units)
    file = out or directory / f"{EXPORT_FILE_STEM}.{to}"
    if not file.parent.is_dir() or file.is_dir():
        raise ConfigurationError("is no file in a folder that exists", file=file, key="--out")
    with write_files_atomically(file.parent) as draft:
        made = draft / file.name
        match to:
            case "csv":
                provenance.write_table(made, sections_to_csv(sections, units))
            case "ply":
                made.write_bytes(sections_to_ply(sections, provenance))
            case "json":
                document = build_sections_document(sections, provenance, run, calibration)
                made.write_bytes(f"{document.model_dump_json(indent=1)}\n".encode())
            case "weldx":
                document = build_sections_document(sections, provenance, run, calibration)
                write_weldx(made, sections, provenance, document)
    return file


WELDX_ROOT_FRAME_NAMES = {"j": "joint", "b": "arm base"}
"""What the frame of the result is called in the tree of frames."""


def write_weldx(
    file: Path, sections: Sequence[MeasuredSection], provenance: Provenance, document: BaseModel
) -> None:
    """Write section frames and points as a weldx file, with the JSON document beside them.

    Every section is a frame g below the joint (or the arm's base), with its five points as
    ``SpatialData`` in it. The document is under ``groove``, the frames under
    ``coordinate_systems``.

    Parameters
    ----------
    file : Path
        The file to write.
    sections, provenance
        As of `build_sections_document`.
    document : BaseModel
        The sections as JSON holds them.

    Raises
    ------
    ConfigurationError
        If the extra is not installed.
    """
    with explain_missing_package("a weldx file", "weldx", "--to"):
        weldx: Any = import_module("weldx")
    unit = provenance.length
    per_metre = 1e3 if unit == "mm" else 1.0
    root = WELDX_ROOT_FRAME_NAMES.get(provenance.frame, provenance.frame)
    frames = weldx.CoordinateSystemManager(root, "groove")
    for k, section in enumerate(sections):
        T = pose_from_rounded_matrix(section.T_r_g)  # weldx is strict about rotations
        name = f"section {k}"
        where = weldx.LocalCoordinateSystem(T[:3, :3], weldx.Q_(per_metre * T[:3, 3], unit))
        frames.add_cs(name, root, where)
        points = per_metre * transform_points(inverse_pose(T), section.points)
        frames.assign_data(weldx.SpatialData(weldx.Q_(points, unit)), f"points of {name}", name)
    groove = document.model_dump(mode="json")
    with weldx.WeldxFile(tree={"groove": groove, "coordinate_systems": frames}, mode="rw") as made:
        made.write_to(file)
