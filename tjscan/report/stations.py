"""How the stations of a stitched run fit: tables and picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.report.picture import ReportPicture, picture_from_png
from tjscan.result.directory import STATIONS_PICTURE
from tjscan.result.stitching import LOOP_OPEN, StitchingReport

MOST_PICTURE_BYTES: Final = 1_000_000
"""A larger picture would make the report too large to send."""

UNFIT_CHI2: Final = 9.0
"""Reduced chi-squared of an overlap above which a finding states it: three times the errors."""


def station_folders(directory: Path, report: StitchingReport | None) -> dict[str, Path]:
    """Run directories of the stations, wherever the result was moved to.

    Parameters
    ----------
    directory : Path
        The stitched run's.
    report : StitchingReport or None
        How it was stitched; None for a scan from one place, which has no stations.
    """
    if report is None:
        return {}
    return {station.name: directory / station.source for station in report.stations}


def tube_rows(report: StitchingReport) -> Iterator[tuple[str, str]]:
    """Diameters, angle and offset of the tubes that stitching found, and how the loop closes.

    Parameters
    ----------
    report : StitchingReport
        How the stations were stitched.

    Yields
    ------
    (str, str)
        What it is, and its value with two standard deviations.
    """
    for name, value, sigma in (
        ("leg", report.leg_diameter_mm, report.sigma_leg_diameter_mm),
        ("brace", report.brace_diameter_mm, report.sigma_brace_diameter_mm),
    ):
        yield f"{name} as found", f"{value:.2f} mm wide (± {2 * sigma:.2f}, two sigma)"
    yield (
        "axes as found",
        f"{report.angle_deg:.3f}° between them (± {2 * report.sigma_angle_deg:.3f}), "
        f"{report.offset_mm:.2f} mm apart (± {2 * report.sigma_offset_mm:.2f})",
    )
    if report.loop_gap_after_mm is not None and report.loop_gap_before_mm is not None:
        yield (
            "loop",
            f"closes to {report.loop_gap_after_mm:.3f} mm; "
            f"{report.loop_gap_before_mm:.3f} mm before it was closed",
        )


def station_rows(report: StitchingReport) -> list[tuple[str, ...]]:
    """A row for each station: where it is, and how sure that is.

    Parameters
    ----------
    report : StitchingReport
        How the stations were stitched.

    Returns
    -------
    list of tuple of str
        Name, azimuths, sections, position of the base in frame j (mm), its standard deviation at
        the groove (mm), how far the nominal pose is off (mm, degrees), and rms of the wall points
        about the tubes (mm).
    """
    return [
        (
            one.name,
            f"{one.azimuth_deg[0]:.0f}° to {one.azimuth_deg[1]:.0f}°",
            str(one.sections),
            ", ".join(f"{v:.2f}" for v in one.position_mm),
            f"{one.sigma_groove_mm:.3f}",
            f"{one.nominal_off_mm:.2f}",
            f"{one.nominal_off_deg:.3f}",
            f"{one.walls_rms_mm:.3f}",
        )
        for one in report.stations
    ]


def overlap_rows(report: StitchingReport) -> list[tuple[str, ...]]:
    """A row for each overlap: how well its stations fit there.

    Parameters
    ----------
    report : StitchingReport
        How the stations were stitched.

    Returns
    -------
    list of tuple of str
        Stations, azimuth of its middle, its length, sections of each station, residual rms (mm),
        reduced chi-squared, standard deviation (mm) and gap that is left (mm).
    """
    return [
        (
            " and ".join(one.stations),
            f"{one.azimuth_deg:.0f}°",
            f"{one.arc_deg:.1f}°",
            " and ".join(str(count) for count in one.sections),
            f"{one.residual_rms_mm:.3f}",
            f"{one.misfit:.2f}",
            f"{one.sigma_mm:.3f}",
            f"{one.gap_mm:.3f}",
        )
        for one in report.overlaps
    ]


def stitching_findings(report: StitchingReport) -> Iterator[str]:
    """What a reader has to know of the stitching, a sentence each.

    Parameters
    ----------
    report : StitchingReport
        How the stations were stitched.
    """
    if report.covered_deg < 360 - 0.5:
        yield f"The stations cover {report.covered_deg:.0f}° without a gap, not all of the joint."
    elif report.loop_gap_after_mm is None:
        yield f"All of it was seen, but {LOOP_OPEN}."
    for one in report.overlaps:
        if one.misfit > UNFIT_CHI2:
            yield (
                f"Stations {' and '.join(one.stations)} fit at {one.azimuth_deg:.0f}° "
                f"{np.sqrt(one.misfit):.1f} times worse than their errors explain."
            )


def read_stations_picture(directory: Path) -> ReportPicture | None:
    """The picture that the stitching left; None if it is not there."""
    file = directory / STATIONS_PICTURE
    if not file.is_file() or file.stat().st_size > MOST_PICTURE_BYTES:
        return None
    return picture_from_png(
        file.read_bytes(),
        "Stations and their overlaps",
        "Left, which station saw which part of the groove, overlaps shaded; right, what is left "
        "between the stations' corners in each overlap once all are placed.",
    )
