"""The page in Chromium: what is pressed there happens, and what happens is drawn there."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest
from _browser import started_browser, why_no_browser
from _live_browser import opened_page, served_page, share_like
from cells import PAPER

from tjscan.live.colours import ARM, TOOL, viridis
from tjscan.scanning.reader import read_recorded_scan

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(bool(why_no_browser()), reason=why_no_browser()),
]


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    with started_browser() as browser:
        yield browser


def test_a_scan_is_started_stepped_paused_and_stopped_by_clicks(
    browser: "Browser", tmp_path: Path
) -> None:
    run = tmp_path / "run"
    with (
        served_page("scan", PAPER, "--out", run, "--live", "--wait") as served,
        opened_page(browser, served.url) as shown,
    ):
        shown.wait_for("waiting for Start")
        shown.press("Step")
        shown.wait_for("paused: after section 2.*3 of 16")
        picture = shown.picture()
        assert share_like(picture, ARM) > 0.02
        assert share_like(picture, TOOL) > 0.002
        assert sum(share_like(picture, colour) for colour in viridis()[120:256:45]) > 5e-4
        assert shown.faults == []
        asked_of = {urlsplit(address).netloc for address in shown.requests}
        assert asked_of <= {urlsplit(served.url).netloc, ""}
        shown.press("Start")
        shown.press("Pause")
        shown.wait_for("paused: after section")
        shown.press("Stop")
        assert served.end() == 130
    scan = read_recorded_scan(run)
    assert scan.stop_reason.startswith("stop requested")
    assert 3 < len(scan.sections) < 16
