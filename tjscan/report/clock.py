"""Clock positions about the brace: 12 o'clock at the crown, 3 o'clock at azimuth 90°."""

from __future__ import annotations

from typing import Final

DEGREES_PER_HOUR: Final = 30.0


def clock_text(azimuth: float) -> str:
    """A clock position in hours and minutes, such as 2:30 for 75°.

    Parameters
    ----------
    azimuth : float
        About the brace's axis from the crown, degrees.
    """
    minutes = round(60 * azimuth / DEGREES_PER_HOUR) % 720
    return f"{minutes // 60 or 12}:{minutes % 60:02d}"
