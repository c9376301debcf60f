"""A plan in files: ``plan.json``, after a schema, and ``beads.csv``, a row a point."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from tjscan.core.config import StrictFileModel
from tjscan.core.errors import ConfigurationError
from tjscan.core.files import read_small_file
from tjscan.core.frames import Array
from tjscan.core.pose_vector import rotation_to_vector
from tjscan.core.provenance import Provenance
from tjscan.core.units import DEG, M_PER_MIN, MM, MM2, FileUnit
from tjscan.planning.details import DetailStretch
from tjscan.planning.lay import PlannedBead
from tjscan.planning.plan import WeldPlan
from tjscan.planning.wps import KJ_PER_MM, MM_PER_MIN

Range = Annotated[tuple[float, float], Field(strict=False, description="least and most")]

Item = TypeVar("Item")

List = Annotated[tuple[Item, ...], Field(strict=False)]
"""A tuple that the file holds as a list."""

SIGNIFICANT_DIGITS: Final = 6
"""Of the numbers written."""

MOST_PLAN_BYTES: Final = 10_000_000
"""A larger file holds no plan: a bead takes a kilobyte."""

MOST_TABLE_BYTES: Final = 200_000_000
"""A larger table of beads holds no plan."""

FIELD_UNITS: Final = (
    MM,
    MM2,
    DEG,
    MM_PER_MIN,
    M_PER_MIN,
    KJ_PER_MM,
    FileUnit("mm3", 1e-9),
    FileUnit("l", 1e-3),
    FileUnit("m"),
    FileUnit("kg"),
    FileUnit("s"),
)
"""Units that the names of fields end with."""

Entry = TypeVar("Entry", bound=StrictFileModel)


class BeadCountZoneEntry(StrictFileModel):
    """A length of groove with one number of beads."""

    begin_mm: float
    end_mm: float
    beads_in_layers: List[int]


class BeadEntry(StrictFileModel):
    """A bead, or a station's part of it; its points are in ``beads.csv``.

    Parameters
    ----------
    part : int
        of the bead, from 1; the arc is off between two parts
    place : int
        in its layer, from the bevel
    station : str
        that welds it, or its part of it; empty if no stations are named
    begin_mm : float
        length along the groove at its start
    length_mm : float
        of the tip's path
    weave_mm : tuple of float
        how far the torch swings to either side
    slope_deg, rotation_deg : tuple of float
        after ISO 6947; a slope below zero goes downhill
    positions : tuple of str
        after ISO 6947
    fill_sigma : float
        standard deviation of what is missing, as a share of the volume
    """

    number: int
    part: int
    zone: int
    layer: int
    place: int
    kind: str
    station: str
    begin_mm: float
    end_mm: float
    length_mm: float
    feed_m_min: Range
    speed_mm_min: Range
    area_mm2: Range
    width_mm: Range
    weave_mm: Range
    heat_kJ_mm: Range  # noqa: N815
    slope_deg: Range
    rotation_deg: Range
    positions: List[str]
    arc_time_s: float
    volume_mm3: float
    fill_sigma: float


class RootEntry(StrictFileModel):
    """What is at the root, as the sections show it.

    Parameters
    ----------
    opening_mm : tuple of float, or None
        of an open root; null if it is closed all along
    backing : bool
        as the WPS states
    tack_spans_mm : tuple of (float, float)
        where tacks may reach, by the WPS's length of them
    """

    opening_mm: Range | None
    backing: bool
    tacks: Literal["fuse", "skip"]
    tack_spans_mm: List[Range]


class DetailEntry(StrictFileModel):
    """A stretch of groove beside the WPS's table of details: measured and stated, no more.

    Parameters
    ----------
    details : tuple of str
        whose dihedral window holds it
    out_of_table : tuple of str
        of the detail that fits best
    """

    begin_mm: float
    end_mm: float
    dihedral_deg: Range
    sigma_dihedral_deg: float
    details: List[str]
    out_of_table: List[str]


class LengthEntry(StrictFileModel):
    """A length of groove that a station does not reach.

    Parameters
    ----------
    reason : str
        the most frequent obstacle
    """

    begin_mm: float
    end_mm: float
    reason: str


class StationEntry(StrictFileModel):
    """What a station reaches with the torch, and its program.

    Parameters
    ----------
    reached_mm : tuple of float, or None
        the longest length along which the torch can be led; beyond the groove's length if it closes
        and the length passes its start; null if nothing is reached
    program : str
        file; empty if there is none
    without_program : str
        why there is none
    """

    name: str
    reached_mm: Range | None
    unreached: List[LengthEntry]
    program: str
    without_program: str


class FindingEntry(StrictFileModel):
    """What of a bead is out of the WPS.

    Parameters
    ----------
    share : float
        of the bead's points
    """

    key: str
    bead: int
    begin_mm: float
    end_mm: float
    share: float
    text: str


class PlanDocument(StrictFileModel):
    """A weld plan: what was computed, never that it complies with anything.

    Parameters
    ----------
    wps : str
        name of the WPS, and its SHA-256
    after_pass : int
        passes that were welded before the scan
    overlap_mm : float
        by which beads lap over their start, or over the bead that follows
    leg_radius_mm : float, or None
        of the leg's cylinder that bounds the areas; null if straight lines from p4 to g do
    interpass_wait_s : float
        from the end of a bead to the start of the next, at least
    hold_after_layers : tuple of int
        after which welding waits for an operator
    crater_time_s : float
        for which the arc burns in one place at the end of a bead
    stations : tuple of StationEntry
        in the order of welding
    without_stations : str
        why it is not known what is reached
    """

    schema_name: Literal["tjscan.plan"] = "tjscan.plan"
    version: Literal[3] = 3
    run: str
    wps: str
    provenance: Provenance
    gravity: Annotated[tuple[float, float, float], Field(strict=False)]
    closed: bool
    after_pass: int
    root: RootEntry
    groove_mm: float
    leg_radius_mm: float | None
    arc_time_s: float
    volume_mm3: float
    wire_m: float
    wire_kg: float
    gas_l: float
    stick_out_mm: float
    overlap_mm: float
    interpass_temperature_C: float  # noqa: N815
    interpass_wait_s: float
    hold_after_layers: List[int]
    crater_time_s: float
    zones: List[BeadCountZoneEntry]
    beads: List[BeadEntry]
    details: List[DetailEntry]
    out_of_wps: List[FindingEntry]
    stations: List[StationEntry]
    without_stations: str


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
    return _fill_entry(
        PlanDocument,
        plan,
        plan.edges,
        plan.wps.torch,
        plan.wps.sequence,
        run=run,
        wps=wps,
        provenance=provenance,
        gravity=tuple(plan.gravity.tolist()),
        root=_root_entry(plan),
        groove_mm=_file_value("groove_mm", plan.edges.length),
        wire_m=_file_value("wire_m", plan.wire_length),
        wire_kg=_file_value("wire_kg", plan.wire_mass),
        gas_l=_file_value("gas_l", plan.gas_volume),
        interpass_temperature_C=plan.wps.sequence.interpass_temperature,
        hold_after_layers=plan.wps.sequence.hold_after_layers,
        crater_time_s=plan.wps.crater_time,
        zones=tuple(
            _fill_entry(BeadCountZoneEntry, one, beads_in_layers=one.arrangement.counts)
            for one in plan.zones
        ),
        beads=tuple(
            _fill_entry(BeadEntry, bead, positions=tuple(sorted(set(bead.positions))))
            for bead in plan.beads
        ),
        details=tuple(_fill_entry(DetailEntry, one) for one in details),
        out_of_wps=tuple(_fill_entry(FindingEntry, one) for one in plan.findings),
        stations=stations,
        without_stations=without_stations,
    )


def _root_entry(plan: WeldPlan) -> RootEntry:
    root, settings = plan.edges.root, plan.wps.root
    opening = plan.edges.root_opening(root.s)[root.openness == 1]
    tacks = () if plan.after_pass else root.tack_spans(settings.tack_length)  # under a pass: none
    return _fill_entry(
        RootEntry,
        settings,
        opening_mm=_file_value("opening_mm", opening) if len(opening) else None,
        tack_spans_mm=tuple(_file_value("tack_spans_mm", span) for span in tacks),
    )


def _fill_entry(model: type[Entry], *sources: object, **own: Any) -> Entry:
    """Fill a model with the attributes of a plan's parts, in the units of the model's fields.

    Parameters
    ----------
    model : type
        Field ``speed_mm_min`` takes the attribute ``speed``; a field without a unit takes the
        attribute of its name.
    *sources : object
        Hold numbers and arrays in SI units; the first one with the attribute counts.
    **own
        Values of fields that the sources have no attribute for.
    """
    values = {}
    for name in model.model_fields.keys() - own.keys():
        stem, _ = _field_stem_and_factor(name)
        source = next((one for one in sources if hasattr(one, stem)), None)
        if source is not None:  # the others have a default
            values[name] = _file_value(name, getattr(source, stem))
    return model(**values, **own)


def _field_stem_and_factor(field: str) -> tuple[str, float]:
    """Name of a field without its unit, and the unit's value in SI units."""
    found = [unit for unit in FIELD_UNITS if field.endswith(f"_{unit.suffix}")]
    unit = max(found, key=lambda one: len(one.suffix), default=FileUnit(""))
    return field.removesuffix(f"_{unit.suffix}"), unit.factor


