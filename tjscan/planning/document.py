"""``plan.json``: a plan in numbers, after a schema."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from tjscan.core.config import StrictFileModel
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import read_small_file
from tjscan.core.provenance import Provenance
from tjscan.core.units import DEG, MM, MM2, FileUnit
from tjscan.planning.details import DetailStretch
from tjscan.planning.plan import WeldPlan
from tjscan.planning.wps import KJ_MM, M_MIN, MM_MIN

Range = Annotated[tuple[float, float], Field(strict=False, description="least and most")]

SIGNIFICANT_DIGITS: Final = 6
"""Of the numbers written."""

MOST_PLAN_BYTES: Final = 10_000_000
"""A larger file holds no plan: a bead takes a kilobyte."""

FIELD_UNITS: Final = (
    *(MM, MM2, DEG, MM_MIN, M_MIN, KJ_MM),
    *(FileUnit("mm3", 1e-9), FileUnit("l", 1e-3), FileUnit("m"), FileUnit("kg"), FileUnit("s")),
)
"""Units that the names of fields end with."""

Entry = TypeVar("Entry", bound=StrictFileModel)


class ZoneEntry(StrictFileModel):
    """A length of groove with one number of beads."""

    begin_mm: float
    end_mm: float
    beads_in_layers: Annotated[tuple[int, ...], Field(strict=False)]


class BeadEntry(StrictFileModel):
    """A bead, or a station's part of it; its points are in ``beads.csv``."""

    number: int
    part: Annotated[int, Field(description="of the bead, from 1; the arc is off between two parts")]
    zone: int
    layer: int
    place: Annotated[int, Field(description="in its layer, from the bevel")]
    kind: str
    station: Annotated[
        str, Field(description="that welds it, or its part of it; empty if no stations are named")
    ]
    begin_mm: Annotated[float, Field(description="length along the groove at its start")]
    end_mm: float
    length_mm: Annotated[float, Field(description="of the tip's path")]
    feed_m_min: float
    speed_mm_min: Range
    area_mm2: Range
    width_mm: Range
    heat_kJ_mm: Range  # noqa: N815
    positions: Annotated[tuple[str, ...], Field(strict=False, description="after ISO 6947")]
    arc_time_s: float
    volume_mm3: float
    fill_sigma: Annotated[
        float, Field(description="standard deviation of what is missing, as a share of the volume")
    ]


class RootEntry(StrictFileModel):
    """What is at the root, as the sections show it."""

    opening_mm: Annotated[
        Range | None, Field(description="of an open root; null if it is closed all along")
    ]
    backing: Annotated[bool, Field(description="as the WPS states")]
    tacks: Literal["fuse", "skip"]
    tack_spans_mm: Annotated[
        tuple[Range, ...],
        Field(strict=False, description="where tacks may reach, by the WPS's length of them"),
    ]


class DetailEntry(StrictFileModel):
    """A stretch of groove beside the WPS's table of details: measured and stated, no more."""

    begin_mm: float
    end_mm: float
    dihedral_deg: Range
    sigma_dihedral_deg: float
    details: Annotated[
        tuple[str, ...], Field(strict=False, description="whose dihedral window holds it")
    ]
    out_of_table: Annotated[
        tuple[str, ...], Field(strict=False, description="of the detail that fits best")
    ]


class LengthEntry(StrictFileModel):
    """A length of groove that a station does not reach."""

    begin_mm: float
    end_mm: float
    reason: Annotated[str, Field(description="the most frequent obstacle")]


class StationEntry(StrictFileModel):
    """What a station reaches with the torch, and its program."""

    name: str
    reached_mm: Annotated[
        Range | None,
        Field(
            description="the longest length along which the torch can be led; beyond the groove's "
            "length if it closes and the length passes its start; null if nothing is reached"
        ),
    ]
    unreached: Annotated[tuple[LengthEntry, ...], Field(strict=False)]
    program: Annotated[str, Field(description="file; empty if there is none")]
    without_program: Annotated[str, Field(description="why there is none")]


class FindingEntry(StrictFileModel):
    """What of a bead is out of the WPS."""

    key: str
    bead: int
    begin_mm: float
    end_mm: float
    share: Annotated[float, Field(description="of the bead's points")]
    text: str


class PlanDocument(StrictFileModel):
    """A weld plan: what was computed, never that it complies with anything."""

    schema_name: Literal["tjscan.plan"] = "tjscan.plan"
    version: Literal[2] = 2
    run: str
    wps: Annotated[str, Field(description="name of the WPS, and its SHA-256")]
    provenance: Provenance
    gravity: Annotated[tuple[float, float, float], Field(strict=False)]
    closed: bool
    after_pass: Annotated[int, Field(description="passes that were welded before the scan")]
    root: RootEntry
    groove_mm: float
    arc_time_s: float
    volume_mm3: float
    wire_m: float
    wire_kg: float
    gas_l: float
    stick_out_mm: float
    overlap_mm: Annotated[
        float,
        Field(description="by which beads lap over their start, or over the bead that follows"),
    ]
    interpass_temperature_C: float  # noqa: N815
    zones: Annotated[tuple[ZoneEntry, ...], Field(strict=False)]
    beads: Annotated[tuple[BeadEntry, ...], Field(strict=False)]
    details: Annotated[tuple[DetailEntry, ...], Field(strict=False)]
    out_of_wps: Annotated[tuple[FindingEntry, ...], Field(strict=False)]
    stations: Annotated[
        tuple[StationEntry, ...], Field(strict=False, description="in the order of welding")
    ]
    without_stations: Annotated[str, Field(description="why it is not known what is reached")]


