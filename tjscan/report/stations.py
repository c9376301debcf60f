"""How the stations of a stitched run fit: tables and picture."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.report.picture import Picture
from tjscan.result.directory import STATIONS_PICTURE
from tjscan.result.stitching import LOOP_OPEN, StitchingReport

MOST_BYTES: Final = 1_000_000
"""A larger picture would make the report too large to send."""

UNFIT: Final = 9.0
"""Chi-squared per degree of freedom of an overlap that is worth a word: three times the errors."""


def station_folders(directory: Path, told: StitchingReport | None) -> dict[str, Path]:
    """Where the recordings of the stations are, wherever the result was moved to."""
    if told is None:
        return {}
    return {station.name: directory / station.source for station in told.stations}


def found_rows(told: StitchingReport) -> Iterator[tuple[str, str]]:
    """What the tubes are like, as the data tell it."""
    for name, value, sigma in (
        ("leg", told.leg_diameter_mm, told.sigma_leg_diameter_mm),
        ("brace", told.brace_diameter_mm, told.sigma_brace_diameter_mm),
    ):
        yield f"{name} as found", f"{value:.2f} mm wide (± {2 * sigma:.2f}, two sigma)"
    yield (
        "axes as found",
        f"{told.angle_deg:.3f}° between them (± {2 * told.sigma_angle_deg:.3f}), "
        f"{told.offset_mm:.2f} mm apart (± {2 * told.sigma_offset_mm:.2f})",
    )
    if told.loop_gap_after_mm is not None and told.loop_gap_before_mm is not None:
        yield (
            "loop",
            f"closes to {told.loop_gap_after_mm:.3f} mm; "
            f"{told.loop_gap_before_mm:.3f} mm before it was closed",
        )


def station_rows(told: StitchingReport) -> list[tuple[str, ...]]:
    """Where each station stands, and how sure that is."""
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
        for one in told.stations
    ]


def overlap_rows(told: StitchingReport) -> list[tuple[str, ...]]:
    """How stations fit where they overlap."""
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
        for one in told.overlaps
    ]


def stitching_findings(told: StitchingReport) -> Iterator[str]:
    """What to know of the stitching."""
    if told.covered_deg < 360 - 0.5:
        yield f"The stations cover {told.covered_deg:.0f}° without a gap, not all of the joint."
    elif told.loop_gap_after_mm is None:
        yield f"All of it was seen, but {LOOP_OPEN}."
    for one in told.overlaps:
        if one.misfit > UNFIT:
            yield (
                f"Stations {' and '.join(one.stations)} fit at {one.azimuth_deg:.0f}° "
                f"{np.sqrt(one.misfit):.1f} times worse than their errors explain."
            )


def stations_picture(directory: Path) -> Picture | None:
    """The picture that the stitching left; None where it is not there."""
    file = directory / STATIONS_PICTURE
    if not file.is_file() or file.stat().st_size > MOST_BYTES:
        return None
    data = b64encode(file.read_bytes()).decode("ascii")
    return Picture(
        "Stations and their overlaps",
        "Left, which station saw which part of the groove, overlaps shaded; right, what is left "
        "between the stations' corners in each overlap once all are placed.",
        f"data:image/png;base64,{data}",
    )