def _file_value(field: str, value: Any) -> Any:
    """A value as the file has it: numbers in the unit of the field, least and most of several."""
    factor = _field_stem_and_factor(field)[1]
    if isinstance(value, float):
        return float(f"{value / factor:.{SIGNIFICANT_DIGITS}g}")
    is_range = isinstance(value, tuple) and bool(value) and isinstance(value[0], float)
    if is_range or isinstance(value, np.ndarray):
        return tuple(_file_value(field, float(limit)) for limit in (np.min(value), np.max(value)))
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


@dataclass(frozen=True, slots=True, eq=False)
class BeadCourse:
    """Welding positions of a bead, or a part of it, along the groove, as ``beads.csv`` has them.

    Parameters
    ----------
    number : int
        In the order of welding.
    s : ndarray, shape (q,)
        Millimetres along the groove.
    positions : tuple of str
        Welding position at each point.
    """

    number: int
    s: Array
    positions: tuple[str, ...]


def read_beads_csv(file: Path) -> tuple[BeadCourse, ...]:
    """Read the welding positions of the beads in ``beads.csv``.

    Raises
    ------
    ConfigurationError
        If it is missing, or no such table.
    """
    try:
        text = read_small_file(file, MOST_TABLE_BYTES, "a table of beads").decode()
        lines = (line for line in text.splitlines() if not line.startswith("#"))
        parts: dict[tuple[str, str], list[dict[str, str]]] = {}
        for row in csv.DictReader(lines, strict=True):
            parts.setdefault((row["bead"], row["part"]), []).append(row)
        found = []
        for (number, _), rows in parts.items():
            s = np.array([float(row["s_mm"]) for row in rows])
            found.append(BeadCourse(int(number), s, tuple(row["position"] for row in rows)))
        return tuple(found)
    except OSError as error:
        raise ConfigurationError(f"can't be read: {error.strerror}", file=file) from None
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise ConfigurationError(
            f"is no table of beads as this version writes it ({error}): run `tjscan plan` again",
            file=file,
        ) from None


