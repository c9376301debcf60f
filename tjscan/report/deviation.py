"""How far the groove lies from its reference: the map over the azimuth, and a table."""

from __future__ import annotations

import numpy as np

from tjscan.report.data import ReportData
from tjscan.report.picture import ReportPicture, inline_figure


def draw_deviation_map(data: ReportData) -> ReportPicture | None:
    """Draw deviations unwrapped over the azimuth; None where nothing was compared in frame j."""
    comparison = data.comparison
    if comparison is None or comparison.reference.stated.frame != "j":
        return None
    kind = comparison.deviations[0]
    sign = "red lies outside the reference, blue inside" if kind.signed else "it has no sign"
    return inline_figure(
        comparison.plot().figure,
        "Deviation from the reference, unwrapped over the azimuth",
        f"Each column is a section, from the leg (below) over root and bevel to the brace (above); "
        f"{sign}; cells show medians, grey ones were not seen, and small saturated patches are "
        "ghosts of the laser.",
        f"Map of the deviation over clock position and height: median "
        f"{1e3 * float(np.median(kind.known)):.3f} mm.",
    )


def deviation_table_rows(data: ReportData) -> list[tuple[str, ...]]:
    """Kind, number and statistics of every kind of distance, in mm; the corners' first."""
    if data.comparison is None:
        return []
    rows = []
    # The corners first: a cloud holds ghosts too.
    for deviation in reversed(data.comparison.deviations):
        s = deviation.statistics
        numbers = (s.mean, s.median, s.rms, s.p95, s.max)
        within = "" if deviation.within is None else f"{100 * deviation.within:.1f} %"
        rows.append(
            (
                deviation.kind,
                str(len(deviation.known)),
                *(f"{number:.3f}" for number in numbers),
                within,
            )
        )
    return rows