def plan_document(
    plan: WeldPlan,
    provenance: Provenance,
    run: str,
    wps: str,
    details: Sequence[DetailStretch] = (),
    stations: tuple[StationEntry, ...] = (),
    without_stations: str = "",
) -> PlanDocument:
    """Build the document of a plan.

    Parameters
    ----------
    plan : WeldPlan
        The plan.
    provenance : Provenance
        Of the file.
    run : str
        Name of the run directory.
    wps : str
        Name of the WPS, and its SHA-256.
    details : sequence of DetailStretch
        The groove beside the WPS's table of details.
    stations : tuple of StationEntry
        The lengths that each reaches.
    without_stations : str
        Why these are not known.
    """
    x, y, z = plan.gravity.tolist()
    return _entry(
        PlanDocument,
        plan,
        run=run,
        wps=wps,
        provenance=provenance,
        gravity=(x, y, z),
        closed=plan.edges.closed,
        root=_root(plan),
        groove_mm=_in_file("groove_mm", plan.edges.length),
        wire_m=_in_file("wire_m", plan.wire_length),
        wire_kg=_in_file("wire_kg", plan.wire_mass),
        gas_l=_in_file("gas_l", plan.gas_volume),
        stick_out_mm=_in_file("stick_out_mm", plan.wps.torch.stick_out),
        overlap_mm=_in_file("overlap_mm", plan.wps.sequence.overlap),
        interpass_temperature_C=plan.wps.sequence.interpass_temperature,
        zones=tuple(
            _entry(ZoneEntry, zone, beads_in_layers=zone.arrangement.counts) for zone in plan.zones
        ),
        beads=tuple(
            _entry(BeadEntry, bead, positions=tuple(sorted(set(bead.positions))))
            for bead in plan.beads
        ),
        details=tuple(_entry(DetailEntry, one) for one in details),
        out_of_wps=tuple(_entry(FindingEntry, one) for one in plan.findings),
        stations=stations,
        without_stations=without_stations,
    )


def _root(plan: WeldPlan) -> RootEntry:
    root, settings = plan.edges.root, plan.wps.root
    opening = plan.edges.root_opening(root.s)[root.openness == 1]
    tacks = () if plan.after_pass else root.tack_spans(settings.tack_length)  # under a pass: none
    return _entry(
        RootEntry,
        settings,
        opening_mm=_in_file("opening_mm", opening) if len(opening) else None,
        tack_spans_mm=tuple(_in_file("tack_spans_mm", span) for span in tacks),
    )


def _entry(model: type[Entry], source: object, **own: Any) -> Entry:
    """Fill a model with the attributes of a plan's part, in the units of the model's fields.

    Parameters
    ----------
    model : type
        Field ``speed_mm_min`` takes the attribute ``speed``; a field without a unit takes the
        attribute of its name.
    source : object
        Holds numbers and arrays in SI units.
    **own
        Values of fields that `source` has no attribute for.
    """
    return model(
        **own
        | {
            name: _in_file(name, getattr(source, _stem_and_factor(name)[0]))
            for name in model.model_fields
            if name not in own and name not in ("schema_name", "version")
        }
    )


def _stem_and_factor(field: str) -> tuple[str, float]:
    """Name of a field without its unit, and the unit's value in SI units."""
    found = [unit for unit in FIELD_UNITS if field.endswith(f"_{unit.suffix}")]
    if not found:
        return field, 1.0
    unit = max(found, key=lambda one: len(one.suffix))
    return field.removesuffix(f"_{unit.suffix}"), unit.factor


def _in_file(field: str, value: Any) -> Any:
    """A value as the file has it: numbers in the unit of the field, least and most of several."""
    factor = _stem_and_factor(field)[1]
    if isinstance(value, float):
        return float(f"{value / factor:.{SIGNIFICANT_DIGITS}g}")
    is_range = isinstance(value, tuple) and bool(value) and isinstance(value[0], float)
    if is_range or isinstance(value, np.ndarray):
        return tuple(_in_file(field, float(limit)) for limit in (np.min(value), np.max(value)))
    return value


def read_plan(file: Path) -> PlanDocument:
    """Read ``plan.json``.

    Raises
    ------
    ConfigurationError
        If it is missing, or no plan as this version writes it.
    """
    try:
        return PlanDocument.model_validate_json(read_small_file(file, MOST_PLAN_BYTES, "a plan"))
    except OSError as error:
        raise ConfigurationError(
            f"can't be read: {error.strerror}. `tjscan plan` writes it", file=file
        ) from None
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigurationError(
            f"is no plan as this version writes it ({first['msg']}): run `tjscan plan` again",
            file=file,
            key=".".join(str(part) for part in first["loc"]) or None,
        ) from None