def beads_to_csv(plan: WeldPlan) -> str:
    """Convert a plan's beads to CSV text; the names of the columns have their units."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    names = ("bead", "part", "zone", "layer", "place", "kind")
    writer.writerow((*names, *_number_columns(plan.beads[0]), "position", "station"))
    for bead in plan.beads:
        whose = (bead.number, bead.part, bead.zone, bead.layer, bead.place, bead.kind)
        rows = np.column_stack(list(_number_columns(bead).values()))
        for row, position in zip(rows, bead.positions, strict=True):
            writer.writerow((*whose, *(f"{value:.6f}" for value in row), position, bead.station))
    return stream.getvalue()


def _number_columns(bead: PlannedBead) -> dict[str, Array]:
    """Columns of numbers of ``beads.csv``; rx, ry and rz are the torch's rotation vector, rad."""
    x, y, z = bead.points.T / MM.factor
    now = bead.at_points
    rx, ry, rz = rotation_to_vector(bead.T_r_torch[:, :3, :3]).T
    return {
        "s_mm": bead.s / MM.factor,
        **{"x_mm": x, "y_mm": y, "z_mm": z, "rx": rx, "ry": ry, "rz": rz},
        "speed_mm_min": now.speed / MM_PER_MIN.factor,
        "sigma_speed_mm_min": bead.relative_sigma * now.speed / MM_PER_MIN.factor,
        "feed_m_min": now.feed / M_PER_MIN.factor,
        "offset_mm": now.offset / MM.factor,
        "height_mm": now.height / MM.factor,
        "weave_mm": now.weave / MM.factor,
        "area_mm2": bead.area / MM2.factor,
        "sigma_area_mm2": bead.relative_sigma * bead.area / MM2.factor,
        "width_mm": bead.width / MM.factor,
        "heat_kJ_mm": bead.heat / KJ_PER_MM.factor,
        "slope_deg": bead.slope / DEG.factor,
        "rotation_deg": bead.rotation / DEG.factor,
    }


