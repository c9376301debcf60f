"""From stitched stations to the report that stands beside their result."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tjscan.core.frames import inverse_pose, pose_to_euler_zyx, rotation_angle_between
from tjscan.result.stitching import OverlapReport, StationReport, StitchingReport, Triple
from tjscan.stitching.registration import StationRegistration, point_covariance_from_pose
from tjscan.stitching.stitch import PlacedStation, StitchedGroove


def build_stitching_report(stitched: StitchedGroove, sources: Mapping[str, str]) -> StitchingReport:
    """Convert a stitched groove to the report of its stations and overlaps, in mm and degrees.

    Parameters
    ----------
    stitched : StitchedGroove
        In metres and radians.
    sources : mapping of str to str
        Each station's run directory, seen from that of the result, by the station's name.
    """
    brace, leg, angle, offset = stitched.shape.as_array
    spread = stitched.shape_sigma
    first = stitched.stations[0]
    middle = np.mean([section.T_r_g[:3, 3] for section in stitched.sections], axis=0)
    names = tuple(one.station.name for one in stitched.stations)
    return StitchingReport(
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


def _mm(length: float | None) -> float | None:
    return None if length is None else 1e3 * length


def _triple(values: np.ndarray) -> Triple:
    a, b, c = (float(v) for v in values)
    return a, b, c


def _station(
    one: PlacedStation, first: PlacedStation, middle: np.ndarray, source: str
) -> StationReport:
    position, angles = pose_to_euler_zyx(one.T_j_b)
    spread = np.sqrt(np.diag(one.covariance))
    meant = inverse_pose(first.station.T_w_b) @ one.station.T_w_b
    found = inverse_pose(first.T_j_b) @ one.T_j_b
    at_groove = point_covariance_from_pose(one.covariance, middle)
    return StationReport(
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
        nominal_off_deg=float(np.degrees(rotation_angle_between(found, meant))),
        walls_rms_mm=1e3 * one.tubes_rms,
        walls_misfit=one.tubes_reduced_chi2,
    )


def _overlap(edge: StationRegistration, names: tuple[str, ...], gap: float) -> OverlapReport:
    overlap = edge.overlap
    units = np.repeat((1e3, 180 / np.pi), 3)
    covariance = edge.covariance * np.outer(units, units)
    return OverlapReport(
        stations=(names[overlap.first], names[overlap.second]),
        azimuth_deg=float(np.degrees(overlap.arc.middle_azimuth)),
        arc_deg=float(np.degrees(overlap.arc.span_angle)),
        sections=overlap.sections,
        views=len(edge.azimuth),
        left_out=int((~edge.counted).sum()),
        residual_rms_mm=1e3 * edge.residual_rms,
        misfit=edge.reduced_chi2,
        sigma_mm=1e3 * edge.position_sigma,
        covariance=tuple(tuple(float(v) for v in row) for row in covariance),
        gap_mm=1e3 * gap,
    )
