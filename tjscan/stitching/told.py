"""``stations.json``: how stations were stitched, in millimetres and degrees."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.frames import inverse, rotation_angle, to_euler_zyx
from tjscan.stitching.registration import Registration, point_covariance
from tjscan.stitching.stitch import PlacedStation, Stitched

LOOP_OPEN: Final = (
    "no overlap closes the way round, so that nothing tells how well its two ends meet"
)
"""What is told where there is no loop gap."""

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ToldStation:
    """Where a station stands.

    Parameters
    ----------
    name, source : str
        Which, and its run directory, seen from that of the stitched run.
    position_mm, euler_zyx_deg : tuple of float
        Its base in frame j.
    sigma_position_mm, sigma_rotation_deg : tuple of float
        Standard deviations along and about the axes of j, about its origin.
    sigma_groove_mm : float
        By how much its groove may lie wrong as a whole, root mean square of three directions.
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
class ToldOverlap:
    """How two stations fit where they overlap.

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
        Of these, views that the robust kernel did not listen to.
    residual_rms_mm, misfit : float
        Of the corners about one smooth groove: size, and chi-squared per degree of freedom.
    sigma_mm : float
        How uncertain the overlap alone leaves the second station's place there, root mean square
        of three directions.
    covariance : tuple of tuple of float
        Of the second station's pose on the first, translation (mm) and rotation vector (degrees)
        in j, as the overlap alone tells it.
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
class ToldStitching:
    """How stations were stitched.

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
        Largest gap across the groove where the way round closes: with the stations chained by
        their overlaps, and in the end. None where it does not close.
    stations : tuple of ToldStation
        By name.
    overlaps : tuple of ToldOverlap
        Every one that was used.
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
    stations: tuple[ToldStation, ...]
    overlaps: tuple[ToldOverlap, ...]


def tell(stitched: Stitched, sources: Mapping[str, str]) -> ToldStitching:
    """Tell a stitching in the units of files; `sources` maps stations' names to their `source`."""
    brace, leg, angle, offset = stitched.shape.array
    spread = stitched.shape_sigma
    first = stitched.stations[0]
    middle = np.mean([section.T_r_g[:3, 3] for section in stitched.sections], axis=0)
    names = tuple(one.station.name for one in stitched.stations)
    return ToldStitching(
        frame="j",
        covered_deg=float(np.degrees(stitched.covered)),
        brace_diameter_mm=float(2e3 * brace),
        leg_diameter_mm=float(2e3 * leg),
        angle_deg=float(np.degrees(angle)),
        offset_mm=float(1e3 * offset),
        sigma_brace_diameter_mm=float(2e3 * spread[0]),
        sigma_leg_diameter_mm=float(2e3 * spread[1]),
        sigma_angle_deg=float(np.degrees(spread[2])),
        sigma_offset_mm=float(1e3 * spread[3]),
        out_of_round_mm=1e3 * stitched.out_of_round,
        loop_gap_before_mm=_mm(stitched.gap_before),
        loop_gap_after_mm=_mm(stitched.gap_after),
        stations=tuple(
            _station(one, first, middle, sources.get(one.station.name, ""))
            for one in stitched.stations
        ),
        overlaps=tuple(
            _overlap(edge, names, gap)
            for edge, gap in zip(stitched.registrations, stitched.gaps, strict=True)
        ),
    )


def to_json(told: ToldStitching) -> str:
    """What was told as JSON text."""
    return json.dumps(asdict(told), indent=2)


def write_stations(file: Path, told: ToldStitching) -> None:
    """Write ``stations.json``."""
    file.write_text(to_json(told) + "\n", encoding="utf-8")


def _mm(length: float | None) -> float | None:
    return None if length is None else 1e3 * length


def _triple(values: np.ndarray) -> Triple:
    a, b, c = (float(v) for v in values)
    return a, b, c


def _station(
    one: PlacedStation, first: PlacedStation, middle: np.ndarray, source: str
) -> ToldStation:
    position, angles = to_euler_zyx(one.T_j_b)
    spread = np.sqrt(np.diag(one.covariance))
    meant = inverse(first.station.T_w_b) @ one.station.T_w_b
    found = inverse(first.T_j_b) @ one.T_j_b
    at_groove = point_covariance(one.covariance, middle)
    return ToldStation(
        name=one.station.name,
        source=source,
        position_mm=_triple(1e3 * position),
        euler_zyx_deg=_triple(np.degrees(angles)),
        sigma_position_mm=_triple(1e3 * spread[:3]),
        sigma_rotation_deg=_triple(np.degrees(spread[3:])),
        sigma_groove_mm=float(1e3 * np.sqrt(np.trace(at_groove) / 3)),
        azimuth_deg=(float(np.degrees(one.arc.start)), float(np.degrees(one.arc.end))),
        sections=len(one.station.sections),
        views=one.views,
        nominal_off_mm=float(1e3 * np.linalg.norm(found[:3, 3] - meant[:3, 3])),
        nominal_off_deg=float(np.degrees(rotation_angle(found, meant))),
        walls_rms_mm=1e3 * one.tubes_rms,
        walls_misfit=one.tubes_reduced_chi2,
    )


def _overlap(edge: Registration, names: tuple[str, ...], gap: float) -> ToldOverlap:
    overlap = edge.overlap
    units = np.repeat((1e3, 180 / np.pi), 3)
    covariance = edge.covariance * np.outer(units, units)
    return ToldOverlap(
        stations=(names[overlap.first], names[overlap.second]),
        azimuth_deg=float(np.degrees(overlap.arc.middle)),
        arc_deg=float(np.degrees(overlap.arc.length)),
        sections=overlap.sections,
        views=len(edge.azimuth),
        left_out=int((~edge.counted).sum()),
        residual_rms_mm=1e3 * edge.rms,
        misfit=edge.reduced_chi2,
        sigma_mm=1e3 * edge.sigma,
        covariance=tuple(tuple(float(v) for v in row) for row in covariance),
        gap_mm=1e3 * gap,
    )
