"""``stations.json``: how stations were stitched, in millimetres and degrees."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic_core import to_json

from tjscan.core.config import read_json_as_written
from tjscan.core.provenance import Provenance
from tjscan.result.directory import STATIONS_FILE

MOST_REPORT_BYTES: Final = 1_000_000
"""A larger file reports no stitching."""

LOOP_OPEN: Final = (
    "no overlap closes the way round, so that how well its two ends meet is not known"
)
"""What is reported if there is no loop gap."""

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class StationReport:
    """Where stitching placed a station, how sure that is, and what the station saw.

    Parameters
    ----------
    name, source : str
        Which, and its run directory, seen from that of the stitched run.
    position_mm, euler_zyx_deg : tuple of float
        Its base in frame j.
    sigma_position_mm, sigma_rotation_deg : tuple of float
        Standard deviations along and about the axes of j, about its origin.
    sigma_groove_mm : float
        By how much its groove may be wrong as a whole, root mean square of three directions.
    azimuth_deg : tuple of float
        From where to where it saw.
    sections, views : int
        Finished sections, and views in which a groove was read.
    nominal_off_mm, nominal_off_deg : float
        How far its nominal pose is off, measured from the first station; 0 for that.
    walls_rms_mm, walls_misfit : float
        Of its wall points about leg and brace: distance, and chi-squared per degree of freedom.
    """

    name: str
    source: str
    position_mm: Triple
    euler_zyx_deg: Triple
    sigma_position_mm: Triple
    sigma_rotation_deg: Triple
    sigma_groove_mm: float
    azimuth_deg: tuple[float, float]
    sections: int
    views: int
    nominal_off_mm: float
    nominal_off_deg: float
    walls_rms_mm: float
    walls_misfit: float


@dataclass(frozen=True, slots=True)
class OverlapReport:
    """How well two stations fit each other where they overlap.

    Parameters
    ----------
    stations : tuple of str
        Both names.
    azimuth_deg, arc_deg : float
        Its middle and its length.
    sections : tuple of int
        How many each has there.
    views : int
        That were registered.
    left_out : int
        Of these, views whose weight in the robust fit is small: outliers.
    residual_rms_mm, misfit : float
        Of the corners about one smooth groove: size, and chi-squared per degree of freedom.
    sigma_mm : float
        How uncertain the overlap alone leaves the second station's place there, root mean square
        of three directions.
    covariance : tuple of tuple of float
        Of the second station's pose on the first, translation (mm) and rotation vector (degrees)
        in j, from the overlap alone.
    gap_mm : float
        How far apart the placed stations see the groove there, across it.
    """

    stations: tuple[str, str]
    azimuth_deg: float
    arc_deg: float
    sections: tuple[int, int]
    views: int
    left_out: int
    residual_rms_mm: float
    misfit: float
    sigma_mm: float
    covariance: tuple[tuple[float, ...], ...]
    gap_mm: float


@dataclass(frozen=True, slots=True)
class StitchingReport:
    """How stations were stitched, as ``stations.json`` holds it.

    Parameters
    ----------
    frame : str
        j, found from leg and brace.
    covered_deg : float
        Azimuth without a gap.
    brace_diameter_mm, leg_diameter_mm, angle_deg, offset_mm : float
        What the tubes are like: the angle between their axes, and how far these pass each other.
    sigma_brace_diameter_mm, sigma_leg_diameter_mm, sigma_angle_deg, sigma_offset_mm : float
        Standard deviations of these.
    out_of_round_mm : float
        How far the tubes' walls were taken to bulge from circles.
    loop_gap_before_mm, loop_gap_after_mm : float or None
        Largest gap across the groove if the way round closes: with the stations chained by
        their overlaps, and in the end. None if it does not close.
    stations : tuple of StationReport
        By name.
    overlaps : tuple of OverlapReport
        Every one that was used.
    provenance : Provenance or None
        Of the file that holds it; None in files of version 0.1.0.
    """

    frame: str
    covered_deg: float
    brace_diameter_mm: float
    leg_diameter_mm: float
    angle_deg: float
    offset_mm: float
    sigma_brace_diameter_mm: float
    sigma_leg_diameter_mm: float
    sigma_angle_deg: float
    sigma_offset_mm: float
    out_of_round_mm: float
    loop_gap_before_mm: float | None
    loop_gap_after_mm: float | None
    stations: tuple[StationReport, ...]
    overlaps: tuple[OverlapReport, ...]
    provenance: Provenance | None = None


def write_stitching_report(file: Path, report: StitchingReport) -> None:
    """Write ``stations.json``."""
    file.write_bytes(to_json(report, indent=2) + b"\n")


def read_stitching_report(directory: Path) -> StitchingReport | None:
    """Read ``stations.json`` of a stitched run.

    Parameters
    ----------
    directory : Path
        The run directory.

    Returns
    -------
    StitchingReport or None
        None if it was scanned from one place, and not stitched.

    Raises
    ------
    ConfigurationError
        If its ``stations.json`` is damaged.
    RecordingError
        If it is not as it was written.
    """
    file = directory / STATIONS_FILE
    if not file.is_file():
        return None
    return read_json_as_written(StitchingReport, file, MOST_REPORT_BYTES, "report of a stitching")
