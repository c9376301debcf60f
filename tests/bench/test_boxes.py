"""The bench's measuring of boxes finds what is wrong with a page, and nothing on a sound one."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from _boxes import faults_of_figure, faults_of_page, watched_figures
from _browser import started_browser, why_no_browser
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from playwright.sync_api import Browser

SOUND = "<p>a line of text</p><p>and another</p><div style='overflow-x:auto;width:90px'>"
SOUND += "<table><tr><td style='min-width:400px'>wide, but it scrolls</td></tr></table></div>"

FAULTS = {
    "overlap": "<p>below</p><p style='margin-top:-2.2em'>above</p>",
    "cut off": "<div style='width:40px;overflow:hidden;white-space:nowrap'>too long for it</div>",
    "beyond the page": "<p style='position:absolute;left:-30px'>to the left</p>",
    "scrolls sideways": "<table><tr><td style='min-width:900px'>wide</td></tr></table>",
}

needs_browser = pytest.mark.skipif(bool(why_no_browser()), reason=why_no_browser())


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    with started_browser() as browser:
        yield browser


@pytest.mark.browser
@needs_browser
def test_nothing_is_found_on_a_sound_page(browser: "Browser") -> None:
    page = browser.new_page(viewport={"width": 390, "height": 700})
    page.set_content(SOUND)
    assert faults_of_page(page) == []
    assert [one[:7] for one in faults_of_page(page, paper=True)] == ["cut off"]  # paper scrolls not


@pytest.mark.browser
@needs_browser
@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_found(browser: "Browser", kind: str) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 700})
    page.set_content(SOUND + FAULTS[kind])
    assert [one for one in faults_of_page(page) if one.startswith(kind)]


def test_texts_of_a_picture_are_measured() -> None:
    figure = Figure(layout="constrained")
    figure.add_subplot().plot([0, 1], [0, 1])
    assert faults_of_figure(figure) == []
    figure.text(0.5, 0.5, "one text")
    figure.text(0.5, 0.5, "another")
    figure.text(0.95, 0.9, "far too long for its place")
    found = faults_of_figure(figure)
    assert any(one.startswith("overlap") for one in found)
    assert any(one.startswith("cut off") for one in found)


def test_saved_pictures_are_watched(tmp_path_factory: pytest.TempPathFactory) -> None:
    figure = Figure()
    figure.text(0.95, 0.9, "far too long for its place")
    with watched_figures() as found:
        figure.savefig(tmp_path_factory.mktemp("picture") / "a.png")
    assert sum(map(len, found.values())) == 1
