"""Sections are drawn by the clock, with their dimensions inside the drawing."""

import numpy as np

from tjscan.report.data import ReportData
from tjscan.report.dimensions import clock_text, sections_by_the_clock
from tjscan.report.drawings import draw_sections


def test_sections_are_drawn_by_the_clock_at_their_place(data: ReportData) -> None:
    chosen = sections_by_the_clock(data)
    azimuths = data.unwrapped_azimuths
    assert azimuths is not None
    hours = {round(azimuth / 30) for azimuth in azimuths}
    assert len(chosen) == len(hours)
    for hour in hours:
        off = np.abs(azimuths - 30 * hour)
        assert int(off.argmin()) in chosen
    drawings = draw_sections(data)
    assert [one.title.split(", ")[1] for one in drawings] == [f"section {k}" for k in chosen]
    for one in drawings:
        x, y, width, height = map(float, one.box.split())
        for label in one.labels:
            assert x < label.x < x + width
            assert y < label.y < y + height


def test_a_clock_position_is_read_like_a_clock() -> None:
    assert [clock_text(azimuth) for azimuth in (0, 75, 90, -30, 359.9, 720)] == [
        "12:00",
        "2:30",
        "3:00",
        "11:00",
        "12:00",
        "12:00",
    ]
