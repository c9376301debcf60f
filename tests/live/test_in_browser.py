"""The page in Chromium: what is pressed there happens, and what happens is drawn there."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import numpy as np
import pytest
from _browser import launched, started_browser, why_no_browser
from _live_browser import (
    STRIP,
    kill_browser,
    opened_page,
    press_through_calibration,
    served_page,
    share_like,
)
from cells import EXAMPLES, PAPER
from command import tjscan
from crawls import SHORT

from tjscan.core.frames import Array
from tjscan.crawler.journal import CrawlCycle, read_crawl
from tjscan.crawler.phases import Phase
from tjscan.live.colours import ARM_COLOUR, TOOL_COLOUR, viridis_colours
from tjscan.live.panel import VALUE_COLOUR
from tjscan.recording.journal import RunEvent
from tjscan.scanning.recording import read_recorded_scan
from tjscan.vehicle.vehicle import AT_REST, DEAD_MAN_TIME

if TYPE_CHECKING:
    from playwright.sync_api import Browser

"""Colour of points in a chart."""

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(bool(why_no_browser()), reason=why_no_browser()),
]


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    with started_browser() as browser:
        yield browser


def points_of(run: Path) -> Array:
    scan = read_recorded_scan(run)
    return np.array([scan.sections[i].points_b for i in sorted(scan.sections)])


def test_a_scan_is_started_stepped_paused_and_stopped_by_clicks(
    browser: "Browser", tmp_path: Path
) -> None:
    run = tmp_path / "run"
    # So many sections, at the arm's own pace, that none who is slow to press comes too late.
    fine = ("--scan.step-mm", 10, "--simulation.arm.realtime", "true")
    with (
        served_page("scan", PAPER, "--out", run, *fine, "--live", "--wait") as served,
        opened_page(browser, served.url) as shown,
    ):
        shown.wait_for("waiting for Start")
        shown.press("Step")
        shown.wait_for("paused: after section 2.*3 of 58")
        picture = shown.picture()
        assert share_like(picture, ARM_COLOUR) > 0.02
        assert share_like(picture, TOOL_COLOUR) > 0.002
        assert sum(share_like(picture, colour) for colour in viridis_colours()[120:256:45]) > 5e-4
        assert shown.faults == []
        asked_of = {urlsplit(address).netloc for address in shown.requests}
        assert asked_of <= {urlsplit(served.url).netloc, ""}
        shown.page.set_viewport_size(STRIP)
        shown.press("Start")
        shown.press("Pause")
        shown.wait_for("paused: after section")
        shown.press("Stop")
        assert served.end() == 130
    scan = read_recorded_scan(run)
    assert scan.stop_detail.startswith("stop requested")
    assert 3 <= len(scan.sections) < 58


def test_a_browser_killed_in_mid_scan_harms_nothing_and_another_shows_the_same(
    browser: "Browser", tmp_path: Path
) -> None:
    alone, run = tmp_path / "alone", tmp_path / "run"
    short = ("--scan.sections", 5)
    with served_page("scan", PAPER, "--out", run, "--live", "--wait", *short) as served:
        with (
            launched(browser.browser_type) as doomed,
            opened_page(doomed, served.url, STRIP) as shown,
        ):
            shown.press("Step")
            shown.wait_for("paused: after section 2")
            shown.press("Step")
            shown.wait_for("scanning one section|after section 3")
            kill_browser(doomed)
        with opened_page(browser, served.url, STRIP) as again:
            again.wait_for("paused: after section 3.*4 of 5")
            again.press("Start")
            assert served.end() == 0
    assert tjscan("scan", PAPER, "--out", alone, *short) == 0
    assert np.array_equal(points_of(run), points_of(alone))


def test_a_whole_calibration_is_done_by_clicks(browser: "Browser", tmp_path: Path) -> None:
    run, job = tmp_path / "run", EXAMPLES / "calibrate.toml"
    short = ("--board.touches", 4, "--board.lines", 5)
    with (
        served_page("calibrate", job, "--out", run, *short, "--live") as served,
        opened_page(browser, served.url, STRIP) as shown,
    ):
        press_through_calibration(shown)
        assert served.end() == 0
    assert (run / "calibration.toml").is_file()


def test_a_crawler_is_driven_by_a_held_button_and_stopped_by_a_click(
    browser: "Browser", tmp_path: Path
) -> None:
    file, run = tmp_path / "crawl.toml", tmp_path / "run"
    file.write_text(SHORT)
    words = ("crawl", "run", file, "--out", run, "--weld.length-m", 20, "--live", "--wait")
    with served_page(*words) as served:
        with (
            launched(browser.browser_type) as doomed,
            opened_page(doomed, served.url, STRIP) as shown,
        ):
            shown.hold("Hold: forward", "speed[1-9]")
            kill_browser(doomed)
        with opened_page(browser, served.url, STRIP) as shown:
            shown.wait_for("speed-?0")
            shown.press("Start")
            shown.wait_for("welding")
            shown.wait_for_curve(VALUE_COLOUR, 20)  # of its profile
            shown.press("STOP")
            assert served.end() == 130
    entries = list(read_crawl(run))
    cycles = [one for one in entries if isinstance(one, CrawlCycle)]
    by_hand = [one for one in cycles if one.phase is Phase.MANUAL]
    held = [one.state.time for one in by_hand if one.commanded != AT_REST]
    rolling = [one.state.time for one in by_hand if abs(one.state.odometry.speed) > 1e-3]
    assert held[0] < held[-1] < rolling[-1] < held[-1] + DEAD_MAN_TIME / 2
    assert [one.name for one in entries if isinstance(one, RunEvent)][-1] == Phase.STOP
