"""The wire feed of a kind of bead, and the error if none fits."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.wps import WeldingProcedure

TRIED_FEEDS: Final = 101
"""Number of wire feeds that are tried, evenly over their window."""


class NoArrangementFits(ConfigurationError):
    """No arrangement of beads fits some sections; its key is of the WPS."""


def choose_wire_feed(
    kind: str, area: Array, wps: WeldingProcedure, *, open_root: bool = False
) -> tuple[float, bool]:
    """Choose the highest wire feed at which speed and heat input stay in their windows.

    Parameters
    ----------
    kind : str
        Of the bead, for messages.
    area : ndarray, shape (m,)
        Of the bead along the groove, m²: the speed is deposition rate / area.
    wps : WeldingProcedure
        The windows.
    open_root : bool
        Whether the bead is laid over an open root.

    Returns
    -------
    float
        m/s.
    bool
        Whether the heat input fits; if it does at no wire feed, the speed alone decides.

    Raises
    ------
    NoArrangementFits
        If the speed fits at no wire feed.
    """
    table, limits = wps.limits(open_root=open_root)
    least, most = float(area.min()), float(area.max())
    feeds = np.linspace(*limits.wire_feed, TRIED_FEEDS)
    rate = wps.deposition_rate(feeds)
    slowest, fastest = rate / most, rate / least
    can = (slowest >= limits.travel_speed[0]) & (fastest <= limits.travel_speed[1])
    if not can.any():
        low, high = (f"{60e3 * slowest[i]:.0f} to {60e3 * fastest[i]:.0f} mm/min" for i in (0, -1))
        raise NoArrangementFits(
            f"a {kind} bead of {1e6 * least:.1f} to {1e6 * most:.1f} mm² needs {low} at the lowest "
            f"wire feed and {high} at the highest",
            key=f"{table}.travel_speed_mm_min",
        )
    warmest, coldest = wps.heat_input(feeds, slowest), wps.heat_input(feeds, fastest)
    warm = can & (coldest >= limits.heat_input[0]) & (warmest <= limits.heat_input[1])
    return float(feeds[warm if warm.any() else can].max()), bool(warm.any())
