"""Profiles at chosen places, with the sides fitted to them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.read import read_groove_with_fit
from tjscan.groove.settings import GrooveSettings
from tjscan.laser.profile import Profile
from tjscan.report.data import ReportData, StationRunData
from tjscan.report.picture import SMALL_PANEL_SIZE, ReportPicture, inline_figure, new_panels
from tjscan.result.picture import CORNER_COLOUR, LASER_COLOUR, ROOT_COLOUR

MOST_PROFILES_SHOWN: Final = 6
"""Profiles in the picture, evenly chosen along the groove."""

LEFT_OUT_COLOUR: Final = "#e0a080"
LEFT_OUT_POINT_MARGIN: Final = 8e-3
"""Metres about the fitted points within which those left out are shown."""

POINTS_ALONG_SIDE: Final = 40
"""Points by which a fitted side is drawn."""


def draw_fitted_profiles(data: ReportData) -> ReportPicture | None:
    """Draw profiles with their fitted sides; None if no recording is there."""
    chosen = _evenly_chosen_profiles(data)
    if not chosen:
        return None
    figures, panels = new_panels(len(chosen), SMALL_PANEL_SIZE)
    for axes, (section, place, profile, settings) in zip(panels, chosen, strict=True):
        where = "" if np.isnan(section.azimuth) else f", {np.degrees(section.azimuth):.0f}°"
        at = "" if len(data.places) == 1 else f"{place.name}, "
        found = ", ".join((f"rms {1e3 * section.rms:.3f} mm", *section.conditions))
        title = f"{at}section {section.index}{where}\n{found}"
        axes.set_title(title, fontsize=8, parse_math=False)
        _draw_fitted_profile(axes, profile, settings, section.absent)
    return inline_figure(
        figures,
        "Profiles and what was read in them",
        "Each picture looks along the groove, brace above and leg below: points that the fit rests "
        "on are blue, those left out as ghosts, flyers or noise orange; lines are the fitted "
        "sides, rings the corners p2, p3 and p4 as far as they are seen.",
        f"Profiles of sections {', '.join(str(section.index) for section, *_ in chosen)} with the "
        "sides fitted to them.",
    )


def _evenly_chosen_profiles(
    data: ReportData,
) -> list[tuple[MeasuredSection, StationRunData, Profile, GrooveSettings]]:
    """Sections whose profiles are there, evenly chosen."""
    there = []
    for section in data.sections:
        place = data.station_of_section(section)
        if place is not None and (found := place.profile_of_section(section.index)) is not None:
            there.append((section, place, *found))
    count = min(MOST_PROFILES_SHOWN, len(there))
    # The ends are taught or cut short: those between represent the whole better.
    places = (np.arange(count) + 0.5) * len(there) / max(count, 1)
    return [there[int(k)] for k in places]


def _draw_fitted_profile(
    axes: Any, profile: Profile, settings: GrooveSettings, absent: tuple[str, ...]
) -> None:
    axes.set_xlabel("← away from the sensor   $z_s$ / mm", fontsize=8)
    axes.set_ylabel("$x_s$ / mm   up the brace →", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()
    try:
        section, fit = read_groove_with_fit(profile, settings)
    except GrooveNotFound as error:
        axes.plot(1e3 * profile.z_s, 1e3 * profile.x_s, ".", color=LASER_COLOUR, markersize=2)
        axes.annotate(f"no groove read: {error.reason}", (0.05, 0.95), xycoords="axes fraction")
        return
    row, fitted = fit.row, fit.fitted
    keep = fitted.keep
    kept = row.points[keep]
    low, high = kept.min(axis=0) - LEFT_OUT_POINT_MARGIN, kept.max(axis=0) + LEFT_OUT_POINT_MARGIN
    near = ~keep & (row.points > low).all(axis=1) & (row.points < high).all(axis=1)
    for part, colour, name in ((keep, LASER_COLOUR, "fitted"), (near, LEFT_OUT_COLOUR, "left out")):
        axes.plot(*_z_and_x_mm(row.points[part]), ".", color=colour, markersize=3, label=name)
    starts = [np.nan, *(after for _, after in fitted.places)]
    ends = [*(before for before, _ in fitted.places), np.nan]
    for k, curve in enumerate(fitted.curves):
        own = fitted.kept_along(k)
        # Outer sides begin and end with their points, the others at corners.
        first, last = np.fmin(starts[k], own.min()), np.fmax(ends[k], own.max())
        along = np.linspace(first, last, POINTS_ALONG_SIDE)
        line = np.array([curve.point_on_curve(float(s)) for s in along])
        axes.plot(*_z_and_x_mm(line), color=CORNER_COLOUR, linewidth=0.8)
    for number, point in enumerate(section.points_s[1:4, [0, 2]], start=2):
        if f"p{number}" in absent:
            continue
        z, x = _z_and_x_mm(point[None])
        axes.plot(z, x, "o", color=ROOT_COLOUR, markersize=7, fillstyle="none")
        beside = {"xytext": (7, 0), "textcoords": "offset points"}
        axes.annotate(f"$p_{number}$", (z[0], x[0]), **beside, fontsize=9)


def _z_and_x_mm(points: Array) -> tuple[Array, Array]:
    return 1e3 * points[:, 1], 1e3 * points[:, 0]
