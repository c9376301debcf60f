"""Windows of a file: least and most."""

from __future__ import annotations


def filled_window(limits: tuple[float, float]) -> tuple[float, float]:
    """Give back a window, and refuse one that holds nothing.

    Raises
    ------
    ValueError
        If its second number is not larger than its first.
    """
    if limits[0] >= limits[1]:
        raise ValueError("is an empty window: its second number must be larger than its first")
    return limits
