"""A groove as JSON: every field of every section, after a schema that follows from the fields."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, create_model
from pydantic import Field as Described

from tjscan.core.config import StrictFileModel
from tjscan.core.provenance import LengthUnit, Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.result.section import SECTION_FIELDS, SectionQuantity


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


SECTION_KEYS: Final[dict[str, Any]] = {
    field.name: (_type_in_json(field), Described(description=field.meaning))
    for field in SECTION_FIELDS
}
SECTION_MODEL: Final[Any] = create_model("Section", __base__=StrictFileModel, **SECTION_KEYS)
HEAD_KEYS: Final[dict[str, Any]] = {
    "schema_name": (Literal["tjscan.groove"], "tjscan.groove"),
    "version": (Literal[3], 3),
    "run": (str, Described(description="name of the run directory")),
    "calibration": (str, Described(description="where the sensor's pose on the flange comes from")),
    "provenance": (Provenance, ...),
    "fields": (dict[str, SectionFieldDescription], ...),
}
SECTION_LIST: Final[Any] = Annotated[
    tuple[SECTION_MODEL, ...], Described(strict=False, min_length=2)
]

GROOVE_DOCUMENT: Final[type[BaseModel]] = create_model(
    "GrooveDocument", __base__=StrictFileModel, **HEAD_KEYS, sections=(SECTION_LIST, ...)
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
                field.name: SectionFieldDescription(
                    unit=field.unit_for_lengths(unit).suffix, meaning=field.meaning
                )
                for field in SECTION_FIELDS
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
