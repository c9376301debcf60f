"""A report in Chromium: it turns, tells, loads nothing, and stays readable without WebGL."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from _browser import changed_share, open_file, printed_pages, started_browser, why_no_browser

from tjscan.core.frames import Array
from tjscan.report.data import ReportData
from tjscan.report.write import render_report_page

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(bool(why_no_browser()), reason=why_no_browser()),
]

LEAST_TURNED, LEAST_COLOURED = 0.02, 0.002
"""Shares of the view's pixels: that the groove and the joint cover, and that its lines do."""

STAGE, STILL = "#view3d .stage", "#view3d img"


@pytest.fixture(scope="module")
def report(data: ReportData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("report") / "report.html"
    file.write_text(render_report_page(data), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    with started_browser() as browser:
        yield browser


def test_the_groove_turns_and_comes_back(browser: "Browser", report: Path) -> None:
    watched = open_file(browser, report)
    assert not watched.page.locator(STILL).is_visible()
    before = watched.picture(STAGE)
    watched.drag("#view3d canvas", 90, 30)
    assert changed_share(watched.picture(STAGE), before) > LEAST_TURNED
    watched.page.get_by_text("reset view").click()
    assert changed_share(watched.picture(STAGE), before) == 0
    watched.page.get_by_label("colour").select_option("depth")
    assert changed_share(watched.picture(STAGE), before) > LEAST_COLOURED
    assert (watched.requests, watched.faults) == ([], [])


def test_what_is_pointed_at_is_told_and_two_corners_are_measured(
    browser: "Browser", report: Path, data: ReportData
) -> None:
    page = open_file(browser, report).page
    told = page.locator("#view3d output")
    page.locator(STAGE).scroll_into_view_if_needed()
    box = page.locator(STAGE).bounding_box()
    assert box is not None
    ends = pixels_of_first_view(data, box["width"], box["height"])
    ends += (box["x"], box["y"])
    for section, end in zip(data.sections, ends, strict=True):
        page.mouse.move(*end)
        words = told.inner_text()
        assert words.startswith(f"section {section.index} at ")
        assert f"groove angle {np.degrees(section.measures[0]):.2f} ±" in words
    for end in (ends[0], ends[-1]):
        page.mouse.click(*end)
    first, last = data.sections[0], data.sections[-1]
    distance = 1e3 * np.linalg.norm(first.points[4] - last.points[4])
    found = re.match(r"section (\d+) p5 to section (\d+) p5: ([\d.]+) mm", told.inner_text())
    assert found is not None
    assert [int(found[1]), int(found[2])] == [first.index, last.index]
    assert float(found[3]) == pytest.approx(distance, abs=0.006)


def pixels_of_first_view(data: ReportData, wide: float, tall: float) -> Array:
    """Where p5 of each section stands in the view at first, (n, 2): to scale, all in 86 % of it."""
    corners = 1e3 * np.array([section.points for section in data.sections])
    turn, tilt = data.sections[len(data.sections) // 2].azimuth + 0.3, 0.3
    eye = np.array((np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)))
    right = np.array((-np.sin(turn), np.cos(turn), 0.0))
    flat = corners.reshape(-1, 3)
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    seen = (corners - middle) @ np.column_stack((right, np.cross(eye, right)))
    scale = 0.43 * min((wide, tall) / np.abs(seen).max(axis=(0, 1)))
    return np.asarray((wide / 2, tall / 2) + scale * seen[:, 4] * (1, -1))


def test_a_finger_turns_it_and_two_fingers_zoom(browser: "Browser", report: Path) -> None:
    watched = open_file(browser, report, width=400)
    touch = watched.page.context.new_cdp_session(watched.page)
    watched.page.locator(STAGE).scroll_into_view_if_needed()
    box = watched.page.locator(STAGE).bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def move(*ways: tuple[float, float, float, float]) -> None:
        """Fingers that go from one place to another, from the middle of the view."""
        for kind, share in (("touchStart", 0.0), ("touchMove", 0.5), ("touchMove", 1.0)):
            points = [
                {"x": x + a + share * (c - a), "y": y + b + share * (d - b), "id": k}
                for k, (a, b, c, d) in enumerate(ways)
            ]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    before = watched.picture(STAGE)
    move((0, 0, 60, 15))
    turned = watched.picture(STAGE)
    assert changed_share(turned, before) > LEAST_TURNED
    move((-30, 0, -70, 0), (30, 0, 70, 0))
    assert changed_share(watched.picture(STAGE), turned) > LEAST_TURNED


def test_a_narrow_dark_window_cuts_nothing_off(browser: "Browser", report: Path) -> None:
    watched = open_file(browser, report, width=400, colours="dark")
    assert watched.page.evaluate("document.documentElement.scrollWidth") == 400
    assert watched.faults == []


def test_paper_gets_the_still_picture(browser: "Browser", report: Path) -> None:
    page = open_file(browser, report).page
    assert 1 <= printed_pages(page) <= 6
    page.emulate_media(media="print")
    assert page.locator(STILL).is_visible()
    assert not page.locator(STAGE).is_visible()


def test_without_webgl_the_still_picture_stays(browser: "Browser", report: Path) -> None:
    watched = open_file(browser, report, without_webgl=True)
    assert watched.page.locator(STILL).is_visible()
    assert not watched.page.locator(STAGE).is_visible()
    assert watched.faults == []