def _range_text(limits: tuple[float, float], digits: int) -> str:
    """Least and most, or the one number that both are as printed."""
    return "–".join(dict.fromkeys(f"{limit:.{digits}f}" for limit in limits))


BEAD_COLUMNS: Final[Mapping[str, Callable[[BeadEntry], str]]] = {
    "bead": lambda bead: str(bead.number),
    "station": lambda bead: bead.station or "–",
    "layer": lambda bead: f"{bead.layer}.{bead.place}",
    "kind": lambda bead: bead.kind,
    "length / mm": lambda bead: f"{bead.length_mm:.0f}",
    "wire / (m/min)": lambda bead: _range_text(bead.feed_m_min, 2),
    "speed / (mm/min)": lambda bead: _range_text(bead.speed_mm_min, 0),
    "area / mm²": lambda bead: _range_text(bead.area_mm2, 1),
    "weave ± / mm": lambda bead: _range_text(bead.weave_mm, 1),
    "heat / (kJ/mm)": lambda bead: _range_text(bead.heat_kJ_mm, 2),
    "position": lambda bead: " ".join(bead.positions),
    "arc / min": lambda bead: f"{bead.arc_time_s / 60:.1f}",
    "fill ± / %": lambda bead: f"{100 * bead.fill_sigma:.1f}",
}
"""Columns of the table of beads that the page and the terminal show."""


def out_of_wps_rows(plan: PlanDocument) -> list[tuple[str, ...]]:
    """What is out of the WPS, a row a key, in the order of `OUT_OF_WPS_HEAD`."""
    keys = dict.fromkeys(one.key for one in plan.out_of_wps)
    rows: list[tuple[str, ...]] = []
    for key in keys:
        found = [one for one in plan.out_of_wps if one.key == key]
        beads, texts = (
            list(dict.fromkeys(str(getattr(one, name)) for one in found))
            for name in ("bead", "text")
        )
        more = [f"and {len(texts) - MOST_TEXTS} more"] if len(texts) > MOST_TEXTS else []
        begin, end = min(one.begin_mm for one in found), max(one.end_mm for one in found)
        rows.append(
            (
                key,
                ", ".join(beads),
                f"{begin:.0f} to {end:.0f}",
                f"{100 * max(one.share for one in found):.0f} %",
                "; ".join([*texts[:MOST_TEXTS], *more]),
            )
        )
    return rows


OUT_OF_WPS_HEAD: Final = ("key", "beads", "s / mm", "of a bead at most", "what")
MOST_TEXTS: Final = 4
"""Of one key that are listed; plan.json has all."""


def bead_rows(plan: PlanDocument) -> list[tuple[str, ...]]:
    """Words of each bead, in the order of `BEAD_COLUMNS`."""
    return [tuple(word(bead) for word in BEAD_COLUMNS.values()) for bead in plan.beads]
