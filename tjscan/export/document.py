"""What is handed on, as one document: its model is the schema of the JSON export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tjscan.core.config import FileModel
from tjscan.core.frames import Array
from tjscan.export.surfaces import surfaces_of
from tjscan.groove.measured import MeasuredSection
from tjscan.result.directory import SECTIONS
from tjscan.result.frame import FRAME_WORDS
from tjscan.result.sections import lengths, read_sections
from tjscan.result.shapes import finished_summary

VERSION: Final = 1
PER_METRE: Final = {"mm": 1e3, "m": 1.0}

Length = Literal["mm", "m"]
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Rows = Annotated[tuple[Vector, Vector, Vector], Field(strict=False)]
Covariances = Annotated[tuple[Rows, Rows, Rows], Field(strict=False)]
Points = Annotated[tuple[Vector, Vector, Vector, Vector, Vector], Field(strict=False)]


class Units(FileModel):
    """Units of every number; areas and variances are in squares of `length`."""

    length: Length
    angle: Literal["deg"] = "deg"


class Normals(FileModel):
    """Unit vectors out of the steel."""

    wall: Vector
    bevel: Vector
    leg: Vector


class FrameG(FileModel):
    """The section's own frame; `axes` are its x, y and z, each a unit vector."""

    origin: Vector
    axes: Rows


class Measures(FileModel):
    """Groove angle between bevel and leg, width of the root, depth and area of the groove."""

    groove_angle: float
    root_width: float
    depth: float
    area: float


class Section(FileModel):
    """One section; the index counts along the groove in growing azimuth where that is known."""

    index: int
    azimuth: float | None = Field(description="about the brace's axis; null in frame b")
    s: float = Field(description="length of the chain of groove origins up to here")
    station: str
    scan_index: int = Field(description="its number in its station's scan")
    points: Points = Field(description="p1 to p5")
    corner_covariances: Covariances = Field(description="of p2, p3 and p4")
    tangent: Vector = Field(description="unit vector along the groove, counterclockwise")
    normals: Normals
    frame_g: FrameG
    measures: Measures
    sigmas: Measures = Field(description="standard deviations of the measures")
    work_angle: float
    rms: float = Field(description="of the profile's points about the fitted sides")


class GrooveDocument(FileModel):
    """A groove, section by section."""

    schema_name: Literal["tjscan.groove"] = "tjscan.groove"
    version: Literal[1] = VERSION
    run: str
    frame: str
    frame_meaning: str
    units: Units
    calibration: str
    sections: Annotated[tuple[Section, ...], Field(strict=False, min_length=2)]

    @model_validator(mode="after")
    def _is_in_order(self) -> Self:
        if [section.index for section in self.sections] != list(range(len(self.sections))):
            raise ValueError("sections are not counted from zero, one by one")
        return self


def document_of(directory: Path, units: Length = "mm") -> GrooveDocument:
    """What a run directory hands on.

    Raises
    ------
    ConfigurationError
        If the directory holds no finished run, or fewer than two sections.
    """
    summary = finished_summary(directory)
    sections = read_sections(directory / SECTIONS)
    return to_document(
        sections,
        run=directory.resolve().name,
        frame=summary.frame,
        calibration=summary.calibration,
        units=units,
    )


def to_document(
    sections: tuple[MeasuredSection, ...],
    *,
    run: str,
    frame: str,
    calibration: str,
    units: Length = "mm",
) -> GrooveDocument:
    """Put sections into a document, by growing azimuth where that is known.

    Raises
    ------
    ConfigurationError
        If there are fewer than two.
    """
    # Neighbours along the groove tell its direction: they are sought in the order of the scan.
    surfaces = surfaces_of(sections)
    azimuths = np.unwrap([section.azimuth for section in sections])
    order = np.arange(len(sections)) if np.isnan(azimuths).any() else np.argsort(azimuths)
    along = lengths([sections[i] for i in order])
    directions = (surfaces.tangent, surfaces.wall, surfaces.bevel, surfaces.leg)
    return GrooveDocument(
        run=run,
        frame=frame,
        frame_meaning=FRAME_WORDS.get(frame, ""),
        units=Units(length=units),
        calibration=calibration,
        sections=tuple(
            _section(k, sections[i], along[k], [d[i] for d in directions], PER_METRE[units])
            for k, i in enumerate(order)
        ),
    )


def _section(
    index: int, section: MeasuredSection, along: float, directions: list[Array], scale: float
) -> Section:
    tangent, wall, bevel, leg = (_vector(d) for d in directions)
    azimuth = float(np.degrees(section.azimuth))
    p1, p2, p3, p4, p5 = (_vector(p) for p in scale * section.points)
    c2, c3, c4 = (_rows(c) for c in scale**2 * section.covariances)
    return Section(
        index=index,
        azimuth=None if np.isnan(azimuth) else _number(azimuth),
        s=_number(scale * along),
        station=section.station,
        scan_index=section.index,
        points=(p1, p2, p3, p4, p5),
        corner_covariances=(c2, c3, c4),
        tangent=tangent,
        normals=Normals(wall=wall, bevel=bevel, leg=leg),
        frame_g=FrameG(
            origin=_vector(scale * section.T_r_g[:3, 3]), axes=_rows(section.T_r_g[:3, :3].T)
        ),
        measures=_measures(section.measures, scale),
        sigmas=_measures(section.sigmas, scale),
        work_angle=_number(float(np.degrees(section.work_angle))),
        rms=_number(scale * section.rms),
    )


def _measures(values: Array, scale: float) -> Measures:
    file_units = np.array((180 / np.pi, scale, scale, scale**2))
    angle, width, depth, area = (_number(v) for v in values * file_units)
    return Measures(groove_angle=angle, root_width=width, depth=depth, area=area)


def _number(value: float) -> float:
    """A number without the noise of its last binary digits."""
    return float(f"{value:.10g}")


def _vector(v: Array) -> Vector:
    x, y, z = (_number(value) for value in v.tolist())
    return x, y, z


def _rows(matrix: Array) -> Rows:
    a, b, c = (_vector(row) for row in matrix)
    return a, b, c
